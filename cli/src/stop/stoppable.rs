//! A Ling arm whose motion Ctrl-C stops.

use armwire::ling::{Ling, Move};

use armwire_host::{Error as Host, stop};

use super::show;
use crate::args::ArmPort;
use crate::error::Error;
use crate::legacy;
use crate::link::Link;
use crate::port::Connection;
use crate::signals;

/// A link whose calls end on Ctrl-C, and on a request to terminate.
pub(crate) struct Stoppable {
    connection: Connection,
    link: Link<Ling>,
}

impl Stoppable {
    /// Opens the line of an arm.
    pub(crate) fn open(arm: &ArmPort) -> Result<Self, Error> {
        signals::catch_first()?;
        let connection = arm.connect()?;
        let mut link = legacy::open(&connection)?;
        link.set_interrupt(signals::check);
        signals::check().map_err(Host::Interrupted)?;
        Ok(Self { connection, link })
    }

    /// What is known of an error only from the adapter is added to it.
    pub(crate) fn explain(&self, error: Error) -> Error {
        error.explained(&self.connection)
    }

    pub(crate) fn link(&mut self) -> &mut Link<Ling> {
        &mut self.link
    }

    /// Runs `motion`, which sends this move. After a signal the arm is stopped, and [`Error::Interrupted`] reports it.
    pub(crate) fn run<T>(
        &mut self,
        target: &Move,
        motion: impl FnOnce(&mut Link<Ling>) -> Result<T, Error>,
    ) -> Result<T, Error> {
        signals::check().map_err(Host::Interrupted)?;
        let result = motion(&mut self.link);
        if signals::check().is_ok() {
            return result;
        }
        let (gripper, _speed) = target.gripper;
        let stopped = stop(&mut self.link, Some(gripper))?;
        Err(Host::Interrupted(show(&stopped).into()).into())
    }
}
