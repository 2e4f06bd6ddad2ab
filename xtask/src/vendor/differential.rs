//! The parser of the Ling arm's SDK and ours on the same damaged streams.

use std::fs;

use crate::Result;
use crate::process::{cargo, output};
use crate::vendor::DRIVE;
use crate::vendor::background::Background;
use crate::vendor::sdk;
use crate::workspace;

/// What the streams are drawn from: the figures are the same in every run.
const SEED: &str = "1";

/// Prints how many intact frames each of them loses and how many false ones it delivers.
///
/// # Errors
///
/// If ours delivers anything but what the reference decoder does, if the vendor's does better in any row, or if it cannot
/// be had.
pub(crate) fn compare() -> Result {
    let python = sdk::python()?;
    let mut streams = cargo();
    streams.args([
        "run",
        "--quiet",
        "--package",
        "armwire-host-tests",
        "--example",
        "differential",
    ]);
    let streams = output(streams.args(["--", SEED]).current_dir(workspace::root()))?;
    let file = python.dir.join("differential.txt");
    fs::write(&file, streams)?;
    Background::start(python.script("differential.py").arg(file))?.succeed_within(DRIVE)
}
