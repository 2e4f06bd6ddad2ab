//! `cargo xtask recordings`: recordings of virtual arms in other programs.

mod dissectors;
mod mcap;

use anyhow::Result;

/// Runs every check.
///
/// # Errors
///
/// The first check that fails.
pub(crate) fn run_all() -> Result<()> {
    mcap::check()?;
    dissectors::check()
}
