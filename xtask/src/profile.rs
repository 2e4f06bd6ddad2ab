//! `cargo xtask profile`: what the firmware image's instructions are spent on, counted on the virtual board, and whose its
//! bytes of code are.

use std::ffi::OsString;

use crate::Result;
use crate::image;
use crate::process;
use crate::workspace;

/// The program.
const RUN: &str = "run --package armwire-host-tests --features image --bin profile --";

/// Builds the image, or takes that which `ARMWIRE_IMAGE` names, and plays the scene on it that the options name.
///
/// # Errors
///
/// If there is no such scene, or the firmware does what it must not.
pub(crate) fn run(options: &[OsString]) -> Result {
    let image = image::for_virtual_board()?;
    let mut cargo = process::cargo();
    cargo.args(RUN.split(' ')).args(options).env("ARMWIRE_IMAGE", image);
    process::run(cargo.current_dir(workspace::root()))
}
