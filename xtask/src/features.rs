//! `cargo xtask features`: the crates for programs with their features, and each published crate with its oldest
//! compiler.

use anyhow::Result;

use crate::cargo::tool;
use crate::packages::PACKAGES;
use crate::process::run;

/// Clippy on `armwire`, the bridge and the library for PCs with no feature, each alone, and all; the tests of `armwire` with
/// no feature and each alone; and a build of each crate with its oldest compiler.
///
/// # Errors
///
/// The first set that fails, or an error of [`oldest_compilers`].
pub(crate) fn each() -> Result<()> {
    clippy("--each-feature")?;
    test("--each-feature --exclude-all-features")?;
    oldest_compilers()
}

/// Clippy on these crates with every set of features, and the tests of `armwire` with each set of up to two.
///
/// # Errors
///
/// The first set that fails.
pub(crate) fn every_set() -> Result<()> {
    clippy("--feature-powerset --skip small-crc")?;
    test("--feature-powerset --depth 2")
}

fn clippy(sets: &str) -> Result<()> {
    run(&mut tool(&format!(
        "hack clippy --quiet --package armwire --package armwire-bridge --package armwire-host {sets} --skip default -- -D \
         warnings"
    ))?)
}

/// Without defmt, whose tests need a logger to link, and without the examples in the documentation, which need Ling.
fn test(sets: &str) -> Result<()> {
    run(&mut tool(&format!(
        "hack test --quiet --lib --tests --package armwire {sets} --skip default --skip defmt"
    ))?)
}

/// Compiles each published crate, without its tests, with the oldest compiler in its `Cargo.toml`.
///
/// # Errors
///
/// If a crate does not compile, or rustup cannot install the compiler.
fn oldest_compilers() -> Result<()> {
    // cargo-hack installs the compilers.
    let mut check = tool("hack check --rust-version --all-features")?;
    run(check.args(PACKAGES.map(|package| format!("--package={package}"))))
}
