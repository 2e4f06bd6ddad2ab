//! `cargo xtask deny`: the dependencies, against `deny.toml`.

use std::iter;

use anyhow::Result;

use crate::cargo::tool;
use crate::examples::EXAMPLES;
use crate::process::{self, output};
use crate::workspace::ALONE;

/// The workspace in the root, as an argument of cargo.
const ROOT: &str = "--manifest-path=Cargo.toml";

/// An exception is for one of the workspaces.
const NOT_USED: &str = "-A license-exception-not-encountered";
/// Exceptions in `deny.toml` that only the workspace in the root uses.
const NOT_USED_ALONE: &str = "-A license-exception-not-encountered -A license-not-encountered -A unmatched-skip";

/// Checks licences and sources in each workspace, versions in all but the examples', and known vulnerabilities if the list
/// of those can be had.
///
/// # Errors
///
/// If there is a dependency that may not be used here. That the list cannot be had is told, and is no error.
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

/// Makes these checks in one workspace, which need not have use for some entries of `deny.toml`.
fn check(workspace: &str, not_used: &str, checks: &str) -> Result<()> {
    println!("{workspace}");
    process::run(&mut tool(&format!(
        "deny {workspace} --config deny.toml check {not_used} {checks}"
    ))?)
}

/// Checks known vulnerabilities in each workspace.
fn advisories() -> Result<()> {
    // The list is a git repository on another server than the dependencies.
    for (option, list) in [
        ("", "as it is now"),
        ("--offline", "as it was when it was fetched last"),
    ] {
        let check = |workspace| -> Result<()> {
            let check = format!("deny {option} {workspace} --config deny.toml check advisories");
            output(&mut tool(&check)?).map(drop)
        };
        match iter::once(ROOT).chain(ALONE).try_for_each(check) {
            Ok(()) => {
                println!("advisories ok, by the list {list}");
                return Ok(());
            }
            // A finding has a code in brackets, such as `vulnerability`. Other lines are about the list.
            Err(error) if error.to_string().contains("error[") => return Err(error),
            Err(_) => {}
        }
    }
    println!("advisories not checked: the list of RustSec cannot be fetched, and there is no copy of it");
    Ok(())
}
