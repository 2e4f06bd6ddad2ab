//! `cargo demo`: the firmware image on the virtual board.

#[path = "../../virtual-board/src/bin/demo/options.rs"]
mod options;

use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::thread;

use anyhow::Result;
use clap::Args;

use self::options::DemoOptions;
use crate::board::Board;
use crate::cargo::{cargo, target_dir};
use crate::examples::install_emulator;
use crate::image;
use crate::process::{self, replace_ourselves};

#[derive(Args)]
pub(crate) struct Options {
    /// The board, and the image for it
    #[arg(long, default_value = "stm32f405")]
    board: Board,
    #[command(flatten)]
    demo: DemoOptions,
}

/// Builds the image and the virtual board at the same time, for two targets, and hands over to the demo.
pub(crate) fn run(Options { board, demo }: Options) -> Result<()> {
    if board == Board::PICO {
        install_emulator()?;
    }
    let image = thread::scope(|scope| {
        // An error of this build shows in `cargo run`.
        scope.spawn(|| command("build").arg("--quiet").stderr(Stdio::null()).status());
        image::build(image::Options::of(board))
    })?;
    println!("{image}");
    println!("building the virtual board");
    let mut run = command("run");
    run.args(["--", "--board", board.name(), "--image"]).arg(image.path);
    let DemoOptions {
        serve,
        control,
        slcan,
        plant,
        gdb,
    } = demo;
    for (option, path) in [("--serve", serve), ("--control", control), ("--slcan", slcan)] {
        if let Some(path) = path {
            run.arg(option).args(path);
        }
    }
    if let Some(plant) = plant {
        run.arg(format!("--plant={plant}"));
    }
    if let Some(port) = gdb {
        run.arg(format!("--gdb={port}"));
    }
    replace_ourselves(&mut run)
}

/// Builds the demo, and returns the program. It starts at once; `cargo run` would wait for other builds.
pub(crate) fn build() -> Result<PathBuf> {
    process::run(&mut command("build"))?;
    Ok(target_dir()?.join("debug/demo"))
}

/// `cargo build` or `cargo run` for the demo.
fn command(subcommand: &str) -> Command {
    cargo(&format!("{subcommand} --package armwire-virtual-board --bin demo"))
}
