//! `cargo xtask features`: the protocol and bridge crates with their features, and each crate to publish with its oldest
//! compiler.

use anyhow::Result;

use crate::cargo::tool;
use crate::packages::PACKAGES;
use crate::process::run;

/// Clippy on the two crates with no feature, each alone, and all; the tests of `armwire` with no feature and each alone;
/// and a build of each crate with its oldest compiler.
///
/// # Errors
///
/// The first set that fails, or what [`oldest_compilers`] has to say.
pub(crate) fn each() -> Result<()> {
    clippy("--each-feature")?;
    test("--each-feature --exclude-all-features")?;
    oldest_compilers()
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

/// Each crate to publish and its tests compile with the oldest compiler that its `Cargo.toml` names.
///
/// # Errors
///
/// If one does not, or if there is no such compiler and rustup cannot install it.
fn oldest_compilers() -> Result<()> {
    // cargo-hack installs the compilers.
    let mut check = tool("hack check --rust-version --all-targets --all-features")?;
    run(check.args(PACKAGES.map(|package| format!("--package={package}"))))
}
