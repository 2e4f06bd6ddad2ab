//! The `armwire` command.

use std::ffi::OsString;

use pyo3::prelude::*;

/// Runs the command with these arguments; the first is the program's name. Returns the exit status, 0 on success.
#[pyfunction]
pub(crate) fn run(py: Python<'_>, args: Vec<OsString>) -> u8 {
    py.detach(|| armwire_cli::run_from(&args))
}
