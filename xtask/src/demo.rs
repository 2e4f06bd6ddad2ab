//! `cargo demo`: the firmware image on the virtual board.

use std::ffi::OsString;
use std::process::Command;

use crate::Result;
use crate::image::{self, Options};
use crate::process::{cargo, replace_ourselves};

/// Builds the image and the virtual board and hands over to the demo.
pub(crate) fn run(args: &[OsString]) -> Result {
    let image = image::build(&Options::default())?;
    println!("{image}");
    println!("building the virtual board, about 3 minutes the first time");
    // `cargo demo -- --serve` and `cargo demo --serve` mean the same.
    let args = args.strip_prefix(&["--".into()]).unwrap_or(args);
    replace_ourselves(command("run").arg("--").arg("--image").arg(image.path).args(args))
}

/// `cargo build` or `cargo run` for the demo.
pub(crate) fn command(subcommand: &str) -> Command {
    virtual_board(subcommand, "demo")
}

/// `cargo build` or `cargo run` for a program of the virtual board.
pub(crate) fn virtual_board(subcommand: &str, program: &str) -> Command {
    let mut command = cargo();
    // The emulator asks for a newer compiler than it needs.
    command.args([
        subcommand,
        "--ignore-rust-version",
        "--package",
        "armwire-virtual-board",
        "--bin",
        program,
    ]);
    command
}
