//! Time in the state machines: microseconds on the caller's monotonic clock.

use core::ops::{Add, AddAssign, Sub};
use core::time;

use crate::OutOfRange;

/// A point in time on the caller's monotonic clock, in microseconds since an origin that the caller chooses.
///
/// The crate never reads a clock. 64 bits do not wrap within the lifetime of any machine. Sums and differences
/// saturate.
///
/// ```
/// use armwire::time::{Duration, Instant};
///
/// let due = Instant::from_micros(2_000) + Duration::from_micros(50);
/// assert_eq!(due.as_micros(), 2_050);
/// assert_eq!(due.since(Instant::from_micros(2_000)), Duration::from_micros(50));
/// assert_eq!(Instant::from_micros(2_000).since(due), Duration::ZERO);
/// assert_eq!(due - Duration::from_micros(50), Instant::from_millis(2));
/// assert_eq!(due - Duration::from_millis(3), Instant::ZERO);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Instant(u64);

impl Instant {
    /// The origin of the clock.
    pub const ZERO: Self = Self(0);

    /// The instant this many microseconds after the origin.
    pub const fn from_micros(micros: u64) -> Self {
        Self(micros)
    }

    /// The instant this many milliseconds after the origin.
    pub const fn from_millis(millis: u64) -> Self {
        Self(millis.saturating_mul(1_000))
    }

    /// Microseconds since the origin.
    pub const fn as_micros(self) -> u64 {
        self.0
    }

    /// The time from `earlier` to this instant; zero if `earlier` is later.
    pub const fn since(self, earlier: Self) -> Duration {
        Duration(self.0.saturating_sub(earlier.0))
    }
}

impl Add<Duration> for Instant {
    type Output = Self;

    // Inlined everywhere, saturation takes 0.5 kB of the adapter's flash.
    #[inline(never)]
    fn add(self, duration: Duration) -> Self {
        Self(self.0.saturating_add(duration.0))
    }
}

impl Sub<Duration> for Instant {
    type Output = Self;

    fn sub(self, duration: Duration) -> Self {
        Self(self.0.saturating_sub(duration.0))
    }
}

impl AddAssign<Duration> for Instant {
    fn add_assign(&mut self, duration: Duration) {
        *self = *self + duration;
    }
}

/// A span of time in microseconds.
///
/// ```
/// use armwire::time::Duration;
///
/// let duration = Duration::from_millis(2) + Duration::from_micros(50);
/// assert_eq!(duration, Duration::from_micros(2_050));
/// assert_eq!(core::time::Duration::from(duration), core::time::Duration::from_micros(2_050));
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Duration(u64);

impl Duration {
    /// No time.
    pub const ZERO: Self = Self(0);
    /// The longest span. An instant after it is the last one.
    pub const MAX: Self = Self(u64::MAX);

    /// The span of this many microseconds.
    pub const fn from_micros(micros: u64) -> Self {
        Self(micros)
    }

    /// The span of this many milliseconds.
    pub const fn from_millis(millis: u64) -> Self {
        Self(millis.saturating_mul(1_000))
    }

    /// Microseconds.
    pub const fn as_micros(self) -> u64 {
        self.0
    }
}

impl Add for Duration {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self(self.0.saturating_add(other.0))
    }
}

impl From<Duration> for time::Duration {
    fn from(duration: Duration) -> Self {
        Self::from_micros(duration.0)
    }
}

/// A part of a microsecond counts as a whole one: a timeout is never shorter than stated.
///
/// ```
/// use armwire::time::Duration;
///
/// let duration = core::time::Duration::from_nanos(1_001);
/// assert_eq!(Duration::try_from(duration)?, Duration::from_micros(2));
/// let error = Duration::try_from(core::time::Duration::MAX).unwrap_err();
/// assert_eq!(error.to_string(), "duration is 18446744073709551615 s, must be 0..=18446744073709");
/// # Ok::<(), armwire::OutOfRange<u64>>(())
/// ```
///
/// # Errors
///
/// [`OutOfRange`], in seconds, if the microseconds exceed 64 bits.
impl TryFrom<time::Duration> for Duration {
    type Error = OutOfRange<u64>;

    fn try_from(duration: time::Duration) -> Result<Self, OutOfRange<u64>> {
        const SECOND: u64 = 1_000_000;
        let part = u64::from(duration.subsec_nanos().div_ceil(1_000));
        let micros = duration.as_secs().checked_mul(SECOND);
        match micros.and_then(|micros| micros.checked_add(part)) {
            Some(micros) => Ok(Self(micros)),
            None => Err(OutOfRange::new(
                "duration",
                "s",
                duration.as_secs(),
                0,
                u64::MAX / SECOND,
            )),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn longest_durations_convert_or_are_refused() {
        let longest = Duration(u64::MAX);
        let exact = time::Duration::from(longest);
        assert_eq!(Duration::try_from(exact), Ok(longest));
        let tick = time::Duration::from_nanos(1);
        assert_eq!(Duration::try_from(exact - tick), Ok(longest));
        assert!(Duration::try_from(exact + tick).is_err());
        assert_eq!(Duration::try_from(time::Duration::ZERO), Ok(Duration::ZERO));
    }
}
