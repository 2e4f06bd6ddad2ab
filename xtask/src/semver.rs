//! `cargo xtask semver`: compares the public API with the last release.

use std::process::Command;

use anyhow::Result;

use crate::cargo::tool;
use crate::process::{self, output};
use crate::workspace::root;

/// Compares the crates for programs with the last release: the last tag `v…` before this commit.
///
/// # Errors
///
/// If a crate has a breaking change and no new major version.
pub(crate) fn run() -> Result<()> {
    let mut tags = Command::new("git");
    tags.args(["tag", "--list", "v*", "--merged", "HEAD", "--sort=-version:refname"])
        .current_dir(root());
    let tags = output(&mut tags)?;
    let Some(release) = tags.lines().next() else {
        println!("no release to compare with: there is no tag v…");
        return Ok(());
    };
    let check =
        "semver-checks check-release --package armwire --package armwire-bridge --package armwire-host --baseline-rev";
    process::run(tool(check)?.arg(release))
}
