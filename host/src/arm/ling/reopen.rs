//! A Ling arm whose port was lost, and is opened again.

use armwire::ling::{Info, Request};

use super::Ling;
use crate::arm::known::Known;
use crate::arm::legacy;
use crate::arm::refusals::Refusals;
use crate::error::Error;
use crate::error::outside::Outside;

impl Ling {
    /// Facts about this arm: the serial number after [`read_info`](Self::read_info), and the torque after a reading.
    pub fn known(&self) -> Known {
        self.known
    }

    /// Reads whether this is the arm that was on the port before its loss, for a program that opens the port anew. Only
    /// reads are sent. If the torque was off, and has come on meanwhile, a later move is [`Error::TorqueSwitched`].
    ///
    /// # Errors
    ///
    /// [`Error::Lost`] for another arm: the one that was there may come back. It is the error of an unknown arm, too.
    pub fn require_known(&mut self, known: &Known) -> Result<(), Error> {
        let Some(before) = known.serial() else {
            let reason = "the arm's serial number was not read before the loss: it may be another arm";
            return Err(Error::lost(self.name(), reason));
        };
        let Info { serial: now, .. } = self.link.read(&Request::ReadInfo).map_err(other_arm)?;
        if now != before {
            let reason = format_args!("another arm is on this port: {now}, and not {before}");
            return Err(Error::lost(self.name(), reason));
        }
        self.known = known.after_loss();
        self.read_joints().map(drop)
    }

    /// Opens the port again, after a loss, and reads whether the arm is [the one before](Self::require_known). Nothing moves
    /// by itself: the last move and its goal are forgotten, and the next move reads first.
    ///
    /// # Errors
    ///
    /// The port cannot be opened, or the arm does not answer. [`Error::Lost`] if it is another arm, or if the serial number
    /// was never read: the port is left alone then. After an error the port is closed, and calls fail as [`Error::Lost`].
    pub fn reopen(&mut self) -> Result<(), Error> {
        let opened = self.open_and_compare();
        if let Err(error) = &opened {
            self.link.disconnect(error.loss());
        }
        opened
    }

    /// Opens the port again as [`reopen`](Self::reopen), without the interrupt.
    pub(crate) fn reopen_uninterrupted(&mut self) -> Result<(), Error> {
        let check = self.link.take_check();
        let opened = self.reopen();
        self.link.set_check(check);
        opened
    }

    fn open_and_compare(&mut self) -> Result<(), Error> {
        let known = self.known;
        // A port that is kept open keeps its name from the device that comes back.
        self.link.disconnect("the port is being opened again".into());
        self.refusals = Refusals::default();
        // A call that moves the arm in steps ends.
        self.stops += 1;
        (self.gripper, self.target, self.last, self.may_move) = (None, None, None, false);
        if known.serial().is_some() {
            self.connection.reopen()?;
            let (line, config) = legacy::open(&self.connection).map_err(other_arm)?;
            self.link.replace_line(line, config);
        }
        self.require_known(&known)
    }

    /// Reads the serial number, by which the arm is known after its port was lost, if it was not read before.
    pub(crate) fn identify(&mut self) -> Result<(), Error> {
        match self.known.serial() {
            Some(_) => Ok(()),
            None => self.read_info().map(drop),
        }
    }

    /// Closes the port. Calls fail with this reason, as [`Error::Lost`].
    pub(crate) fn disconnect(&mut self, reason: Outside) {
        self.link.disconnect(reason);
    }
}

/// An arm of the older generation is another one than the arm before.
fn other_arm(error: Error) -> Error {
    match error {
        Error::Legacy { name, legacy } => {
            Error::lost(name.as_str(), format_args!("another arm is on this port: {legacy}"))
        }
        error => error,
    }
}
