//! `cargo xtask mutants`: whether the tests of the protocol and bridge crates notice when the code is changed.

use std::ffi::OsString;
use std::fs;

use crate::Result;
use crate::cargo_tool::cargo_tool;
use crate::process::run as run_command;
use crate::workspace;

/// The packages whose code is changed.
const PACKAGES: [&str; 2] = ["armwire", "armwire-bridge"];

/// The least part of the changes that tests must notice, in percent.
const LEAST: usize = 90;

/// Changes the code, one place at a time, and runs the tests: first those in the crate, then all on what these missed.
/// Prints how many were noticed. `rest` goes to cargo-mutants, such as `--shard 1/10` or `--jobs 4`.
///
/// # Errors
///
/// If fewer than [`LEAST`] are noticed in one of the packages.
pub(crate) fn run(rest: &[OsString]) -> Result {
    let mut refused = Vec::new();
    for package in PACKAGES {
        let out = workspace::target_dir()?.join("mutants").join(package);
        fs::create_dir_all(&out)?;
        // What was noticed the last time may be noticed no more.
        let list = out.join("mutants.out");
        if list.exists() {
            fs::remove_dir_all(&list)?;
        }
        for stage in [&["--", "--lib"][..], &["--iterate"]] {
            let mut mutants = cargo_tool("mutants")?;
            mutants
                .args(["--package", package, "--output"])
                .arg(&out)
                .args(rest)
                .args(stage);
            // cargo-mutants fails when there is one that was missed.
            if let Err(error) = run_command(&mut mutants)
                && !list.join("missed.txt").exists()
            {
                return Err(error);
            }
        }
        let count = |file: &str| fs::read_to_string(list.join(file)).map_or(0, |text| text.lines().count());
        let noticed = count("caught.txt") + count("timeout.txt") + count("previously_caught.txt");
        let all = noticed + count("missed.txt");
        let score = 100 * noticed / all.max(1);
        println!("{package}: tests notice {noticed} of {all} changes, {score} %");
        if score < LEAST {
            refused.push(format!("{package}: {score} %"));
        }
    }
    match refused.is_empty() {
        true => Ok(()),
        false => Err(format!("tests notice less than {LEAST} % of changes: {}", refused.join(", ")).into()),
    }
}
