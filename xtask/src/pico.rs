//! `cargo xtask pico`: the image of the Raspberry Pi Pico on an emulated chip, rp2040js.

use std::process::Command;

use anyhow::Result;

use crate::board::Board;
use crate::cargo::{cargo, target_dir};
use crate::examples::install_emulator;
use crate::image;
use crate::process::run;
use crate::workspace::root;

/// Folder of the tests.
const TESTS: &str = "host-tests/pico";

/// Builds the image and the command, and runs the tests.
///
/// # Errors
///
/// If a build fails, a tool is missing and cannot be installed, or a test fails.
pub(crate) fn test() -> Result<()> {
    let image = image::build(image::Options::of(Board::PICO))?;
    println!("{image}");
    image.check_sizes()?;
    run(&mut cargo("build --quiet --package armwire-cli"))?;
    install_emulator()?;
    run(Command::new("node")
        .args(["--test", "--test-reporter=spec", TESTS])
        .env("ARMWIRE_IMAGE", &image.path)
        .env("ARMWIRE", target_dir()?.join("debug/armwire"))
        .current_dir(root()))
}
