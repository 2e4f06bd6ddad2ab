//! The rate of readings, or of moves.

use std::fmt;
use std::time::Duration;

use armwire::{OutOfRange, time};
use armwire_bridge::config::MAX_POLL_HZ;

/// Readings or moves per second, 1 to 1000.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rate(u16);

impl Rate {
    /// The maximum, in hertz.
    pub const MAX: u16 = MAX_POLL_HZ;
    /// The rate of moves if nobody asks for another one: 100 Hz.
    pub const MOVES: Self = Self(100);

    /// A rate in hertz.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] for 0 and over 1000.
    pub const fn new(hertz: u16) -> Result<Self, OutOfRange> {
        match hertz {
            1..=Self::MAX => Ok(Self(hertz)),
            got => Err(OutOfRange::new("rate", "Hz", got, 1, Self::MAX)),
        }
    }

    /// In hertz.
    pub const fn hertz(self) -> u16 {
        self.0
    }

    /// The time between two of them.
    pub fn period(self) -> Duration {
        Duration::from_secs(1) / self.0.into()
    }

    /// Writes that this rate would do, or that none would.
    pub(crate) fn write_needed(needed: Option<Self>, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match needed {
            Some(Self(hertz)) => write!(f, "{hertz} Hz would do"),
            None => write!(f, "no rate up to {} Hz would do", Self::MAX),
        }
    }

    /// The time between two of them, in whole microseconds.
    pub(crate) const fn micros(self) -> time::Duration {
        time::Duration::from_micros(1_000_000 / self.0 as u64)
    }
}
