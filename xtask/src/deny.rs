//! `cargo xtask deny`: checks the dependencies against `deny.toml`.

use std::iter;

use anyhow::Result;

use crate::cargo::tool;
use crate::examples::EXAMPLES;
use crate::process::{self, output};
use crate::workspace::ALONE;

/// The workspace in the root, as an argument of cargo.
const ROOT: &str = "--manifest-path=Cargo.toml";

/// Each exception is needed by some of the workspaces only.
const NOT_USED: &str = "-A license-exception-not-encountered";
/// Exceptions in `deny.toml` that only the workspace in the root uses.
const NOT_USED_ALONE: &str = "-A license-exception-not-encountered -A license-not-encountered -A unmatched-skip";

/// Checks licences and sources in each workspace, versions in all but the examples', and known vulnerabilities.
///
/// # Errors
///
/// If a dependency is refused. A missing list of vulnerabilities is printed, and is not an error.
pub(crate) fn run() -> Result<()> {
    check(ROOT, NOT_USED, "licenses bans sources")?;
    for workspace in ALONE {
        check(workspace, NOT_USED_ALONE, "licenses bans sources")?;
    }
    // The HALs determine the versions of these crates.
    for (example, _) in EXAMPLES {
        let workspace = format!("--manifest-path=examples/{example}/Cargo.toml");
        check(&workspace, NOT_USED_ALONE, "licenses sources")?;
    }
    advisories()
}

/// Runs these checks in one workspace, which may leave some entries of `deny.toml` unused.
fn check(workspace: &str, not_used: &str, checks: &str) -> Result<()> {
    process::run(&mut tool(&format!(
        "deny {workspace} --config deny.toml check {not_used} {checks}"
    ))?)
}

/// Checks known vulnerabilities in each workspace.
fn advisories() -> Result<()> {
    // The list is a git repository, on another server than the dependencies.
    for (option, list) in [("", "of today"), ("--offline", "of the last download")] {
        let check = |workspace| -> Result<()> {
            let check = format!("deny {option} {workspace} --config deny.toml check advisories");
            output(&mut tool(&check)?).map(drop)
        };
        match iter::once(ROOT).chain(ALONE).try_for_each(check) {
            Ok(()) => {
                println!("advisories ok, with the list {list}");
                return Ok(());
            }
            // A finding has a code in brackets, such as `vulnerability`. Other lines are about the list.
            Err(error) if error.to_string().contains("error[") => return Err(error),
            Err(_) => {}
        }
    }
    println!("advisories not checked: RustSec's list cannot be downloaded, and there is no copy");
    Ok(())
}
