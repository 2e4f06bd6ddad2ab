//! Ticks of a clock and virtual time.

use crate::time::Nanos;

const SECOND: u64 = 1_000_000_000;

/// A clock that ticks `hz` times per second. It is stopped at 0 Hz.
///
/// Tick `n` begins at the first whole nanosecond that is not before `n / hz` seconds. Rounding errors do not
/// accumulate: the origin moves by whole seconds only.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Clock {
    hz: u64,
    origin: Nanos,
    /// The tick that begins at the origin.
    first: u64,
}

impl Clock {
    /// A clock whose tick `first` begins at `origin`.
    pub(crate) fn new(hz: u64, origin: Nanos, first: u64) -> Self {
        Self { hz, origin, first }
    }

    pub(crate) fn hz(&self) -> u64 {
        self.hz
    }

    /// Changes the rate. The present tick ends at the new rate.
    pub(crate) fn set_hz(&mut self, hz: u64, now: Nanos) {
        *self = Self::new(hz, now, self.tick(now));
    }

    /// The last tick that has begun at `at`.
    #[inline]
    pub(crate) fn tick(&self, at: Nanos) -> u64 {
        let passed = at.since(self.origin).0;
        if passed < SECOND {
            return self.first + passed * self.hz / SECOND;
        }
        self.first + passed / SECOND * self.hz + passed % SECOND * self.hz / SECOND
    }

    /// The first tick that begins at `at` or later.
    #[inline]
    pub(crate) fn tick_from(&self, at: Nanos) -> u64 {
        if at <= self.origin {
            return self.first;
        }
        self.tick(Nanos(at.0 - 1)) + 1
    }

    /// The beginning of `tick`, which must not be before the origin's. `None` if the clock is stopped.
    #[inline]
    pub(crate) fn instant(&self, tick: u64) -> Option<Nanos> {
        let ticks = tick - self.first;
        if ticks < self.hz {
            return Some(Nanos(self.origin.0 + (ticks * SECOND).div_ceil(self.hz)));
        }
        let seconds = ticks.checked_div(self.hz)?;
        let rest = (ticks % self.hz * SECOND).div_ceil(self.hz);
        Some(Nanos(
            self.origin
                .0
                .saturating_add(seconds.saturating_mul(SECOND))
                .saturating_add(rest),
        ))
    }

    /// Moves the origin near `now`, which makes the other functions faster.
    pub(crate) fn come_near(&mut self, now: Nanos) {
        let seconds = now.since(self.origin).0 / SECOND;
        self.origin.0 += seconds * SECOND;
        self.first += seconds * self.hz;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tick_begins_at_its_given_instant() {
        for hz in [1, 3, 32_000, 48_000_000, 160_000_000, 168_000_000] {
            let clock = Clock::new(hz, Nanos(17), 5);
            for tick in [5, 6, 7, 1_000, hz + 4, hz + 5, hz + 6, 10 * hz + 3] {
                let at = clock.instant(tick).unwrap();
                assert_eq!(clock.tick(at), tick, "{hz} Hz");
                assert_eq!(clock.tick_from(at), tick);
                assert!(clock.tick(Nanos(at.0 - 1)) < tick || tick == 5);
            }
        }
    }

    #[test]
    fn rounding_does_not_add_up() {
        let mut clock = Clock::new(168_000_000, Nanos(0), 0);
        let whole = clock;
        for second in 1..100 {
            let at = Nanos(second * 1_000_000_007);
            clock.come_near(at);
            assert_eq!(clock.tick(at), whole.tick(at));
            assert_eq!(clock.instant(1 << 40), whole.instant(1 << 40));
        }
        assert_eq!(whole.tick(Nanos(3_600 * SECOND)), 3_600 * 168_000_000);
    }

    #[test]
    fn clock_without_a_rate_stands_still() {
        let mut clock = Clock::new(0, Nanos(0), 3);
        assert_eq!((clock.tick(Nanos(5 * SECOND)), clock.instant(4)), (3, None));
        clock.set_hz(10, Nanos(SECOND));
        assert_eq!(clock.instant(4), Some(Nanos(SECOND + SECOND / 10)));
    }
}
