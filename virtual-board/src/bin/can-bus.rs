//! A virtual CAN bus, classic and FD, between programs with SLCAN.
#![forbid(unsafe_code)]

use std::path::PathBuf;
use std::process::ExitCode;

use armwire_virtual_board::serve::serve_bus;
use clap::Parser;

/// Serves a virtual CAN bus with an SLCAN adapter at each PATH, until Ctrl-C.
///
/// The adapters support CAN FD. python-can opens them with the interface `slcan`.
#[derive(Parser)]
struct Args {
    /// The symbolic link to each adapter's pty.
    #[arg(value_name = "PATH", required = true, num_args = 1..=16)]
    adapters: Vec<PathBuf>,
}

fn main() -> ExitCode {
    match serve_bus(&Args::parse().adapters) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("can-bus: {error}");
            ExitCode::FAILURE
        }
    }
}
