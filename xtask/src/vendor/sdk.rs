//! The arm vendors' SDKs: xArm's over TCP, Ling's through the firmware image.

use anyhow::Result;

use super::python::Python;
use super::served::ServedBoard;
use crate::board::Board;
use crate::cargo::{cargo, target_dir};
use crate::examples::install_emulator;
use crate::process;
use crate::workspace::root;

/// Runs the SDK of the xArm. The scripts start virtual arms.
///
/// # Errors
///
/// If the SDK reads a wrong value, a page has another result of a method, or a timeout is exceeded.
pub(crate) fn drive_xarm() -> Result<()> {
    let python = python()?;
    process::run(&mut cargo("build --package armwire-cli"))?;
    let armwire = target_dir()?.join("debug/armwire");
    python.run("xarm_drive.py", &[&armwire])?;
    python.run("xarm_methods.py", &[&armwire, &root().join("docs/vendor-sdk.md")])
}

/// Runs the SDK of the Ling arm, with a virtual arm behind the serial port of a virtual board, and of an emulated Pico.
///
/// # Errors
///
/// If the SDK reads a wrong value, or a timeout is exceeded.
pub(crate) fn drive_ling() -> Result<()> {
    let python = python()?;
    install_emulator()?;
    [Board::default(), Board::PICO].into_iter().try_for_each(|board| {
        let board = ServedBoard::start_board(&python.dir, "ideal", board)?;
        let driven = python.run("drive.py", &[board.serial()]);
        driven.and(board.end())
    })
}

/// The SDKs, and the needed ones of their dependencies. The others include all of PyTorch.
pub(super) fn python() -> Result<Python> {
    Python::with("sdk", "requirements.txt")
}
