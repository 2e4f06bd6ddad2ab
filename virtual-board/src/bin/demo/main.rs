//! `cargo demo`: a Ling arm, driven through the shipped firmware image, with no hardware.
#![forbid(unsafe_code)]

mod figures;
mod host;
mod options;
mod tour;

use std::path::PathBuf;
use std::process::ExitCode;

use armwire_sim::ling::{Config as ArmConfig, LingArm};
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

    #[command(flatten)]
    options: DemoOptions,
}

fn main() -> ExitCode {
    match run(Args::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("demo: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(Args { image, options }: Args) -> Result<(), Box<dyn std::error::Error>> {
    let arm = LingArm::new(ArmConfig::follower());
    let board = VirtualBoard::start(Config {
        gdb: options.gdb,
        ..Config::new(image, arm)
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
        None => tour::run(board),
    }
}
