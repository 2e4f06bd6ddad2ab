//! `cargo flash`: the firmware image onto a board, by probe-rs.

use std::process::{Command, exit};

use anyhow::{Result, bail};

use crate::board::Board;
use crate::image::{self, Options};
use crate::process::{output, replace_ourselves};

/// Builds the image, flashes and starts it. With defmt it stays and prints what the image logs.
pub(crate) fn run(options: Options) -> Result<()> {
    if output(Command::new("probe-rs").arg("--version")).is_err() {
        bail!("probe-rs is not installed; run `cargo install probe-rs-tools --locked`");
    }
    let image = image::build(options)?;
    println!("{image}");

    if options.defmt {
        return replace_ourselves(probe_rs("run", options.board).arg(&image.path));
    }
    // It says itself what is wrong, such as that there is no probe.
    let flashed = probe_rs("download", options.board)
        .arg("--verify")
        .arg(&image.path)
        .status()?;
    if !flashed.success() {
        exit(flashed.code().unwrap_or(1));
    }
    replace_ourselves(&mut probe_rs("reset", options.board))
}

fn probe_rs(subcommand: &str, board: Board) -> Command {
    let mut command = Command::new("probe-rs");
    command.args([subcommand, "--chip", board.chip()]);
    command
}
