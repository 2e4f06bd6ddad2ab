//! `cargo demo`: the firmware image on the virtual board.

use std::ffi::OsString;
use std::process::Command;

use crate::Result;
use crate::board::Board;
use crate::image::{self, Options};
use crate::process::{cargo, replace_ourselves};

/// Builds the image and the virtual board and hands over to the demo.
pub(crate) fn run(args: &[OsString]) -> Result {
    // `cargo demo -- --serve` and `cargo demo --serve` mean the same.
    let args = args.strip_prefix(&["--".into()]).unwrap_or(args);
    let (board, args) = board(args)?;
    let image = image::build(&Options::of(board))?;
    println!("{image}");
    println!("building the virtual board, a minute or two the first time");
    replace_ourselves(command("run").arg("--").arg("--image").arg(image.path).args(args))
}

/// The board that `--board NAME` names, and the options of the demo's own.
fn board(args: &[OsString]) -> Result<(Board, Vec<&OsString>)> {
    let mut board = Board::default();
    let mut others = Vec::new();
    let mut args = args.iter();
    while let Some(arg) = args.next() {
        if arg == "--board" {
            let name = args.next().ok_or("`--board` needs the name of a board")?;
            board = Board::parse(&name.to_string_lossy())?;
        } else {
            others.push(arg);
        }
    }
    Ok((board, others))
}

/// `cargo build` or `cargo run` for the demo.
pub(crate) fn command(subcommand: &str) -> Command {
    virtual_board(subcommand, "demo")
}

/// `cargo build` or `cargo run` for a program of the virtual board.
pub(crate) fn virtual_board(subcommand: &str, program: &str) -> Command {
    let mut command = cargo();
    command.args([subcommand, "--package", "armwire-virtual-board", "--bin", program]);
    command
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_board_is_taken_out_of_the_options() {
        let args = ["--serve", "/tmp/arm", "--board", "stm32g431", "--speed"].map(OsString::from);
        let (found, others) = board(&args).unwrap();
        assert_eq!(found, Board::Stm32g431);
        assert_eq!(others, ["--serve", "/tmp/arm", "--speed"]);
        assert_eq!(board(&args[..2]).unwrap().0, Board::Stm32f405);
        assert!(board(&args[2..3]).is_err());
    }
}
