//! The `armwire` command.
#![forbid(unsafe_code)]

use std::process::ExitCode;

fn main() -> ExitCode {
    armwire_cli::main()
}
