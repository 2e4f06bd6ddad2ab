//! Debian's packages.

use std::process::Command;

use anyhow::Result;

use crate::process::{output, run, shown};

/// Installs packages, where apt-get is there and may do so. Returns whether it was.
///
/// # Errors
///
/// If apt-get fails.
pub(crate) fn install(packages: &[&str]) -> Result<bool> {
    let is_root = output(Command::new("id").arg("-u")).is_ok_and(|id| id.trim() == "0");
    if !is_root || output(Command::new("apt-get").arg("--version")).is_err() {
        return Ok(false);
    }
    let mut update = Command::new("apt-get");
    update.arg("update");
    let mut install = Command::new("apt-get");
    install
        .args(["install", "--yes", "--no-install-recommends"])
        .args(packages);
    for command in [&mut update, &mut install] {
        println!("running `{}`", shown(command));
        run(command
            .env("DEBIAN_FRONTEND", "noninteractive")
            .env_remove("LD_LIBRARY_PATH"))?;
    }
    Ok(true)
}
