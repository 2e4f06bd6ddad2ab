//! What a monitor learns of an arm.

use armwire_bridge::control::Stamp;

use crate::control::ControlLink;
use crate::describe::{Arm, Fact};
use crate::error::Error;
use crate::link::Link;

/// What comes from a [`Source`].
#[derive(Clone, Debug)]
pub(super) enum News {
    /// How the arm is, and when it said so by the adapter's clock, if that is known. Of one arm all readings have the same
    /// items.
    Reading(Vec<Fact>, Option<Stamp>),
    /// The temperatures of its servos, in °C.
    Celsius(Vec<u8>),
    /// Something to tell the user.
    Notice(String),
    /// Nothing so far.
    Nothing,
}

/// Where readings come from.
pub(super) trait Source {
    /// What arm it is.
    fn arm(&self) -> &'static str;

    /// How many temperatures such an arm can have.
    fn servos(&self) -> usize {
        0
    }

    /// Whether the arm is asked for each reading. Otherwise it is listened to.
    fn is_asked(&self) -> bool {
        true
    }

    /// Whether it is for us to say how often there is a reading.
    fn is_paced(&self) -> bool {
        true
    }

    /// Asks the arm, or listens for a moment.
    fn read(&mut self) -> Result<News, Error>;

    /// Asks for the temperatures, of an arm that has them.
    fn read_celsius(&mut self) -> Result<News, Error> {
        Ok(News::Nothing)
    }

    /// Asks for the stroke of the gripper, of an arm that has one. The answer is for a recording.
    fn read_stroke(&mut self) -> Result<News, Error> {
        Ok(News::Nothing)
    }

    /// What was wrong with what came.
    fn line_errors(&self) -> LineErrors;

    /// The adapter, of a source that has it.
    fn adapter(&mut self) -> Option<&mut ControlLink> {
        None
    }
}

/// What is wrong with what comes over a line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct LineErrors {
    /// Bytes that were no part of a frame.
    pub(super) noise_bytes: usize,
    /// Frames with a wrong checksum.
    pub(super) checksums: usize,
}

impl LineErrors {
    /// These and others.
    pub(super) const fn and(self, other: Self) -> Self {
        Self {
            noise_bytes: self.noise_bytes + other.noise_bytes,
            checksums: self.checksums + other.checksums,
        }
    }

    /// What was wrong with what came over a link.
    pub(super) fn of<P: Arm>(link: &Link<P>) -> Self {
        Self {
            noise_bytes: link.dropped(),
            checksums: link.checksums(),
        }
    }
}
