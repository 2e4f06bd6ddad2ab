//! Time as the state machines see it: microseconds on the caller's monotonic clock.

use core::ops::Add;

/// Microseconds: an instant on the caller's monotonic clock, or a span between two.
///
/// The crate never reads a clock. 64 bits do not wrap in the life of any machine.
///
/// ```
/// use armwire::Micros;
///
/// let due = Micros::from_millis(2) + Micros(50);
/// assert_eq!(due, Micros(2_050));
/// assert_eq!(due.since(Micros(2_000)), Micros(50));
/// assert_eq!(Micros(2_000).since(due), Micros(0));
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Micros(pub u64);

impl Micros {
    /// The span of `millis` milliseconds.
    pub const fn from_millis(millis: u64) -> Self {
        Self(millis.saturating_mul(1_000))
    }

    /// The span from `earlier` to `self`, or zero if `earlier` is later.
    pub const fn since(self, earlier: Self) -> Self {
        Self(self.0.saturating_sub(earlier.0))
    }
}

impl Add for Micros {
    type Output = Self;

    fn add(self, span: Self) -> Self {
        Self(self.0.saturating_add(span.0))
    }
}
