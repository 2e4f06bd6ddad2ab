//! A Ling arm whose motion Ctrl-C stops.

use armwire::ling::{Ling, Move};

use armwire_host::{Error as Host, stop};

use super::show;
use crate::args::ArmPort;
use crate::error::Error;
use crate::legacy;
use crate::link::Link;
use crate::signals;

/// A link whose calls end on Ctrl-C, and on a request to terminate.
pub(crate) struct Stoppable(Link<Ling>);

impl Stoppable {
    /// Opens the line of an arm.
    pub(crate) fn open(arm: &ArmPort) -> Result<Self, Error> {
        signals::catch_first()?;
        let mut link = legacy::open(&arm.connect()?)?;
        link.set_interrupt(signals::check);
        signals::check().map_err(Host::Interrupted)?;
        Ok(Self(link))
    }

    pub(crate) fn link(&mut self) -> &mut Link<Ling> {
        &mut self.0
    }

    /// Runs `motion`, which sends this move. After a signal the arm is stopped, and [`Error::Interrupted`] reports it.
    pub(crate) fn run<T>(
        &mut self,
        target: &Move,
        motion: impl FnOnce(&mut Link<Ling>) -> Result<T, Error>,
    ) -> Result<T, Error> {
        signals::check().map_err(Host::Interrupted)?;
        let result = motion(&mut self.0);
        if signals::check().is_ok() {
            return result;
        }
        let (gripper, _speed) = target.gripper;
        let stopped = stop(&mut self.0, Some(gripper))?;
        Err(Host::Interrupted(show(&stopped).into()).into())
    }
}
