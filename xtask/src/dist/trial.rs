//! The trial of a release: its archive, used without Rust.

use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result};

use crate::files::{empty_folder, only_entry};
use crate::process::run;
use crate::venv::Environment;
use crate::web;
use crate::workspace::root;

/// The search path of a machine without Rust.
const PATH: &str = "/usr/bin:/bin";
/// A program for Python that moves virtual arms.
const PROGRAM: &str = "without_hardware.py";

/// Unpacks an archive into this folder, checks its files, starts the command, moves virtual arms with the wheel, and opens
/// the page.
///
/// # Errors
///
/// The first of them that fails.
pub(super) fn run_all(archive: &Path, folder: &Path) -> Result<()> {
    empty_folder(folder)?;
    run(Command::new("tar").arg("-xzf").arg(archive).arg("-C").arg(folder))?;
    let release = only_entry(folder)?;
    let mut check = Command::new("sha256sum");
    check.args(["--check", "--quiet", "SHA256SUMS"]);
    run(check.current_dir(&release))?;
    run(Command::new(release.join("bin/armwire")).arg("--version"))?;
    try_wheel(&release.join("python"), folder)?;
    web::test_page(&release.join("web"))
}

fn try_wheel(wheels: &Path, folder: &Path) -> Result<()> {
    let environment = Environment::new("python3", folder.join("env"))?;
    environment.install([wheel(wheels)?.as_os_str(), OsStr::new("pytest")])?;
    run(environment.tool("armwire").arg("--version").env("PATH", PATH))?;
    // Beside the sources, Python would import them in place of the wheel.
    fs::copy(root().join("python/examples").join(PROGRAM), folder.join(PROGRAM))?;
    let mut pytest = environment.python();
    pytest.args(["-m", "pytest", "-q", PROGRAM]).env("PATH", PATH);
    run(pytest.current_dir(folder))
}

/// The wheel of the package, beside those of its plugins.
fn wheel(wheels: &Path) -> Result<PathBuf> {
    let files = fs::read_dir(wheels)?.map(|file| Ok(file?.path()));
    let files = files.collect::<Result<Vec<_>>>()?;
    let is_package = |file: &PathBuf| {
        file.file_name()
            .is_some_and(|name| name.to_string_lossy().starts_with("armwire-"))
    };
    let wheel = files.into_iter().find(is_package);
    wheel.with_context(|| format!("{} has no wheel of armwire", wheels.display()))
}
