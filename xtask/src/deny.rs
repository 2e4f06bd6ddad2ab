//! `cargo xtask deny`: the dependencies, against `deny.toml`.

use crate::Result;
use crate::cargo_tool::cargo_tool;
use crate::process::{output, run as run_command};

/// The workspaces beside the one in the root.
const WORKSPACES: [&str; 2] = ["host-tests/no-panic/Cargo.toml", "host-tests/fuzz/Cargo.toml"];

/// An exception is for one of the workspaces.
const NOT_USED: &str = "license-exception-not-encountered";

/// Checks licences, versions and sources, and known vulnerabilities if the list of those can be had.
///
/// # Errors
///
/// If there is a dependency that may not be used here. That the list cannot be had is told, and is no error.
pub(crate) fn run() -> Result {
    run_command(cargo_tool("deny")?.args(["check", "-A", NOT_USED, "licenses", "bans", "sources"]))?;
    for workspace in WORKSPACES {
        let mut deny = cargo_tool("deny")?;
        deny.args(["--manifest-path", workspace, "--config", "deny.toml"]);
        // What is twice there is twice in the whole, or is a tool's own.
        deny.args([
            "check",
            "-A",
            NOT_USED,
            "-A",
            "license-not-encountered",
            "licenses",
            "sources",
        ]);
        run_command(&mut deny)?;
    }
    // The list is a git repository on another server than the dependencies.
    let fetched = output(cargo_tool("deny")?.args(["check", "advisories"]));
    let kept = output(cargo_tool("deny")?.args(["--offline", "check", "advisories"]));
    for (list, checked) in [("as it is now", fetched), ("as it was when it was fetched last", kept)] {
        match checked {
            Ok(_) => {
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
