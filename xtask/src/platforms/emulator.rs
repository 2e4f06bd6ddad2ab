//! Emulators of other processors and systems: QEMU's user mode, and Wine.

use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result};

use super::debian;
use crate::process::{output, run};
use crate::workspace::root;

/// The first major version of QEMU that has `TCGETS2`, which opens a serial port.
const QEMU: u32 = 11;
/// The release of Debian with that version.
const QEMU_RELEASE: &str = "trixie-backports";
/// A library that Rust's standard library needs, and Wine lacks before version 9.
const SHIM: &str = "bcryptprimitives";

/// A program that runs those of another system, with its arguments and environment.
#[derive(Clone)]
pub(crate) struct Emulator {
    words: Vec<OsString>,
    environment: Vec<(&'static str, OsString)>,
}

impl Emulator {
    /// No emulator: this machine runs the programs.
    pub(crate) fn none() -> Self {
        Self {
            words: Vec::new(),
            environment: Vec::new(),
        }
    }

    /// QEMU for this processor, with the libraries in a folder.
    ///
    /// # Errors
    ///
    /// If this machine has none that is new enough, and none can be downloaded.
    pub(super) fn qemu(processor: &str, libraries: &Path, tools: &Path) -> Result<Self> {
        let name = format!("qemu-{processor}");
        let is_new = output(Command::new(&name).arg("--version")).is_ok_and(|text| is_new_enough(&text));
        let program = match is_new {
            true => PathBuf::from(name),
            false => downloaded_qemu(tools)?.join(name),
        };
        Ok(Self {
            words: vec![program.into(), "-L".into(), libraries.into()],
            environment: Vec::new(),
        })
    }

    /// Wine with a configuration of its own in `folder`.
    ///
    /// # Errors
    ///
    /// If the library that it may lack cannot be compiled.
    pub(super) fn wine(folder: &Path) -> Result<Self> {
        let library = folder.join(SHIM).with_extension("dll");
        fs::create_dir_all(folder)?;
        let mut compile = Command::new("x86_64-w64-mingw32-gcc");
        compile.arg("-shared").arg("-o").arg(&library);
        compile.arg(root().join("xtask/src/platforms").join(SHIM).with_extension("c"));
        run(compile.arg("-ladvapi32"))?;
        Ok(Self {
            words: vec!["wine".into()],
            environment: vec![
                ("WINEPREFIX", folder.join("prefix").into()),
                ("WINEPATH", format!("Z:{}", folder.display()).into()),
                ("WINEDEBUG", "-all".into()),
            ],
        })
    }

    /// This program, in the root of the workspace.
    pub(super) fn command(&self, program: &Path) -> Command {
        let mut words = self.words.iter().map(OsString::as_os_str).chain([program.as_os_str()]);
        let mut command = Command::new(words.next().unwrap_or_default());
        command.args(words).current_dir(root());
        command.envs(self.environment.iter().map(|(name, value)| (name, value)));
        command
    }

    /// Makes this run of cargo start the programs that it builds for `target` by the emulator.
    pub(super) fn add_to<'a>(&self, cargo: &'a mut Command, target: &str) -> &'a mut Command {
        let runner = self.words.join(" ".as_ref());
        cargo.env(format!("CARGO_TARGET_{}_RUNNER", in_capitals(target)), runner);
        cargo.envs(self.environment.iter().map(|(name, value)| (name, value)))
    }
}

/// A target's name in the names of cargo's variables.
pub(super) fn in_capitals(target: &str) -> String {
    target.to_uppercase().replace('-', "_")
}

/// The folder with QEMU's programs, downloaded once.
fn downloaded_qemu(tools: &Path) -> Result<PathBuf> {
    let folder = tools.join("qemu");
    let architecture = output(Command::new("dpkg").arg("--print-architecture"))?;
    debian::unpack(QEMU_RELEASE, architecture.trim(), &["qemu-user"], &folder)
        .with_context(|| format!("QEMU {QEMU} or newer is needed"))?;
    Ok(folder.join("usr/bin"))
}

/// Returns true if the output of `--version` has a version that serves.
fn is_new_enough(text: &str) -> bool {
    let version = text.split_once("version ").map(|(_, rest)| rest);
    let major = version.and_then(|version| version.split('.').next()?.parse::<u32>().ok());
    major.is_some_and(|major| major >= QEMU)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn old_versions_of_qemu_do_not_serve() {
        for (text, serves) in [
            ("qemu-aarch64 version 11.1.3 (Debian 1:11.1.3+ds-1)", true),
            ("qemu-aarch64 version 7.2.0", false),
            ("qemu-arm version 10.0.2 (Debian 1:10.0.2+ds-2)", false),
            ("", false),
        ] {
            assert_eq!(is_new_enough(text), serves, "{text}");
        }
    }
}
