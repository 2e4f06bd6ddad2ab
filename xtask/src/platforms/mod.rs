//! `cargo xtask platforms`: the command, the libraries and tests on other systems than this one, by emulators.
//!
//! docs/platforms.md has a row for each.

mod debian;
pub(crate) mod emulator;
pub(crate) mod python;
pub(crate) mod trial;

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::Result;

use self::emulator::{Emulator, in_capitals};
use self::python::Arm64Python;
use crate::apt;
use crate::c_library::{library_command, test_by};
use crate::cargo::{cargo, target_dir};
use crate::files::{empty_folder, only_entry};
use crate::process::run;
use crate::python::{build_tools, tool};
use crate::toolchain::cargo_for;
use crate::workspace::root;

/// The compiler for C on Windows, which links there, with its package.
pub(crate) const MINGW: (&str, &str) = ("x86_64-w64-mingw32-gcc", "gcc-mingw-w64-x86-64-win32");
/// Compilers for C, and Wine, with the packages that have them.
pub(crate) const TOOLS: [(&str, &str); 4] = [
    ("aarch64-linux-gnu-gcc", "gcc-aarch64-linux-gnu libc6-dev-arm64-cross"),
    (
        "arm-linux-gnueabihf-gcc",
        "gcc-arm-linux-gnueabihf libc6-dev-armhf-cross",
    ),
    MINGW,
    ("wine", "wine wine64"),
];
/// The tests of the library for PCs on another processor: those of moving arms take minutes there.
const HOST_TESTS: &str = "test --quiet --package armwire-host --lib --test ling --test reader";
/// A test that compares the turns of threads: an emulator has turns of its own.
const HOST_SKIPPED: [&str; 3] = ["--", "--skip", "arm::ling::wait::tests::call_has_its_turn"];
/// The unit tests on Windows. Those of `armwire-host` list devices, for which Wine lacks a function.
const WINDOWS_TESTS: &str = "test --quiet --package armwire --package armwire-bridge --package armwire-cli --lib";
/// Tests of decoding, which take minutes in Wine. The trial decodes recordings there.
const WINDOWS_SKIPPED: [&str; 3] = ["--", "--skip", "decode::"];
/// Tests of the package for Python: those that start no other Python, and have no times that an emulator exceeds.
const PYTHON_TESTS: [&str; 4] = [
    "examples/without_hardware.py",
    "tests/test_so101.py",
    "tests/test_xarm.py",
    "tests/test_alpha1.py",
];

/// Another system.
pub(crate) struct Platform {
    pub(crate) target: &'static str,
    /// The compiler for C, which links.
    pub(crate) gcc: &'static str,
    pub(crate) emulator: Emulator,
}

/// Uses the command on every system, the library for C under Linux, and the package for Python on 64-bit Arm, and runs
/// tests.
///
/// # Errors
///
/// The first of them that fails.
pub(crate) fn check() -> Result<()> {
    apt::require(&TOOLS)?;
    let folder = target_dir()?.join("platforms");
    run(&mut cargo("build --quiet --package armwire-cli"))?;
    let [aarch64, armv7, windows] = all(&folder)?;

    for linux in [&aarch64, &armv7] {
        trial::run_all(&linux.command()?, &linux.emulator, &folder)?;
        linux.try_c_library(&folder)?;
    }
    run(aarch64.cargo(HOST_TESTS)?.args(HOST_SKIPPED))?;
    aarch64.test_python_package(&folder)?;
    trial::run_all(&windows.command()?, &windows.emulator, &folder)?;
    run(windows.cargo(WINDOWS_TESTS)?.args(WINDOWS_SKIPPED))
}

/// The systems, in the order of docs/platforms.md.
///
/// # Errors
///
/// If an emulator is missing and cannot be downloaded.
pub(crate) fn all(folder: &Path) -> Result<[Platform; 3]> {
    Ok([
        Platform {
            target: "aarch64-unknown-linux-gnu",
            gcc: "aarch64-linux-gnu-gcc",
            emulator: Emulator::qemu("aarch64", Path::new("/usr/aarch64-linux-gnu"), folder)?,
        },
        Platform {
            target: "armv7-unknown-linux-gnueabihf",
            gcc: "arm-linux-gnueabihf-gcc",
            emulator: Emulator::qemu("arm", Path::new("/usr/arm-linux-gnueabihf"), folder)?,
        },
        Platform {
            target: "x86_64-pc-windows-gnu",
            gcc: "x86_64-w64-mingw32-gcc",
            emulator: Emulator::wine(&folder.join("wine"))?,
        },
    ])
}

impl Platform {
    /// Cargo for this system.
    fn cargo(&self, words: &str) -> Result<Command> {
        let mut cargo = cargo_for(self.target, words)?;
        self.set_linker(&mut cargo);
        self.emulator.add_to(&mut cargo, self.target);
        Ok(cargo)
    }

    /// Makes this run of cargo link by the compiler for C.
    fn set_linker(&self, cargo: &mut Command) {
        cargo.env(format!("CARGO_TARGET_{}_LINKER", in_capitals(self.target)), self.gcc);
    }

    /// The command, built.
    fn command(&self) -> Result<PathBuf> {
        run(&mut self.cargo("build --quiet --package armwire-cli")?)?;
        let is_windows = self.target.contains("windows");
        let name = if is_windows { "armwire.exe" } else { "armwire" };
        Ok(target_dir()?.join(self.target).join("debug").join(name))
    }

    /// Links the library for C with tests of it, and runs them.
    fn try_c_library(&self, folder: &Path) -> Result<()> {
        run(&mut self.cargo(&library_command(""))?)?;
        let library = target_dir()?.join(self.target).join("c/libarmwire_c.a");
        test_by(self.gcc, &library, &folder.join(self.target), |program| {
            self.emulator.command(program)
        })
    }

    /// Builds a wheel of the package for Python, and moves virtual arms with it. The released wheels are optimised, and
    /// linked for older systems.
    fn test_python_package(&self, folder: &Path) -> Result<()> {
        let wheels = folder.join("wheels");
        empty_folder(&wheels)?;
        let mut maturin = tool(&build_tools()?, "maturin");
        maturin.args("build --quiet --locked --profile dev --compatibility linux".split(' '));
        maturin.args(["--target", self.target, "--out"]).arg(&wheels);
        self.set_linker(&mut maturin);
        run(&mut maturin)?;
        let mut pytest = Arm64Python::with_wheel(&only_entry(&wheels)?)?.command();
        pytest
            .args(["-P", "-m", "pytest", "-p", "no:cacheprovider"])
            .args(PYTHON_TESTS);
        run(pytest.current_dir(root().join("python")))
    }
}
