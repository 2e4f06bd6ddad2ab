//! The arm vendors' SDKs: that of the xArm on TCP ports, that of the Ling arm through the firmware image.

use crate::Result;
use crate::process::{cargo, run};
use crate::vendor::DRIVE;
use crate::vendor::background::Background;
use crate::vendor::python::Python;
use crate::vendor::served::ServedBoard;
use crate::workspace;

/// The SDK of the xArm, on virtual arms that the script starts by itself.
///
/// # Errors
///
/// If it reads anything but what it must, or takes too long.
pub(crate) fn drive_xarm() -> Result {
    let python = python()?;
    run(cargo().args(["build", "--package", "armwire-cli"]))?;
    let armwire = workspace::target_dir()?.join("debug/armwire");
    Background::start(python.script("xarm_drive.py").arg(armwire))?.succeed_within(DRIVE)
}

/// The SDK of the Ling arm, on a virtual arm behind the virtual board's serial port.
///
/// # Errors
///
/// If it reads anything but what it must, or takes too long.
pub(crate) fn drive_ling() -> Result {
    let python = python()?;
    let board = ServedBoard::start(&python.dir)?;
    let driven = Background::start(python.script("drive.py").arg(board.serial()))?.succeed_within(DRIVE);
    driven.and(board.end())
}

/// The SDKs without their dependencies, which include all of PyTorch, but with what is needed of these.
pub(super) fn python() -> Result<Python> {
    Python::with("sdk", "requirements.txt")
}
