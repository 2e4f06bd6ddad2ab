//! The parser of the Ling arm's SDK and ours on the same damaged streams.

use std::fs;

use anyhow::Result;

use super::sdk;
use crate::cargo::cargo;
use crate::process::output;

/// Seed of the streams: the figures are the same in every run.
const SEED: &str = "1";

/// Prints how many intact frames each of them loses and how many false ones it delivers.
///
/// # Errors
///
/// If ours delivers anything but what the reference decoder does, if the vendor's does better in any row, or if it cannot
/// be had.
pub(crate) fn compare() -> Result<()> {
    let python = sdk::python()?;
    let streams = output(cargo("run --quiet --package armwire-host-tests --example differential --").arg(SEED))?;
    let file = python.dir.join("differential.txt");
    fs::write(&file, streams)?;
    python.run("differential.py", &[&file])
}
