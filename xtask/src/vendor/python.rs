//! Python and its packages.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use anyhow::Result;

use super::background::Background;
use crate::cargo::target_dir;
use crate::process::run;
use crate::venv;
use crate::workspace::root;

/// Timeout of a script: several times its duration on a slow machine.
const TIMEOUT: Duration = Duration::from_secs(300);

/// A Python environment, and a folder for the output of its scripts.
pub(crate) struct Python {
    /// The folder for output.
    pub(crate) dir: PathBuf,
    python: PathBuf,
    scripts: PathBuf,
}

impl Python {
    /// The environment of this name in the target directory, with the packages of a list in `host-tests/vendor`. The
    /// list is complete: dependencies that are not in it are not installed.
    ///
    /// # Errors
    ///
    /// If Python or the package index is not there, or the packages do not fit.
    pub(crate) fn with(name: &str, requirements: &str) -> Result<Self> {
        let dir = target_dir()?.join("vendor").join(name);
        fs::create_dir_all(&dir)?;
        let environment = dir.join("python");
        let python = environment.join("bin/python");
        let scripts = root().join("host-tests/vendor");
        venv::make(Path::new("python3"), &environment)?;
        println!("installing the packages of {requirements}");
        let mut pip = Command::new(&python);
        pip.args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check"]);
        run(pip.args(["--no-deps", "--requirement"]).arg(scripts.join(requirements)))?;
        Ok(Self { dir, python, scripts })
    }

    /// Runs a script in `host-tests/vendor` with these arguments. Packages write logs to the folder they run in and to the
    /// home folder, and Python is to write nothing beside the script.
    ///
    /// # Errors
    ///
    /// If it fails, or takes too long.
    pub(crate) fn run(&self, script: &str, args: &[&Path]) -> Result<()> {
        let mut command = Command::new(&self.python);
        command.arg("-B").arg(self.scripts.join(script)).args(args);
        command.current_dir(&self.dir).env("HOME", &self.dir);
        Background::start(&mut command)?.succeed_within(TIMEOUT)
    }
}
