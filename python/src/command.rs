//! The `armwire` command.

use std::ffi::OsString;

use pyo3::prelude::*;

/// Does what these words say, of which the first is the program's name. Returns whether it was done.
#[pyfunction]
pub(crate) fn run(py: Python<'_>, args: Vec<OsString>) -> bool {
    py.detach(|| armwire_cli::run_from(&args))
}
