//! `cargo xtask features`: the protocol and bridge crates with their features, and the crates to publish with the oldest
//! compiler.

use std::env;
use std::process::Command;

use anyhow::Result;

use crate::cargo::tool;
use crate::packages::PACKAGES;
use crate::process::{output, run};

/// The oldest compiler that is supported, as in `Cargo.toml`.
const OLDEST: &str = env!("CARGO_PKG_RUST_VERSION");

/// Clippy on the two crates with no feature, each alone, and all; the tests of `armwire` with no feature and each alone;
/// and a build with the oldest compiler.
///
/// # Errors
///
/// The first set that fails, or what [`oldest_compiler`] has to say.
pub(crate) fn each() -> Result<()> {
    clippy("--each-feature")?;
    test("--each-feature --exclude-all-features")?;
    oldest_compiler()
}

/// Clippy on the two crates with every set of features, and the tests of `armwire` with each set of up to two.
///
/// # Errors
///
/// The first set that fails.
pub(crate) fn every_set() -> Result<()> {
    clippy("--feature-powerset")?;
    test("--feature-powerset --depth 2")
}

fn clippy(sets: &str) -> Result<()> {
    run(&mut tool(&format!(
        "hack clippy --quiet --package armwire --package armwire-bridge {sets} --skip default -- -D warnings"
    ))?)
}

/// With defmt, tests need a logger to link. The examples in the documentation are of Ling's messages, and not run here.
fn test(sets: &str) -> Result<()> {
    run(&mut tool(&format!(
        "hack test --quiet --lib --tests --package armwire {sets} --skip default --skip defmt"
    ))?)
}

/// The crates to publish and their tests compile with the oldest compiler that is supported.
///
/// # Errors
///
/// If it does not, or if there is no such compiler and rustup cannot install it.
fn oldest_compiler() -> Result<()> {
    let rustc = env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let version = output(Command::new(rustc).arg("--version"))?;
    if version.starts_with(&format!("rustc {OLDEST}.")) {
        println!("all of this is done with the oldest compiler that is supported, {OLDEST}");
        return Ok(());
    }
    // cargo-hack installs the compiler.
    let mut check = tool("hack check --rust-version --all-targets --all-features")?;
    run(check.args(PACKAGES.map(|package| format!("--package={package}"))))
}
