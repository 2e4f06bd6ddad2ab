//! `cargo xtask features`: the protocol and bridge crates with every set of features, and with the oldest compiler.

use std::env;
use std::process::Command;

use crate::Result;
use crate::cargo_tool::cargo_tool;
use crate::process::{output, run as run_command};
use crate::workspace;

/// The oldest compiler that is supported, as in `Cargo.toml`.
const OLDEST: &str = env!("CARGO_PKG_RUST_VERSION");

/// Clippy on every set of features of the two crates, the tests of `armwire` with each set of up to two, and a build with
/// the oldest compiler.
///
/// With defmt, tests need a logger to link. The examples in the documentation are of Ling's messages, and not run here.
///
/// # Errors
///
/// The first set that fails, or what [`oldest_compiler`] has to say.
pub(crate) fn run() -> Result {
    let sets = ["--feature-powerset", "--skip", "default"];
    let mut clippy = cargo_tool("hack")?;
    clippy.args([
        "clippy",
        "--quiet",
        "--package",
        "armwire",
        "--package",
        "armwire-bridge",
    ]);
    run_command(clippy.args(sets).args(["--", "-D", "warnings"]))?;
    let mut test = cargo_tool("hack")?;
    test.args([
        "test",
        "--quiet",
        "--lib",
        "--tests",
        "--package",
        "armwire",
        "--depth",
        "2",
    ]);
    run_command(test.args(sets).args(["--skip", "defmt"]))?;
    oldest_compiler()
}

/// The two crates build with the oldest compiler that is supported.
///
/// # Errors
///
/// If it does not, or if there is no such compiler and rustup cannot install it.
fn oldest_compiler() -> Result {
    let rustc = env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let version = output(Command::new(rustc).arg("--version"))?;
    if version.starts_with(&format!("rustc {OLDEST}.")) {
        println!("all of this is done with the oldest compiler that is supported, {OLDEST}");
        return Ok(());
    }
    let mut install = Command::new("rustup");
    run_command(install.args([
        "toolchain",
        "install",
        OLDEST,
        "--profile",
        "minimal",
        "--no-self-update",
    ]))?;
    let mut check = Command::new("rustup");
    check.args(["run", OLDEST, "cargo", "check", "--all-targets", "--all-features"]);
    // `cargo run` put those of the other compiler there.
    check
        .env_remove("CARGO")
        .env_remove("RUSTC")
        .env_remove("LD_LIBRARY_PATH");
    run_command(
        check
            .args(["--package", "armwire", "--package", "armwire-bridge"])
            .current_dir(workspace::root()),
    )
}
