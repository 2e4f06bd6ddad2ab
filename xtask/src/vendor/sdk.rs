//! The arm vendors' SDKs: xArm's over TCP, Ling's through the firmware image.

use anyhow::Result;

use super::python::Python;
use super::served::ServedBoard;
use crate::cargo::{cargo, target_dir};
use crate::process;

/// Runs the SDK of the xArm. The script starts virtual arms.
///
/// # Errors
///
/// If the SDK reads a wrong value, or a timeout is exceeded.
pub(crate) fn drive_xarm() -> Result<()> {
    let python = python()?;
    process::run(&mut cargo("build --package armwire-cli"))?;
    python.run("xarm_drive.py", &[&target_dir()?.join("debug/armwire")])
}

/// Runs the SDK of the Ling arm, with a virtual arm behind the virtual board's serial port.
///
/// # Errors
///
/// If the SDK reads a wrong value, or a timeout is exceeded.
pub(crate) fn drive_ling() -> Result<()> {
    let python = python()?;
    let board = ServedBoard::start(&python.dir)?;
    let driven = python.run("drive.py", &[board.serial()]);
    driven.and(board.end())
}

/// The SDKs, and the needed ones of their dependencies. The others include all of PyTorch.
pub(super) fn python() -> Result<Python> {
    Python::with("sdk", "requirements.txt")
}
