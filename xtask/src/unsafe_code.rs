//! `cargo xtask unsafe-code`: the crates that say so have no `unsafe` in them.

use std::fs;

use crate::Result;
use crate::workspace;

/// The packages that are not allowed to have it. Firmware is.
const PACKAGES: [&str; 5] = [
    "armwire",
    "armwire-bridge",
    "armwire-sim",
    "armwire-virtual-board",
    "armwire-cli",
];

/// What the compiler holds a crate to, and what cannot be taken back further down.
const FORBID: &str = "\n#![forbid(unsafe_code)]\n";

/// Checks that every library and program of these packages forbids it.
///
/// # Errors
///
/// The first that does not.
pub(crate) fn run() -> Result {
    let metadata = workspace::metadata(&["--no-deps"])?;
    let packages = metadata["packages"]
        .as_array()
        .ok_or("`cargo metadata` names no packages")?;
    for name in PACKAGES {
        let package = packages.iter().find(|package| package["name"] == name);
        let targets = package.and_then(|package| package["targets"].as_array());
        let targets = targets.ok_or_else(|| format!("there is no package `{name}`"))?;
        for target in targets {
            let is_shipped = target["kind"]
                .as_array()
                .is_some_and(|kinds| kinds.iter().any(|kind| kind == "lib" || kind == "bin"));
            let root = target["src_path"]
                .as_str()
                .ok_or("`cargo metadata` names no file of a target")?;
            if is_shipped && !fs::read_to_string(root)?.contains(FORBID) {
                return Err(format!("{root} does not say {}", FORBID.trim()).into());
            }
        }
    }
    println!("unsafe code is forbidden in {}", PACKAGES.join(", "));
    Ok(())
}
