//! `cargo xtask integrity`: what becomes of every frame of the documents if any one thing happens to it.

use std::ffi::OsString;

use crate::Result;
use crate::process::{cargo, run as run_command};
use crate::workspace;

/// Prints the tables and checks that `docs/integrity.md` has them; with `--write`, writes them there.
///
/// # Errors
///
/// If the document has others, an option is unknown, or the test does not run.
pub(crate) fn run(args: &[OsString]) -> Result {
    let write = match args {
        [] => false,
        [option] if option == "--write" => true,
        _ => return Err("usage: cargo xtask integrity [--write]".into()),
    };
    let mut test = cargo();
    test.args(["test", "--package", "armwire-host-tests", "--test", "integrity"]);
    test.args(["--", "--nocapture"]).current_dir(workspace::root());
    if write {
        test.env("ARMWIRE_WRITE", "1");
    }
    run_command(&mut test)
}
