//! `cargo xtask integrity`: the results of decoding every damaged frame of the documents.

use anyhow::Result;
use clap::Args;

use crate::cargo::cargo;
use crate::process;

#[derive(Args, Default)]
pub(crate) struct Options {
    /// Write the tables into docs/integrity.md instead of comparing them
    #[arg(long)]
    write: bool,
}

/// Prints the tables, and compares them with `docs/integrity.md` or writes them there.
///
/// # Errors
///
/// If the page has other tables, or the test does not run.
pub(crate) fn run(options: &Options) -> Result<()> {
    let mut test = cargo("test --package armwire-host-tests --test integrity -- --nocapture");
    if options.write {
        test.env("ARMWIRE_WRITE", "1");
    }
    process::run(&mut test)
}
