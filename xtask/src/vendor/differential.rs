//! The parsers of Ling's SDK and of armwire on the same damaged streams.

use std::fs;

use anyhow::Result;

use super::sdk;
use crate::cargo::cargo;
use crate::process::output;

/// Seed of the streams: each run gives the same numbers.
const SEED: &str = "1";

/// Prints the numbers of lost intact frames and of false frames for both.
///
/// # Errors
///
/// If armwire differs from the reference decoder, if the vendor's parser is better in a row, or if it cannot be installed.
pub(crate) fn compare() -> Result<()> {
    let python = sdk::python()?;
    let streams = output(cargo("run --quiet --package armwire-host-tests --example differential --").arg(SEED))?;
    let file = python.dir.join("differential.txt");
    fs::write(&file, streams)?;
    python.run("differential.py", &[&file])
}
