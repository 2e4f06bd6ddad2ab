//! MCAP recordings in the MCAP packages for Python.

use anyhow::Result;

use crate::cargo::{cargo, target_dir};
use crate::process;
use crate::vendor::python::Python;
use crate::vendor::served::ServedBoard;

/// Records a virtual arm alone, and one behind the virtual board, and checks both files.
///
/// # Errors
///
/// If a file has a wrong content, or a timeout is exceeded.
pub(super) fn check() -> Result<()> {
    let python = Python::with("recordings", "requirements-recordings.txt")?;
    process::run(&mut cargo("build --package armwire-cli"))?;
    let armwire = target_dir()?.join("debug/armwire");
    python.run("recordings.py", &[&armwire])?;
    let board = ServedBoard::start(&python.dir, "ideal")?;
    let checked = python.run("recordings.py", &[&armwire, board.serial(), board.control()]);
    checked.and(board.end())
}
