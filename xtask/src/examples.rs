//! `cargo xtask examples`: the program of each microcontroller in `examples`, and that of the RP2040 on an emulated chip.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Result, ensure};

use crate::apt;
use crate::cargo::{cargo, target_dir};
use crate::process::{output, run};
use crate::toolchain::Toolchain;
use crate::workspace::root;

/// The examples by folder, and the target of each.
pub(crate) const EXAMPLES: [(&str, &str); 4] = [
    ("esp32c3", "riscv32imc-unknown-none-elf"),
    ("nrf52840", "thumbv7em-none-eabihf"),
    ("rp2040", "thumbv6m-none-eabi"),
    ("stm32f303", "thumbv7em-none-eabihf"),
];
/// Folder of the emulator's package, and the image in the target directory.
const EMULATOR: &str = "rp2040/emulator";
const IMAGE: &str = "thumbv6m-none-eabi/release/armwire-rp2040";

/// Checks and links each example, with the dependencies as locked, and runs the RP2040's against a virtual arm.
///
/// # Errors
///
/// The first that fails, or if a tool is missing and cannot be installed.
pub(crate) fn check() -> Result<()> {
    let toolchain = Toolchain::find(&EXAMPLES.map(|(_, target)| target))?;
    for (example, target) in EXAMPLES {
        println!("{example} for {target}");
        let folder = folder(example);
        run(cargo("fmt --check").current_dir(&folder))?;
        // Debian's compiler comes without clippy.
        if toolchain == Toolchain::Installed {
            let mut clippy = toolchain.cargo("clippy --release --locked --quiet", target)?;
            run(clippy.args(["--", "-D", "warnings"]).current_dir(&folder))?;
        }
        let mut build = toolchain.cargo("build --release --locked --quiet", target)?;
        run(build.current_dir(&folder))?;
    }
    emulate(&toolchain.target_dir()?.join(IMAGE))
}

/// Runs the RP2040's image on an emulated chip, with `armwire sim` on its UART.
fn emulate(image: &Path) -> Result<()> {
    install_node()?;
    let emulator = folder(EMULATOR);
    run(Command::new("npm")
        .args(["ci", "--ignore-scripts", "--no-audit", "--no-fund"])
        .current_dir(&emulator))?;
    run(&mut cargo("build --quiet --package armwire-cli"))?;
    let armwire = target_dir()?.join("debug/armwire");
    run(Command::new("node")
        .args([Path::new("run.mjs"), &armwire, image])
        .current_dir(&emulator))
}

/// Installs Node.js and npm if one is missing.
pub(crate) fn install_node() -> Result<()> {
    let is_missing = |tool| output(Command::new(tool).arg("--version")).is_err();
    if is_missing("node") || is_missing("npm") {
        let is_installed = apt::install(&["nodejs", "npm"])?;
        ensure!(is_installed, "npm is missing, and Node.js 20 or later");
    }
    Ok(())
}

fn folder(name: &str) -> PathBuf {
    root().join("examples").join(name)
}
