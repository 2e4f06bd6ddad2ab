//! `cargo xtask examples`: the programs for microcontrollers in `examples`, and the protocol that is not ours. The
//! RP2040's program runs on an emulated chip.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::Result;

use crate::apt;
use crate::cargo::{cargo, target_dir};
use crate::process::run;
use crate::toolchain::cargo_for;
use crate::workspace::root;

/// The examples by folder, and the target of each.
pub(crate) const EXAMPLES: [(&str, &str); 5] = [
    ("esp32c3", "riscv32imc-unknown-none-elf"),
    ("nrf52840", "thumbv7em-none-eabihf"),
    (OWN_ARM, "thumbv6m-none-eabi"),
    ("rp2040", "thumbv6m-none-eabi"),
    ("stm32f303", "thumbv7em-none-eabihf"),
];
/// A library, whose tests run on this machine.
const OWN_ARM: &str = "own-arm";
/// Programs for JavaScript, and their packages.
pub(crate) const NODE: [(&str, &str); 2] = [("node", "nodejs"), ("npm", "npm")];
/// Folder of the emulator's package, and the image in the target directory.
const EMULATOR: &str = "rp2040/emulator";
const IMAGE: &str = "thumbv6m-none-eabi/release/armwire-rp2040";

/// Checks and links each example with its locked dependencies, and runs the tests of [`OWN_ARM`], and the RP2040's
/// program with a virtual arm.
///
/// # Errors
///
/// The first example that fails, or a missing tool that cannot be installed.
pub(crate) fn check() -> Result<()> {
    for (example, target) in EXAMPLES {
        println!("{example} for {target}");
        let folder = folder(example);
        run(cargo("fmt --check").current_dir(&folder))?;
        let mut clippy = cargo_for(target, "clippy --release --locked --quiet")?;
        run(clippy.args(["--", "-D", "warnings"]).current_dir(&folder))?;
        let mut build = cargo_for(target, "build --release --locked --quiet")?;
        run(build.current_dir(&folder))?;
    }
    test(OWN_ARM)?;
    emulate(&target_dir()?.join(IMAGE))
}

/// Checks and runs the tests of an example.
fn test(example: &str) -> Result<()> {
    for words in [
        "clippy --all-targets --locked --quiet -- -D warnings",
        "test --locked --quiet",
    ] {
        let mut command = cargo(words);
        command.env("CARGO_TARGET_DIR", target_dir()?);
        run(command.current_dir(folder(example)))?;
    }
    Ok(())
}

/// Runs the RP2040's image on an emulated chip, with `armwire sim` on its UART.
fn emulate(image: &Path) -> Result<()> {
    install_emulator()?;
    run(&mut cargo("build --quiet --package armwire-cli"))?;
    let armwire = target_dir()?.join("debug/armwire");
    run(Command::new("node")
        .args([Path::new("run.mjs"), &armwire, image])
        .current_dir(folder(EMULATOR)))
}

/// Installs the emulator by its lock file.
///
/// # Errors
///
/// If Node.js is missing and cannot be installed, or the registry does not answer.
pub(crate) fn install_emulator() -> Result<()> {
    apt::require(&NODE)?;
    run(Command::new("npm")
        .args(["ci", "--ignore-scripts", "--no-audit", "--no-fund"])
        .current_dir(folder(EMULATOR)))
}

fn folder(name: &str) -> PathBuf {
    root().join("examples").join(name)
}
