//! Python scripts and the packages that they need.

use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::Result;

use super::background::Background;
use crate::cargo::target_dir;
use crate::venv::Environment;
use crate::workspace::root;

/// Timeout of a script: several times its duration on a slow machine.
const TIMEOUT: Duration = Duration::from_secs(300);

/// A Python environment, and a folder for the output of its scripts.
pub(crate) struct Python {
    /// The folder for output.
    pub(crate) dir: PathBuf,
    /// The packages.
    pub(crate) environment: Environment,
}

impl Python {
    /// The environment of this name in the target directory, with the packages of a complete list in
    /// `host-tests/vendor`.
    ///
    /// # Errors
    ///
    /// If Python or the package index is missing, or the packages do not fit together.
    pub(crate) fn with(name: &str, requirements: &str) -> Result<Self> {
        Self::of("python3", name, requirements)
    }

    /// The same with this Python.
    ///
    /// # Errors
    ///
    /// As [`with`](Self::with).
    pub(crate) fn of(python: impl AsRef<OsStr>, name: &str, requirements: &str) -> Result<Self> {
        let dir = target_dir()?.join("vendor").join(name);
        fs::create_dir_all(&dir)?;
        let environment = Environment::new(python, dir.join("python"))?;
        environment.install_listed(&scripts().join(requirements))?;
        Ok(Self { dir, environment })
    }

    /// Runs a script in `host-tests/vendor` with these arguments. Packages write logs to the working folder and to the
    /// home folder: both are the folder for output.
    ///
    /// # Errors
    ///
    /// If it fails or exceeds the timeout.
    pub(crate) fn run(&self, script: &str, args: &[&Path]) -> Result<()> {
        let mut python = self.environment.python();
        python.arg(scripts().join(script)).args(args);
        python.current_dir(&self.dir).env("HOME", &self.dir);
        Background::start(&mut python)?.succeed_within(TIMEOUT)
    }
}

fn scripts() -> PathBuf {
    root().join("host-tests/vendor")
}
