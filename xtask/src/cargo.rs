//! Cargo, and its subcommands from crates.io.

use std::env;
use std::path::PathBuf;
use std::process::Command;

use anyhow::{Context, Result};
use serde_json::Value;

use crate::process::{output, run};
use crate::workspace::{firmware, root};

/// The subcommands, with the version and the options for installing a missing one. Optimising the build of cargo-deny
/// takes minutes, and saves seconds. cargo-about compares the texts of licences, for minutes without optimisation.
const TOOLS: [(&str, &str); 8] = [
    ("about", "0.9.3 --features=cli"),
    ("cyclonedx", "0.5.9 --debug"),
    ("deny", "0.20.2 --debug"),
    ("fuzz", "0.13.2 --debug"),
    ("hack", "0.6.46 --debug"),
    ("mutants", "27.1.0 --debug"),
    ("nextest", "0.9.151 --debug"),
    ("semver-checks", "0.51.0 --debug"),
];

/// The cargo that runs this program, with these words as arguments, in the root of the workspace.
pub(crate) fn cargo(words: &str) -> Command {
    let mut cargo = Command::new(env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    cargo.args(words.split_whitespace()).current_dir(root());
    forget_our_package(&mut cargo);
    cargo
}

/// The same as typed in the folder of the firmware: cargo's configuration there has target, profiles and chip.
pub(crate) fn cargo_in_firmware(words: &str) -> Command {
    let mut cargo = cargo(words);
    // The environment would override the chip for probe-rs, and the board of the chip.
    cargo.env_remove("PROBE_RS_CHIP").env_remove("ARMWIRE_BOARD");
    cargo.current_dir(firmware());
    cargo
}

/// Removes the variables that `cargo run` set for this package: build scripts would notice a change and run again.
pub(crate) fn forget_our_package(command: &mut Command) {
    for (name, _) in env::vars_os() {
        let name = name.to_string_lossy();
        if name.starts_with("CARGO_PKG_") || name.starts_with("CARGO_MANIFEST_") {
            command.env_remove(&*name);
        }
    }
}

/// `cargo <words>`, where the first word names one of [`TOOLS`]. Installs it if it is missing.
///
/// # Errors
///
/// If it is missing and cannot be installed.
pub(crate) fn tool(words: &str) -> Result<Command> {
    let name = words.split(' ').next().unwrap_or_default();
    if output(&mut cargo(&format!("{name} --version"))).is_err() {
        let (_, version) = TOOLS
            .into_iter()
            .find(|(tool, _)| *tool == name)
            .with_context(|| format!("cargo-{name} has no version in TOOLS"))?;
        let mut install = cargo(&format!("install --locked cargo-{name}@{version}"));
        println!("cargo-{name} is missing; its installation takes some minutes");
        run(&mut install)?;
    }
    Ok(cargo(words))
}

/// The target directory, as set by `CARGO_TARGET_DIR` or cargo's configuration.
pub(crate) fn target_dir() -> Result<PathBuf> {
    let metadata = output(&mut cargo("metadata --no-deps --format-version 1"))?;
    let metadata: Value = serde_json::from_str(&metadata)?;
    let dir = metadata["target_directory"].as_str();
    Ok(dir.context("`cargo metadata` names no target directory")?.into())
}
