//! Python and its packages.

use std::fs;
use std::path::PathBuf;
use std::process::Command;

use crate::Result;
use crate::process::run;
use crate::workspace;

/// A Python environment, and a folder for what is left behind by what runs in it.
pub(super) struct Python {
    /// That folder.
    pub(super) dir: PathBuf,
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
    pub(super) fn with(name: &str, requirements: &str) -> Result<Self> {
        let dir = workspace::target_dir()?.join("vendor").join(name);
        fs::create_dir_all(&dir)?;
        let environment = dir.join("python");
        let python = environment.join("bin/python");
        let scripts = workspace::root().join("host-tests/vendor");
        if !python.exists() {
            println!("making a Python environment in {}", environment.display());
            run(Command::new("python3").args(["-m", "venv"]).arg(&environment))?;
        }
        println!("installing the packages of {requirements}");
        let mut pip = Command::new(&python);
        pip.args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check"]);
        run(pip.args(["--no-deps", "--requirement"]).arg(scripts.join(requirements)))?;
        Ok(Self { dir, python, scripts })
    }

    /// A script in `host-tests/vendor`, ready to run. Packages write logs to the folder they run in and to the home
    /// folder, and Python is to write nothing beside the script.
    pub(super) fn script(&self, name: &str) -> Command {
        let mut script = Command::new(&self.python);
        script.arg("-B").arg(self.scripts.join(name));
        script.current_dir(&self.dir).env("HOME", &self.dir);
        script
    }
}
