//! `cargo xtask vendor`: software from elsewhere drives virtual arms.
//!
//! Its scripts are in `host-tests/vendor`. Each check installs what it needs from PyPI.

mod background;
pub(crate) mod can;
pub(crate) mod differential;
mod python;
pub(crate) mod sdk;
mod served;

use std::ffi::OsString;
use std::time::Duration;

use crate::Result;

/// How long a script may take for all it does: several times what it takes on a slow machine.
const DRIVE: Duration = Duration::from_secs(300);

/// Runs every check, or the one that is named.
///
/// # Errors
///
/// If anything on the way fails, a script reads anything but what it must, or something takes too long; if there is no
/// check of that name.
pub(crate) fn run(args: &[OsString]) -> Result {
    match args {
        [] => {
            can::check_dbc()?;
            can::drive()?;
            can::exchange_fd()?;
            sdk::drive_xarm()?;
            sdk::drive_ling()?;
            differential::compare()
        }
        [check] if check == "differential" => differential::compare(),
        [check] if check == "can-fd" => can::exchange_fd(),
        _ => Err("usage: cargo xtask vendor [differential | can-fd]".into()),
    }
}
