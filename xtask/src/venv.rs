//! Virtual environments of Python.

use std::env;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::Result;

use crate::apt;
use crate::cargo::forget_our_package;
use crate::process::{output, run};

/// A virtual environment.
pub(crate) struct Environment {
    folder: PathBuf,
}

impl Environment {
    /// The environment in this folder. A missing or incomplete one is created.
    ///
    /// # Errors
    ///
    /// If Python or its `venv` is missing.
    pub(crate) fn new(python: impl AsRef<OsStr>, folder: PathBuf) -> Result<Self> {
        let environment = Self { folder };
        if !environment.has_pip() {
            let python = python.as_ref();
            // In Debian the `venv` of `python3` is a package of its own.
            if python == "python3" && output(Command::new(python).args(["-c", "import ensurepip, venv"])).is_err() {
                apt::install(&["python3-venv"])?;
            }
            run(Command::new(python)
                .args(["-m", "venv", "--clear"])
                .arg(&environment.folder))?;
        }
        Ok(environment)
    }

    /// True if the environment is complete: pip is installed last.
    fn has_pip(&self) -> bool {
        output(self.python().args(["-m", "pip", "--version"])).is_ok()
    }

    /// Installs what these arguments of `pip install` name.
    ///
    /// # Errors
    ///
    /// If pip fails.
    pub(crate) fn install<Arg: AsRef<OsStr>>(&self, args: impl IntoIterator<Item = Arg>) -> Result<()> {
        let mut pip = self.python();
        pip.args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check"]);
        run(pip.args(args))
    }

    /// Installs the packages of a requirements file, without any that are not listed.
    ///
    /// # Errors
    ///
    /// If pip fails.
    pub(crate) fn install_listed(&self, requirements: &Path) -> Result<()> {
        self.install([OsStr::new("--no-deps"), "--requirement".as_ref(), requirements.as_ref()])
    }

    /// Python, which writes nothing beside the sources.
    pub(crate) fn python(&self) -> Command {
        let mut python = self.tool("python");
        python.arg("-B");
        python
    }

    /// A program of this environment, with the others on its path.
    pub(crate) fn tool(&self, name: &str) -> Command {
        let bin = self.folder.join("bin");
        let mut tool = Command::new(bin.join(name));
        let mut path = bin.into_os_string();
        if let Some(others) = env::var_os("PATH") {
            path.push(":");
            path.push(others);
        }
        tool.env("PATH", path).env("VIRTUAL_ENV", &self.folder);
        forget_our_package(&mut tool);
        tool
    }

    /// The path of a program of this environment.
    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.join("bin").join(name)
    }
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::os::unix::fs::symlink;

    use super::*;

    #[test]
    fn environment_without_pip_is_incomplete() {
        let folder = env::temp_dir().join(format!("armwire-venv-{}", std::process::id()));
        let environment = Environment { folder: folder.clone() };
        assert!(!environment.has_pip());
        fs::create_dir_all(folder.join("bin")).unwrap();
        for (program, is_complete) in [("/bin/false", false), ("/bin/true", true)] {
            symlink(program, environment.path("python")).unwrap();
            assert_eq!(environment.has_pip(), is_complete, "{program}");
            fs::remove_file(environment.path("python")).unwrap();
        }
        fs::remove_dir_all(folder).unwrap();
    }
}
