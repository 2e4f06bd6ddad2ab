//! `cargo xtask mutants`: whether the tests of the protocol and bridge crates notice when the code is changed.

use std::ffi::OsString;
use std::fs;

use anyhow::{Result, bail, ensure};
use clap::Args;

use crate::cargo::{target_dir, tool};
use crate::process::run_to;

/// The packages whose code is changed.
const PACKAGES: [&str; 2] = ["armwire", "armwire-bridge"];

/// The least part of the changes that tests must notice, in percent.
const LEAST: usize = 90;

/// Exit codes of cargo-mutants after all changes: all caught, some missed, some timed out.
const TRIED_ALL: [i32; 3] = [0, 2, 3];

/// The quick tests in the crate, up to the first that fails: `.config/nextest.toml` says which, and for how long each may
/// run.
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
    /// All changes.
    pub(crate) const ALL: Self = Self { options: Vec::new() };
}

/// Changes the code, one place at a time, and runs the tests: first the quick ones, then all on what these missed.
/// Prints how many were noticed.
///
/// # Errors
///
/// If fewer than [`LEAST`] are noticed in one of the packages, or not all changes were tried, as when a test fails without
/// any.
pub(crate) fn run(Options { options }: &Options) -> Result<()> {
    // cargo-mutants would take a shard of what was missed.
    if options.iter().any(|arg| arg.to_string_lossy().starts_with("--shard")) {
        bail!("a part of the changes is chosen by `--file`, not by `--shard`");
    }
    // It is cargo-mutants that calls it.
    tool("nextest")?;
    let mut refused = Vec::new();
    for package in PACKAGES {
        let out = target_dir()?.join("mutants").join(package);
        fs::create_dir_all(&out)?;
        // A mutant caught last time may be missed now.
        let list = out.join("mutants.out");
        if list.exists() {
            fs::remove_dir_all(&list)?;
        }
        let count = |file: &str| fs::read_to_string(list.join(file)).map_or(0, |text| text.lines().count());
        let mut noticed = 0;
        for stage in [QUICK, ALL] {
            let mut mutants = tool("mutants --output")?;
            mutants
                .arg(&out)
                .args(["--package", package])
                .args(options)
                .args(stage.split(' '))
                // Jobs that build in one place would run each other's changes.
                .env_remove("CARGO_TARGET_DIR");
            run_to(&TRIED_ALL, &mut mutants)?;
            noticed += count("caught.txt");
            if count("missed.txt") + count("timeout.txt") == 0 {
                break;
            }
        }
        noticed += count("timeout.txt");
        let all = noticed + count("missed.txt");
        if all == 0 {
            println!("{package}: no changes");
            continue;
        }
        let score = 100 * noticed / all;
        println!("{package}: tests notice {noticed} of {all} changes, {score} %");
        if score < LEAST {
            refused.push(format!("{package}: {score} %"));
        }
    }
    let refused = refused.join(", ");
    ensure!(
        refused.is_empty(),
        "tests notice less than {LEAST} % of changes: {refused}"
    );
    Ok(())
}
