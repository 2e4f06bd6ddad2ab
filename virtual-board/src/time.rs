//! Virtual time, with a resolution of a nanosecond.

use std::fmt;
use std::ops::Add;

use armwire_bridge::{Duration, Instant};

/// Nanoseconds of virtual time: an instant since power-on, or a duration.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Nanos(pub u64);

impl Nanos {
    /// The span of `millis` milliseconds.
    pub const fn from_millis(millis: u64) -> Self {
        Self(millis * 1_000_000)
    }

    /// As an instant, in whole microseconds, rounded down.
    pub const fn instant(self) -> Instant {
        Instant::from_micros(self.0 / 1_000)
    }

    /// The duration from `earlier` to `self`, or zero if `earlier` is later.
    pub const fn since(self, earlier: Self) -> Self {
        Self(self.0.saturating_sub(earlier.0))
    }
}

impl Add for Nanos {
    type Output = Self;

    fn add(self, span: Self) -> Self {
        Self(self.0.saturating_add(span.0))
    }
}

impl From<Instant> for Nanos {
    fn from(instant: Instant) -> Self {
        Self(instant.as_micros().saturating_mul(1_000))
    }
}

impl From<Duration> for Nanos {
    fn from(duration: Duration) -> Self {
        Self(duration.as_micros().saturating_mul(1_000))
    }
}

/// In microseconds, with the nanoseconds as decimals.
impl fmt::Display for Nanos {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{:03} us", self.0 / 1_000, self.0 % 1_000)
    }
}
