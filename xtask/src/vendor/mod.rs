//! `cargo xtask vendor`: other software drives virtual arms.
//!
//! The scripts are in `host-tests/vendor`. Each check installs its packages from PyPI.

pub(crate) mod background;
pub(crate) mod can;
pub(crate) mod differential;
pub(crate) mod python;
pub(crate) mod sdk;
pub(crate) mod served;
pub(crate) mod so101;

use std::slice;

use anyhow::{Result, ensure};
use clap::{Args, ValueEnum};

#[derive(Args)]
pub(crate) struct Options {
    /// The check to run, by default all
    check: Option<Check>,
    /// Write the results of so101 into the pages instead of comparing them
    #[arg(long)]
    write: bool,
}

#[derive(Clone, Copy, ValueEnum)]
enum Check {
    /// CAN software on the bus of a virtual board
    Can,
    /// CAN FD frames between two programs on a virtual bus
    CanFd,
    /// The SDKs of Ling and xArm
    Sdk,
    /// The parser of Ling's SDK and ours on damaged streams
    Differential,
    /// Programs for Feetech servos on a virtual SO-101
    So101,
}

/// Runs every check, or the selected one.
///
/// # Errors
///
/// If a check fails or exceeds its timeout, or is to write results and has none.
pub(crate) fn run(options: &Options) -> Result<()> {
    ensure!(
        !options.write || matches!(options.check, None | Some(Check::So101)),
        "--write is for so101: other checks have no results on pages"
    );
    let checks = match &options.check {
        None => Check::value_variants(),
        Some(check) => slice::from_ref(check),
    };
    checks.iter().try_for_each(|check| check.run(options.write))
}

impl Check {
    fn run(self, write: bool) -> Result<()> {
        match self {
            Self::Can => {
                can::check_dbc()?;
                can::compare_logs()?;
                can::drive()
            }
            Self::CanFd => can::exchange_fd(),
            Self::Sdk => {
                sdk::drive_xarm()?;
                sdk::drive_ling()
            }
            Self::Differential => differential::compare(),
            Self::So101 => so101::compare(write),
        }
    }
}
