//! MCAP recordings, read by the MCAP packages for Python.

use anyhow::Result;

use crate::cargo::{cargo, target_dir};
use crate::process;
use crate::vendor::python::Python;
use crate::vendor::served::ServedBoard;

/// Records a virtual arm, and one behind the virtual board's adapter, and checks both files.
///
/// # Errors
///
/// If a file has anything but what it must, or something takes too long.
pub(super) fn check() -> Result<()> {
    let python = Python::with("recordings", "requirements-recordings.txt")?;
    process::run(&mut cargo("build --package armwire-cli"))?;
    let armwire = target_dir()?.join("debug/armwire");
    python.run("recordings.py", &[&armwire])?;
    let board = ServedBoard::start(&python.dir)?;
    let checked = python.run("recordings.py", &[&armwire, board.serial(), board.control()]);
    checked.and(board.end())
}
