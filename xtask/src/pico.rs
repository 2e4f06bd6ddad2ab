//! `cargo xtask pico`: the image of the Raspberry Pi Pico on an emulated chip, rp2040js.

use std::process::Command;

use anyhow::Result;
use clap::Args;

use crate::board::Board;
use crate::cargo::{cargo, target_dir};
use crate::examples::install_emulator;
use crate::image;
use crate::process::run;
use crate::workspace::root;

/// Folder of the tests in JavaScript.
const TESTS: &str = "host-tests/pico";

/// The command for the image tests that the other chips have, too.
const IMAGE_TESTS: &str = "test --quiet --package armwire-host-tests --features image --test image";

/// Those that run on this chip, by a part of their names.
const RUN: [&str; 7] = [
    "boot::",
    "bytes::",
    "control::",
    "ling::",
    "teleop::",
    "trace::",
    "usb::",
];

#[derive(Args)]
pub(crate) struct Options {
    /// Seconds of the chip's time with 200 polls each
    #[arg(long, default_value_t = 2)]
    seconds: u32,
}

impl Options {
    /// An hour of polls.
    pub(crate) const HOUR: Self = Self { seconds: 3600 };
}

/// Builds the image and the command, and runs the tests.
///
/// # Errors
///
/// If a build fails, a tool is missing and cannot be installed, or a test fails.
pub(crate) fn test(options: &Options) -> Result<()> {
    let image = image::release(Board::PICO)?;
    run(&mut cargo("build --quiet --package armwire-cli"))?;
    install_emulator()?;
    run(Command::new("node")
        .args(["--test", "--test-reporter=spec", TESTS])
        .env("ARMWIRE_IMAGE", &image.path)
        .env("ARMWIRE", target_dir()?.join("debug/armwire"))
        .env("ARMWIRE_POLL_SECONDS", options.seconds.to_string())
        .current_dir(root()))?;
    run(cargo(IMAGE_TESTS).arg("--").args(RUN).env("ARMWIRE_IMAGE", &image.path))
}
