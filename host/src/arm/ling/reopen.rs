//! A Ling arm whose port was lost, and is opened again.

use armwire::ling::{Info, MotionStatus, Request, SerialNumber};

use super::Ling;
use crate::arm::legacy;
use crate::arm::refusals::Refusals;
use crate::error::Error;
use crate::error::outside::Outside;

/// What is known of an arm.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Known {
    /// `None` before it was read.
    pub(super) serial: Option<SerialNumber>,
    /// True if the torque was off in the last reading.
    is_torque_off: bool,
    /// True if the torque was off before the port was lost: it must be off again, or be switched here, before a motion.
    must_be_off: bool,
}

impl Known {
    /// Takes the status of a reading.
    pub(super) fn note(&mut self, status: MotionStatus) {
        self.is_torque_off = status.is_torque_off();
        self.must_be_off &= !self.is_torque_off;
    }

    /// The torque is switched by this program: what it was before does not matter any more.
    pub(super) fn torque_is_switched(&mut self) {
        self.must_be_off = false;
    }

    /// True if the torque was off before the port was lost, and nobody here has switched it on.
    pub(super) fn is_switched_by_others(&self) -> bool {
        self.must_be_off
    }
}

impl Ling {
    /// Reads the serial number, by which the arm is known after its port was lost, if it was not read before.
    pub(crate) fn identify(&mut self) -> Result<(), Error> {
        match self.known.serial {
            Some(_) => Ok(()),
            None => self.read_info().map(drop),
        }
    }

    /// Reads whether this is the arm with this serial number, for a program that opens a port again after its loss.
    ///
    /// # Errors
    ///
    /// [`Error::Lost`] for another arm: the one that was there may come back.
    pub fn require_serial(&mut self, serial: SerialNumber) -> Result<(), Error> {
        let Info { serial: now, .. } = self.link.read(&Request::ReadInfo)?;
        match now == serial {
            true => Ok(()),
            false => {
                let reason = format_args!("another arm is on this port: {now}, and not {serial}");
                Err(Error::lost(self.name(), reason))
            }
        }
    }

    /// Closes the port. Calls fail with this reason, as [`Error::Lost`].
    pub(crate) fn disconnect(&mut self, reason: Outside) {
        self.link.disconnect(reason);
    }

    /// Opens the port again, after a loss. Only reads are sent, until they show the arm with the serial number that was
    /// read before. Nothing moves by itself: the last move and its goal are forgotten, and the next move reads first. It is
    /// [`Error::TorqueSwitched`] if the torque has come on meanwhile.
    ///
    /// # Errors
    ///
    /// The port cannot be opened, or the arm does not answer. [`Error::Lost`] if it is another arm, or if the serial number
    /// was never read: the port is left alone then. After an error the port is closed, and calls fail as [`Error::Lost`].
    pub fn reopen(&mut self) -> Result<(), Error> {
        let opened = self.open_and_compare();
        match &opened {
            Ok(()) => {}
            Err(Error::Lost { reason, .. }) => self.link.disconnect(reason.clone()),
            Err(_) => self.link.disconnect("the port could not be opened again".into()),
        }
        opened
    }

    fn open_and_compare(&mut self) -> Result<(), Error> {
        let Some(before) = self.known.serial else {
            let reason = "the arm's serial number was not read before the loss: it may be another arm";
            return Err(Error::lost(self.name(), reason));
        };
        // A port that is kept open keeps its name from the device that comes back.
        self.link.disconnect("the port is being opened again".into());
        self.refusals = Refusals::default();
        (self.target, self.last, self.may_move) = (None, None, false);
        self.connection.reopen()?;
        let (line, config) = legacy::open(&self.connection)?;
        self.link.replace_line(line, config);
        self.require_serial(before)?;
        self.known.must_be_off |= self.known.is_torque_off;
        self.read_joints().map(drop)
    }
}
