//! Python for 64-bit Arm: Debian's, on QEMU.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::Result;

use super::debian;
use super::emulator::Emulator;
use crate::cargo::target_dir;
use crate::files::empty_folder;
use crate::python::{build_tools, listed};

/// The release of Debian, and its version of Python.
const RELEASE: &str = "bookworm";
const VERSION: &str = "3.11";
/// The packages with Python, and the libraries that it and NumPy load.
const PACKAGES: [&str; 10] = [
    "python3.11-minimal",
    "libpython3.11-minimal",
    "libpython3.11-stdlib",
    "libc6",
    "libexpat1",
    "libffi8",
    "libgcc-s1",
    "libssl3",
    "libstdc++6",
    "zlib1g",
];
/// The packages that the tests of a wheel need.
const TEST_PACKAGES: [&str; 2] = ["numpy", "pytest"];
/// The systems whose wheels this Python loads: that of one built without zig, the oldest that ours support, and NumPy's.
const WHEELS: [&str; 3] = ["linux_aarch64", "manylinux_2_17_aarch64", "manylinux_2_28_aarch64"];

/// Python for 64-bit Arm, with packages.
pub(crate) struct Arm64Python {
    emulator: Emulator,
    program: PathBuf,
    packages: PathBuf,
}

impl Arm64Python {
    /// Python with this wheel for 64-bit Arm, NumPy and pytest. It is downloaded once.
    ///
    /// # Errors
    ///
    /// If a download fails, or the wheel is for another system.
    pub(crate) fn with_wheel(wheel: &Path) -> Result<Self> {
        let folder = target_dir()?.join("platforms");
        let (system, packages) = (folder.join("arm64-python"), folder.join("arm64-packages"));
        debian::unpack(RELEASE, "arm64", &PACKAGES, &system)?;
        empty_folder(&packages)?;
        let mut options: Vec<_> = ["--only-binary=:all:", "--python-version", VERSION, "--target"]
            .map(Into::into)
            .into();
        options.push(packages.clone().into_os_string());
        options.extend(WHEELS.map(|system| format!("--platform={system}").into()));
        options.push(wheel.into());
        options.extend(listed(&TEST_PACKAGES)?.into_iter().map(Into::into));
        build_tools()?.install(options)?;
        Ok(Self {
            program: system.join("usr/bin").join(format!("python{VERSION}")),
            emulator: Emulator::qemu("aarch64", &system, &folder)?,
            packages,
        })
    }

    /// Python, which writes nothing beside the sources. It cannot start itself: this machine's system knows no emulator.
    pub(crate) fn command(&self) -> Command {
        let mut python = self.emulator.command(&self.program);
        python.arg("-B").env("PYTHONPATH", &self.packages);
        python
    }
}
