//! A Ling arm whose motion Ctrl-C stops.

use armwire_host::{Error as Host, Ling};

use crate::args::ArmPort;
use crate::error::Error;
use crate::signals;

/// Opens an arm whose calls end on Ctrl-C, and on a request to terminate.
pub(crate) fn open(arm: &ArmPort) -> Result<Ling, Error> {
    signals::catch_first()?;
    let mut arm = arm.connect()?.ling()?;
    arm.set_interrupt(signals::check);
    signals::check().map_err(Host::Interrupted)?;
    Ok(arm)
}
