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
/// What all of the rest is for, only the one in the root has to need.
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
    // Which versions of a crate the HALs need is theirs to say.
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
            // What is found has a code in brackets, such as vulnerability. All else is about the list.
            Err(error) if error.to_string().contains("error[") => return Err(error),
            Err(_) => {}
        }
    }
    println!("advisories not checked: the list of RustSec cannot be fetched, and there is no copy of it");
    Ok(())
}
