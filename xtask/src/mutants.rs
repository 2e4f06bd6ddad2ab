//! `cargo xtask mutants`: mutation testing of the protocol and bridge crates.

use std::ffi::OsString;
use std::fs;

use anyhow::{Result, bail, ensure};
use clap::Args;

use crate::cargo::{target_dir, tool};
use crate::files::empty_folder;
use crate::process::run_to;

/// The mutated packages.
const PACKAGES: [&str; 2] = ["armwire", "armwire-bridge"];

/// Minimum share of mutants that tests must detect, in percent.
const LEAST: usize = 90;

/// Exit codes of cargo-mutants after a complete run: all caught, some missed, some timed out.
const TRIED_ALL: [i32; 3] = [0, 2, 3];

/// The quick tests in the crate, up to the first failure. `.config/nextest.toml` has the list and the timeouts.
const QUICK: &str = "--test-tool nextest --cargo-arg=--lib -- --profile mutants";

/// All tests, on the mutants missed before. The bridge's tests run for minutes of virtual time.
const ALL: &str = "--iterate --cargo-arg=--config=profile.dev.package.armwire-bridge.opt-level=1";

#[derive(Args)]
pub(crate) struct Options {
    /// Options of cargo-mutants, such as --file 'bridge/src/isotp/*.rs' --jobs 4
    #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
    options: Vec<OsString>,
}

impl Options {
    pub(crate) const ALL: Self = Self { options: Vec::new() };
}

/// Mutates the code, one place at a time. Runs the quick tests, and then all tests on the mutants that these missed.
/// Prints the number of detected mutants.
///
/// # Errors
///
/// If fewer than [`LEAST`] are detected in a package, or the run is incomplete, for example because a test fails without
/// a mutation.
pub(crate) fn run(Options { options }: &Options) -> Result<()> {
    // cargo-mutants would take a shard of the missed mutants.
    if options.iter().any(|arg| arg.to_string_lossy().starts_with("--shard")) {
        bail!("select mutants by `--file`, not by `--shard`");
    }
    // cargo-mutants calls it.
    tool("nextest")?;
    let mut refused = Vec::new();
    for package in PACKAGES {
        let out = target_dir()?.join("mutants").join(package);
        // A mutant caught last time may be missed now.
        empty_folder(&out)?;
        let count =
            |file: &str| fs::read_to_string(out.join("mutants.out").join(file)).map_or(0, |text| text.lines().count());
        let mut detected = 0;
        for stage in [QUICK, ALL] {
            let mut mutants = tool("mutants --output")?;
            mutants
                .arg(&out)
                .args(["--package", package])
                .args(options)
                .args(stage.split(' '))
                // Jobs in one target directory would run each other's mutants.
                .env_remove("CARGO_TARGET_DIR");
            run_to(&TRIED_ALL, &mut mutants)?;
            detected += count("caught.txt");
            if count("missed.txt") + count("timeout.txt") == 0 {
                break;
            }
        }
        detected += count("timeout.txt");
        let all = detected + count("missed.txt");
        if all == 0 {
            println!("{package}: no mutants");
            continue;
        }
        let score = 100 * detected / all;
        println!("{package}: {detected} of {all} mutants detected, {score} %");
        if score < LEAST {
            refused.push(format!("{package}: {score} %"));
        }
    }
    let refused = refused.join(", ");
    ensure!(
        refused.is_empty(),
        "tests detect less than {LEAST} % of the mutants: {refused}"
    );
    Ok(())
}
