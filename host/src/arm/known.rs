//! Facts about a Ling arm that tell it from another one.

use armwire::ling::{MotionStatus, SerialNumber};

/// Facts about an arm: after the loss of its port they tell whether it is the same arm, with the same torque.
#[derive(Clone, Copy, Debug, Default)]
pub struct Known {
    /// `None` before it was read.
    serial: Option<SerialNumber>,
    /// True if the torque was off in the last reading.
    is_torque_off: bool,
    /// True if the torque was off before the port was lost: it must be off again, or be switched here, before a motion.
    must_be_off: bool,
}

impl Known {
    /// Takes the serial number.
    pub(crate) fn note_serial(&mut self, serial: SerialNumber) {
        self.serial = Some(serial);
    }

    /// Takes the status of a reading.
    pub(crate) fn note(&mut self, status: MotionStatus) {
        self.is_torque_off = status.is_torque_off();
        self.must_be_off &= !self.is_torque_off;
    }

    /// The torque is switched by this program, off or on: what it was before does not matter any more.
    pub(crate) fn note_switching(&mut self, is_off: bool) {
        (self.is_torque_off, self.must_be_off) = (is_off, false);
    }

    /// The same after a loss of the port.
    pub(crate) fn after_loss(self) -> Self {
        Self {
            must_be_off: self.must_be_off || self.is_torque_off,
            ..self
        }
    }

    /// The serial number. `None` before it was read.
    pub(crate) fn serial(&self) -> Option<SerialNumber> {
        self.serial
    }

    /// True if the torque was off before the port was lost, and this program has not switched it since.
    pub(crate) fn must_be_off(&self) -> bool {
        self.must_be_off
    }
}
