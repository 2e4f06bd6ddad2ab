//! `cargo xtask no-panic`: the link test that the protocol and bridge crates have no path to a panic.

use std::process::Command;

use crate::Result;
use crate::image::TARGET;
use crate::process::{output, run as run_command};
use crate::toolchain::Toolchain;
use crate::workspace;

/// What the linker says when there is a path to a panic.
const REFUSAL: &str = "undefined symbol: a_path_to_a_panic_is_left";

/// Links the test with each checksum that microcontrollers use, and once with a path to a panic, which must not link.
///
/// # Errors
///
/// If there is a path to a panic, or if the test would not find one.
pub(crate) fn run() -> Result {
    let toolchain = Toolchain::find(&[TARGET])?;
    for features in ["", "armwire/crc-table"] {
        run_command(&mut link(toolchain, features)?)?;
    }
    match output(&mut link(toolchain, "prove")?) {
        Err(error) if error.to_string().contains(REFUSAL) => {
            println!("no path to a panic; with one put in, linking fails as it must");
            Ok(())
        }
        Err(error) => Err(format!("linking a path to a panic failed, but not because of it: {error}").into()),
        Ok(_) => Err("a path to a panic was put in and linking did not fail".into()),
    }
}

fn link(toolchain: Toolchain, features: &str) -> Result<Command> {
    let mut cargo = toolchain.cargo("build", TARGET)?;
    cargo
        .args(["--release", &format!("--features={features}")])
        .current_dir(workspace::root().join("host-tests/no-panic"));
    Ok(cargo)
}
