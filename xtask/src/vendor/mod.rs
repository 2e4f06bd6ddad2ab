//! `cargo xtask vendor`: software from elsewhere drives virtual arms.
//!
//! Its scripts are in `host-tests/vendor`. Each check installs what it needs from PyPI.

mod background;
pub(crate) mod can;
mod python;
pub(crate) mod sdk;
mod served;

use std::time::Duration;

use crate::Result;

/// How long a script may take for all it does: several times what it takes on a slow machine.
const DRIVE: Duration = Duration::from_secs(300);

/// Runs every check.
///
/// # Errors
///
/// If anything on the way fails, a script reads anything but what it must, or something takes too long.
pub(crate) fn run() -> Result {
    can::check_dbc()?;
    can::drive()?;
    sdk::drive_xarm()?;
    sdk::drive_ling()
}
