//! `cargo demo`: a Ling arm, driven through the shipped firmware image, with no hardware.
#![forbid(unsafe_code)]

mod figures;
mod host;
mod options;
mod tour;

use std::error::Error;
use std::io::{self, ErrorKind, Write, stdout};
use std::path::PathBuf;
use std::process::ExitCode;

use armwire_boards::Board;
use armwire_sim::ling::{Config as ArmConfig, LingArm, Plant, PlantError};
use armwire_virtual_board::serve::{Places, serve};
use armwire_virtual_board::{Config, VirtualBoard};
use clap::Parser;

use crate::options::DemoOptions;

/// Drives a virtual Ling arm through the firmware image, which runs on a virtual board.
#[derive(Parser)]
struct Args {
    /// The firmware image, an ELF file.
    #[arg(long)]
    image: PathBuf,

    /// The board that the image is for, with its crystal and UART.
    #[arg(long, value_parser = board, default_value = "stm32f405")]
    board: &'static Board,

    #[command(flatten)]
    options: DemoOptions,
}

fn main() -> ExitCode {
    match run(Args::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        // The reader of the output is gone, as with `| head`: this is no error.
        Err(error) if is_broken_pipe(&*error) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("demo: {error}");
            ExitCode::FAILURE
        }
    }
}

fn is_broken_pipe(error: &(dyn Error + 'static)) -> bool {
    error
        .downcast_ref::<io::Error>()
        .is_some_and(|error| error.kind() == ErrorKind::BrokenPipe)
}

/// The board of this name.
fn board(name: &str) -> Result<&'static Board, &'static str> {
    Board::find(name).ok_or("no board of the list")
}

/// The plant of this text.
fn plant(text: Option<&str>) -> Result<Plant, PlantError> {
    text.map_or(Ok(Plant::DEFAULT), str::parse)
}

fn run(Args { image, board, options }: Args) -> Result<(), Box<dyn Error>> {
    if options.slcan.is_some() && board.can.is_none() {
        return Err(format!("--slcan: {} has no CAN", board.title).into());
    }
    let plant = plant(options.plant.as_deref()).map_err(|error| format!("--plant: {error}"))?;
    let arm = LingArm::new(ArmConfig {
        plant,
        ..ArmConfig::follower()
    });
    let board = VirtualBoard::start(Config {
        gdb: options.gdb,
        ..Config::new(image, arm).on(board)
    })?;
    match &options.serve {
        Some(serial) => {
            let places = Places {
                serial: serial.as_deref(),
                control: options.control.as_ref().map(Option::as_deref),
                can: options.slcan.as_ref().map(Option::as_deref),
            };
            Ok(serve(board, places)?)
        }
        None => {
            writeln!(stdout(), "A virtual Ling follower arm, plant {plant}.")?;
            tour::run(board)
        }
    }
}
