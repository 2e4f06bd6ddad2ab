//! `cargo xtask no-panic`: the link test that the protocol and bridge crates have no path to a panic and do not allocate.

use std::process::Command;

use anyhow::{Result, bail};

use crate::image::TARGET;
use crate::process::{self, output};
use crate::toolchain::Toolchain;
use crate::workspace::root;

/// Cortex-M0, and Cortex-M4.
const TARGETS: [&str; 2] = ["thumbv6m-none-eabi", TARGET];

/// Every set of protocols. The bridge has two of them.
const FEATURES: [&str; 11] = [
    "ling",
    "ling-legacy",
    "xarm",
    "alpha1",
    "ling-legacy,xarm",
    "ling,alpha1",
    "xarm,alpha1",
    "ling-legacy,xarm,alpha1",
    "bridge",
    "bridge,xarm",
    "bridge,ling-legacy",
];

/// The programs that must not link, and the message of linker or compiler.
const REFUSALS: [(&str, &str); 2] = [
    ("prove-panic", "undefined symbol: a_path_to_a_panic_is_left"),
    ("prove-alloc", "no global memory allocator found"),
];

/// Links the test with every set of features, and then with a path to a panic and with an allocation, which must fail.
///
/// # Errors
///
/// If there is a path to a panic or an allocation, or if the test would not find one.
pub(crate) fn run() -> Result<()> {
    let toolchain = Toolchain::find(&TARGETS)?;
    for target in TARGETS {
        for features in FEATURES {
            process::run(&mut link(toolchain, target, features)?)?;
        }
        for (features, refusal) in REFUSALS {
            match output(&mut link(toolchain, target, features)?) {
                Err(error) if error.to_string().contains(refusal) => {}
                Err(error) => bail!("`{features}` failed to link, but not as it should: {error}"),
                Ok(_) => bail!("`{features}` links, and must not"),
            }
        }
        println!(
            "{target}: no path to a panic and no allocation in {} sets of features; with one put in, linking fails",
            FEATURES.len()
        );
    }
    Ok(())
}

/// The command that links the test.
fn link(toolchain: Toolchain, target: &str, features: &str) -> Result<Command> {
    let mut link = toolchain.cargo("build --release --quiet --bin no-panic --no-default-features", target)?;
    link.args(["--features", features])
        .current_dir(root().join("host-tests/no-panic"));
    Ok(link)
}
