//! Subcommands of cargo that come from crates.io.

use std::process::Command;

use crate::Result;
use crate::process::{cargo, output, run, shown};
use crate::workspace;

/// `cargo <name>` in the root of the workspace, to which arguments can be added. Installs it if it is missing.
///
/// # Errors
///
/// If it is missing and cannot be installed.
pub(crate) fn cargo_tool(name: &str) -> Result<Command> {
    if output(cargo().args([name, "--version"])).is_err() {
        let mut install = cargo();
        install.args(["install", "--locked", &format!("cargo-{name}")]);
        println!(
            "cargo-{name} is missing: running `{}`, which takes some minutes",
            shown(&install)
        );
        run(&mut install)?;
    }
    let mut tool = cargo();
    tool.arg(name).current_dir(workspace::root());
    Ok(tool)
}
