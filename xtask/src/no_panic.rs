//! `cargo xtask no-panic`: a link test that the protocol and bridge crates neither panic nor allocate.

use std::process::Command;

use anyhow::{Result, bail};

use crate::board::TARGET;
use crate::cargo::target_dir;
use crate::parallel::for_each;
use crate::process::output;
use crate::toolchain::cargo_for;
use crate::workspace::root;

/// Cortex-M0, and Cortex-M4.
const TARGETS: [&str; 2] = ["thumbv6m-none-eabi", TARGET];

/// Each protocol alone and all together, Ling's with its smaller checksum, too, without and with the adapter, which always
/// has two of them.
const FEATURES: [&str; 8] = [
    "ling",
    "ling,small-crc",
    "ling-legacy",
    "xarm",
    "alpha1",
    "ling-legacy,xarm,alpha1",
    "bridge",
    "bridge,ling-legacy,xarm",
];

/// Features whose program must not link, with the message of linker or compiler.
const REFUSALS: [(&str, &str); 2] = [
    ("prove-panic", "undefined symbol: a_path_to_a_panic_is_left"),
    ("prove-alloc", "no global memory allocator found"),
];

/// Links the test with these sets of features, and then with an added panic and an added allocation, which must fail.
///
/// # Errors
///
/// If the crates can panic or allocate, or if the test does not detect an added panic or allocation.
pub(crate) fn run() -> Result<()> {
    for_each(TARGETS, check).map(drop)
}

fn check(target: &str) -> Result<()> {
    for features in FEATURES {
        output(&mut link(target, features)?)?;
    }
    for (features, refusal) in REFUSALS {
        match output(&mut link(target, features)?) {
            Err(error) if error.to_string().contains(refusal) => {}
            Err(error) => bail!("`{features}` failed to link for another reason: {error}"),
            Ok(_) => bail!("`{features}` links, but must not"),
        }
    }
    println!(
        "{target}: no panic and no allocation in {} sets of features; an added one fails to link",
        FEATURES.len()
    );
    Ok(())
}

/// The command that links the test. Each target has a target directory, which cargo would lock.
fn link(target: &str, features: &str) -> Result<Command> {
    let build = "build --profile no-panic --quiet --bin no-panic --no-default-features --features link-test";
    let mut link = cargo_for(target, build)?;
    link.args(["--features", features])
        .env("CARGO_TARGET_DIR", target_dir()?.join("no-panic").join(target))
        .current_dir(root().join("host-tests/benches"));
    Ok(link)
}
