//! A release: its commit, its folders, and how its programs are built.

use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Result, ensure};

use super::folder::{cargo_home, sysroot};
use super::system::{HERE, System};
use crate::cargo::target_dir;
use crate::process::{output, run};
use crate::python;
use crate::toolchain::rustc_property;
use crate::workspace::root;

const VERSION: &str = env!("CARGO_PKG_VERSION");
/// Source folder recorded in the programs.
pub(super) const SOURCES: &str = "/armwire";

/// A release for every system.
pub(super) struct Release {
    pub(super) commit: String,
    /// The time of the commit, in seconds since 1970.
    pub(super) time: String,
    /// `target/dist`.
    pub(super) dist: PathBuf,
}

impl Release {
    pub(super) fn new() -> Result<Self> {
        check_tree("a release needs a commit, and there are uncommitted changes")?;
        ensure!(
            rustc_property("host")? == HERE.target,
            "a release is made on {}",
            HERE.target
        );
        Ok(Self {
            commit: git("rev-parse HEAD")?,
            time: git("log -1 --format=%ct")?,
            dist: target_dir()?.join("dist"),
        })
    }

    /// The folder of the release for this system, in `dist` of this or another checkout. The archive is beside it.
    pub(super) fn folder_in(dist: &Path, system: System) -> PathBuf {
        dist.join(format!("armwire-{VERSION}-{}", system.target))
    }

    pub(super) fn folder(&self, system: System) -> PathBuf {
        Self::folder_in(&self.dist, system)
    }

    /// The built command for this system.
    pub(super) fn command(&self, system: System) -> PathBuf {
        let folder = self.build_dir().join(system.target).join("release");
        folder.join(system.program())
    }

    /// The folder of the built wheels, of every system.
    pub(super) fn wheels(&self) -> PathBuf {
        self.build_dir().join(python::WHEELS)
    }

    /// Runs a command of this program, whose builds are [reproducible](Self::reproducible).
    pub(super) fn xtask(&self, words: &[&str]) -> Result<()> {
        let mut xtask = Command::new(env::current_exe()?);
        run(self.reproducible(xtask.args(words))?)
    }

    /// Copies files of the commit, or all of them if none are named, into a folder.
    pub(super) fn extract(&self, files: &str, folder: &Path) -> Result<()> {
        fs::create_dir_all(folder)?;
        let archive = self.dist.join("sources.tar");
        let words = format!("archive {} {files}", self.commit);
        run(git_command(words.trim_end()).arg("-o").arg(&archive))?;
        run(Command::new("tar").arg("-xf").arg(archive).arg("-C").arg(folder))
    }

    /// A separate target directory: the different flags would invalidate all other builds.
    pub(super) fn build_dir(&self) -> PathBuf {
        self.dist.join("build")
    }

    /// Makes cargo build in [`Self::build_dir`], and write no path and no time of this machine. The command is cargo or
    /// starts it.
    pub(super) fn reproducible<'a>(&self, command: &'a mut Command) -> Result<&'a mut Command> {
        let library = sysroot()?.join("lib/rustlib/src/rust");
        let build_dir = self.build_dir();
        // The last matching prefix applies.
        let flags = [
            (&*cargo_home()?, "/cargo"),
            (&library, &format!("/rustc/{}", rustc_property("commit-hash")?)),
            (root(), SOURCES),
            (&build_dir, &format!("{SOURCES}/target")),
        ]
        .map(|(from, to)| format!("--remap-path-prefix={}={to}", from.display()));
        Ok(command
            .env("CARGO_TARGET_DIR", self.build_dir())
            .env("CARGO_ENCODED_RUSTFLAGS", flags.join("\x1f"))
            .env("SOURCE_DATE_EPOCH", &self.time))
    }
}

/// Checks that no source file is new or changed.
pub(super) fn check_tree(otherwise: &str) -> Result<()> {
    let changes = git("status --porcelain")?;
    ensure!(changes.is_empty(), "{otherwise}:\n{changes}");
    Ok(())
}

pub(super) fn git_command(words: &str) -> Command {
    let mut git = Command::new("git");
    git.args(words.split(' ')).current_dir(root());
    git
}

fn git(words: &str) -> Result<String> {
    Ok(output(&mut git_command(words))?.trim_end().into())
}
