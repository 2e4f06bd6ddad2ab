//! `cargo xtask vendor`: software from elsewhere drives virtual arms.
//!
//! Its scripts are in `host-tests/vendor`. Each check installs what it needs from PyPI.

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
    /// The only check to run
    check: Option<Check>,
}

#[derive(Clone, Copy, ValueEnum)]
enum Check {
    /// The parser of Ling's SDK and ours on damaged streams
    Differential,
    /// CAN FD frames between two programs on a virtual bus
    CanFd,
}

/// Runs every check, or the one that is named.
///
/// # Errors
///
/// If anything on the way fails, a script reads anything but what it must, or something takes too long.
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
