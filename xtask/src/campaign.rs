//! `cargo xtask campaign`: the fault campaign, with the image for the STM32F405 on the virtual board.

use std::ffi::OsString;
use std::path::Path;

use crate::Result;
use crate::image;
use crate::process;
use crate::workspace;

/// The program. The emulator asks for a newer compiler than it needs.
const RUN: &str = "run --ignore-rust-version --package armwire-host-tests --features image --bin campaign --";

/// Builds the image, or takes that which `ARMWIRE_IMAGE` names, and runs the campaign with these options of its own.
///
/// # Errors
///
/// If a run fails.
pub(crate) fn run(options: &[OsString]) -> Result {
    run_on(&image::for_virtual_board()?, options)
}

/// Runs the campaign on this image.
///
/// # Errors
///
/// If a run fails.
pub(crate) fn run_on(image: &Path, options: &[OsString]) -> Result {
    let mut cargo = process::cargo();
    cargo.args(RUN.split(' ')).args(options).env("ARMWIRE_IMAGE", image);
    process::run(cargo.current_dir(workspace::root()))
}
