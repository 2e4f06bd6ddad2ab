//! `cargo xtask vendor`: other software drives virtual arms.
//!
//! The scripts are in `host-tests/vendor`. Each check installs its packages from PyPI.

mod background;
pub(crate) mod can;
pub(crate) mod differential;
pub(crate) mod python;
pub(crate) mod sdk;
pub(crate) mod served;

use anyhow::Result;
use clap::{Args, ValueEnum};

#[derive(Args)]
pub(crate) struct Options {
    /// The check to run, by default all
    check: Option<Check>,
}

#[derive(Clone, Copy, ValueEnum)]
enum Check {
    /// The parser of Ling's SDK and ours on damaged streams
    Differential,
    /// CAN FD frames between two programs on a virtual bus
    CanFd,
}

/// Runs every check, or the selected one.
///
/// # Errors
///
/// If a check fails or exceeds its timeout.
pub(crate) fn run(options: &Options) -> Result<()> {
    match options.check {
        None => {
            can::check_dbc()?;
            can::drive()?;
            can::exchange_fd()?;
            sdk::drive_xarm()?;
            sdk::drive_ling()?;
            differential::compare()
        }
        Some(Check::Differential) => differential::compare(),
        Some(Check::CanFd) => can::exchange_fd(),
    }
}
