//! The rate of readings.

use std::time::Duration;

use armwire::OutOfRange;
use armwire_bridge::config::MAX_POLL_HZ;

/// Readings per second, 1 to 1000.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rate(u16);

impl Rate {
    /// The maximum, in hertz.
    pub const MAX: u16 = MAX_POLL_HZ;

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

    /// The time between two readings.
    pub fn period(self) -> Duration {
        Duration::from_secs(1) / self.0.into()
    }

    /// The time between two readings, in whole microseconds.
    pub(super) const fn micros(self) -> u64 {
        1_000_000 / self.0 as u64
    }
}
