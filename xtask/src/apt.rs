//! Programs that are packages of Debian.

use std::env;
use std::process::Command;

use anyhow::{Result, ensure};

use crate::installation::with_lock;
use crate::process::{output, run};

/// Installs the packages of these programs that are not on the path. Each program is followed by its packages, with
/// spaces between them.
///
/// # Errors
///
/// If a program is missing and cannot be installed. The error has the command that installs it.
pub(crate) fn require(programs: &[(&str, &str)]) -> Result<()> {
    let path = env::var_os("PATH").unwrap_or_default();
    let is_missing = |program: &str| !env::split_paths(&path).any(|folder| folder.join(program).is_file());
    let missing = programs.iter().filter(|(program, _)| is_missing(program));
    let packages: Vec<_> = missing.flat_map(|(_, packages)| packages.split(' ')).collect();
    ensure!(
        packages.is_empty() || install(&packages)?,
        "programs are missing; run `sudo apt-get install --no-install-recommends {}`",
        packages.join(" ")
    );
    Ok(())
}

/// Installs packages. Returns false without apt-get or the right to use it.
///
/// # Errors
///
/// If apt-get fails.
pub(crate) fn install(packages: &[&str]) -> Result<bool> {
    let is_root = output(Command::new("id").arg("-u")).is_ok_and(|id| id.trim() == "0");
    if !is_root || output(Command::new("apt-get").arg("--version")).is_err() {
        return Ok(false);
    }
    let apt = |words: &str, packages: &[&str]| {
        let mut apt = Command::new("apt-get");
        apt.args(words.split(' ')).args(packages);
        apt.env("DEBIAN_FRONTEND", "noninteractive");
        // `cargo run` set it to the compiler's libraries.
        run(apt.env_remove("LD_LIBRARY_PATH"))
    };
    with_lock(|| {
        apt("update", &[])?;
        apt("install --yes --no-install-recommends", packages)
    })?;
    Ok(true)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn programs_on_the_path_need_no_package() {
        require(&[("sh", "no-such-package"), ("ls", "no-such-package")]).unwrap();
    }
}
