//! `cargo xtask semver`: whether what is public is still what the last release had.

use std::process::Command;

use anyhow::Result;

use crate::cargo::tool;
use crate::process::{self, output};
use crate::workspace::root;

/// Compares the protocol and bridge crates with the last release, which is the last tag `v…` before this commit.
///
/// # Errors
///
/// If they break what the release promised and have no new version that says so.
pub(crate) fn run() -> Result<()> {
    let mut tags = Command::new("git");
    tags.args(["tag", "--list", "v*", "--merged", "HEAD", "--sort=-version:refname"])
        .current_dir(root());
    let tags = output(&mut tags)?;
    let Some(release) = tags.lines().next() else {
        println!("there is no release to compare with yet: no tag v…");
        return Ok(());
    };
    let check = "semver-checks check-release --package armwire --package armwire-bridge --baseline-rev";
    process::run(tool(check)?.arg(release))
}
