//! `cargo xtask no-panic`: the link test that the protocol and bridge crates have no path to a panic and do not allocate.

use std::process::Command;

use crate::Result;
use crate::image::TARGET;
use crate::process::{output, run as run_command};
use crate::toolchain::Toolchain;
use crate::workspace;

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

/// What must not link, and what the linker or the compiler says then.
const REFUSALS: [(&str, &str); 2] = [
    ("prove-panic", "undefined symbol: a_path_to_a_panic_is_left"),
    ("prove-alloc", "no global memory allocator found"),
];

/// Links the test with every set of features, and then with a path to a panic and with an allocation, which must fail.
///
/// # Errors
///
/// If there is a path to a panic or an allocation, or if the test would not find one.
pub(crate) fn run() -> Result {
    let toolchain = Toolchain::find(&TARGETS)?;
    for target in TARGETS {
        for features in FEATURES {
            run_command(&mut link(toolchain, target, features)?)?;
        }
        for (features, refusal) in REFUSALS {
            match output(&mut link(toolchain, target, features)?) {
                Err(error) if error.to_string().contains(refusal) => {}
                Err(error) => return Err(format!("`{features}` failed to link, but not as it should: {error}").into()),
                Ok(_) => return Err(format!("`{features}` links, and must not").into()),
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
    let mut cargo = toolchain.cargo("build", target)?;
    cargo
        .args(["--release", "--quiet", "--bin", "no-panic"])
        .args(["--no-default-features", &format!("--features={features}")])
        .current_dir(workspace::root().join("host-tests/no-panic"));
    Ok(cargo)
}
