//! The arm vendors' SDKs: that of the xArm on TCP ports, that of the Ling arm through the firmware image.

use anyhow::Result;

use super::python::Python;
use super::served::ServedBoard;
use crate::cargo::{cargo, target_dir};
use crate::process;

/// The SDK of the xArm, on virtual arms that the script starts by itself.
///
/// # Errors
///
/// If it reads anything but what it must, or takes too long.
pub(crate) fn drive_xarm() -> Result<()> {
    let python = python()?;
    process::run(&mut cargo("build --package armwire-cli"))?;
    python.run("xarm_drive.py", &[&target_dir()?.join("debug/armwire")])
}

/// The SDK of the Ling arm, on a virtual arm behind the virtual board's serial port.
///
/// # Errors
///
/// If it reads anything but what it must, or takes too long.
pub(crate) fn drive_ling() -> Result<()> {
    let python = python()?;
    let board = ServedBoard::start(&python.dir)?;
    let driven = python.run("drive.py", &[board.serial()]);
    driven.and(board.end())
}

/// The SDKs without their dependencies, which include all of PyTorch, but with what is needed of these.
pub(super) fn python() -> Result<Python> {
    Python::with("sdk", "requirements.txt")
}
