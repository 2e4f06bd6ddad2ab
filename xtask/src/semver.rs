//! `cargo xtask semver`: whether what is public is still what the last release had.

use std::process::Command;

use crate::Result;
use crate::cargo_tool::cargo_tool;
use crate::process::{output, run as run_command};
use crate::workspace;

/// Compares the protocol and bridge crates with the last release, which is the last tag `v…` before this commit.
///
/// # Errors
///
/// If they break what the release promised and have no new version that says so.
pub(crate) fn run() -> Result {
    let mut tags = Command::new("git");
    tags.args(["tag", "--list", "v*", "--merged", "HEAD", "--sort=-version:refname"])
        .current_dir(workspace::root());
    let tags = output(&mut tags)?;
    let Some(release) = tags.lines().next() else {
        println!("there is no release to compare with yet: no tag v…");
        return Ok(());
    };
    let mut check = cargo_tool("semver-checks")?;
    check.args(["check-release", "--package", "armwire", "--package", "armwire-bridge"]);
    run_command(check.args(["--baseline-rev", release]))
}
