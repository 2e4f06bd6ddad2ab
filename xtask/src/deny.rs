//! `cargo xtask deny`: the dependencies, against `deny.toml`.

use std::iter;

use crate::Result;
use crate::cargo_tool::cargo_tool;
use crate::process::{output, run as run_command};
use crate::workspace::ALONE;

/// The workspace in the root, as an argument of cargo.
const ROOT: &str = "--manifest-path=Cargo.toml";

/// An exception is for one of the workspaces.
const NOT_USED: &str = "license-exception-not-encountered";
/// What all of the rest is for, only the one in the root has to need.
const NOT_USED_ALONE: [&str; 3] = [NOT_USED, "license-not-encountered", "unmatched-skip"];

/// Checks licences, versions and sources in each workspace, and known vulnerabilities if the list of those can be had.
///
/// # Errors
///
/// If there is a dependency that may not be used here. That the list cannot be had is told, and is no error.
pub(crate) fn run() -> Result {
    check(ROOT, &[NOT_USED])?;
    for workspace in ALONE {
        check(workspace, &NOT_USED_ALONE)?;
    }
    advisories()
}

/// Checks licences, versions and sources in one workspace, which need not have use for these entries of `deny.toml`.
fn check(workspace: &str, not_used: &[&str]) -> Result {
    println!("{workspace}");
    let mut deny = cargo_tool("deny")?;
    deny.args([workspace, "--config", "deny.toml", "check"]);
    deny.args(not_used.iter().flat_map(|entry| ["-A", entry]));
    run_command(deny.args(["licenses", "bans", "sources"]))
}

/// Checks known vulnerabilities in each workspace.
fn advisories() -> Result {
    // The list is a git repository on another server than the dependencies.
    for (option, list) in [
        (None, "as it is now"),
        (Some("--offline"), "as it was when it was fetched last"),
    ] {
        let check = |workspace| -> Result {
            let mut deny = cargo_tool("deny")?;
            deny.args(option).args([workspace, "--config", "deny.toml"]);
            output(deny.args(["check", "advisories"])).map(drop)
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
