//! `cargo demo`: a Ling arm, driven through the shipped firmware image, with no hardware.
#![forbid(unsafe_code)]

mod figures;
mod host;
mod tour;

use std::path::PathBuf;
use std::process::ExitCode;

use armwire_sim::ling::{Config as ArmConfig, LingArm};
use armwire_virtual_board::serve::{Places, serve};
use armwire_virtual_board::{Config, VirtualBoard};
use clap::Parser;

/// Drives a virtual Ling arm through the firmware image, which runs on a virtual board.
#[derive(Parser)]
#[command(bin_name = "cargo demo --")]
struct Args {
    /// The firmware image, an ELF file.
    #[arg(long)]
    image: PathBuf,

    /// Keeps running in real time behind a pty, at PATH if given, until Ctrl-C.
    ///
    /// Any serial program can open it. A pty has no modem lines: a program that sets DTR or RTS gets an error.
    #[arg(long, value_name = "PATH")]
    serve: Option<Option<PathBuf>>,

    /// Serves the adapter's control port too, on a pty, at PATH if given. `armwire` knows it as control:PATH.
    #[arg(long, value_name = "PATH", requires = "serve")]
    control: Option<Option<PathBuf>>,

    /// Serves the CAN bus too, behind an SLCAN adapter on a pty, at PATH if given.
    ///
    /// `armwire` knows it as slcan:PATH. python-can opens it with the interface `slcan`. A program has to set the bit
    /// rate, as with LAWICEL's adapters.
    #[arg(long, value_name = "PATH", requires = "serve")]
    slcan: Option<Option<PathBuf>>,

    /// Lets gdb attach to the firmware, on this TCP port of this machine.
    #[arg(long, value_name = "PORT")]
    gdb: Option<u16>,
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

fn run(args: Args) -> Result<(), Box<dyn std::error::Error>> {
    let arm = LingArm::new(ArmConfig::follower());
    let board = VirtualBoard::start(Config {
        gdb: args.gdb,
        ..Config::new(args.image, arm)
    })?;
    match &args.serve {
        Some(serial) => {
            let places = Places {
                serial: serial.as_deref(),
                control: args.control.as_ref().map(Option::as_deref),
                can: args.slcan.as_ref().map(Option::as_deref),
            };
            Ok(serve(board, places)?)
        }
        None => tour::run(board),
    }
}
