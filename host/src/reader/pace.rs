//! The times of readings.

use std::time::Duration;

/// Maximum wait for an answer, in nanoseconds. An arm answers within a millisecond, and a line adds some: CAN most.
const MAX_WAIT_NS: i64 = 100_000_000;
/// Maximum number of readings that may be unanswered at once. More would fill a line that is slower than the rate.
const MAX_UNANSWERED: usize = 8;

/// The times at which readings begin and are given up, in nanoseconds of the monotonic clock. They are on a grid: a late
/// reading does not shift the next.
#[derive(Debug)]
pub(super) struct Pace {
    period: i64,
    /// The time of the next reading.
    next: i64,
    /// The times of the last readings without an answer.
    unanswered: [Option<i64>; MAX_UNANSWERED],
}

impl Pace {
    /// The first reading is at `now`.
    pub(super) fn new(period: Duration, now: i64) -> Self {
        Self {
            period: i64::try_from(period.as_nanos()).unwrap_or(i64::MAX),
            next: now,
            unanswered: [None; MAX_UNANSWERED],
        }
    }

    /// The time of the next reading.
    pub(super) const fn next(&self) -> i64 {
        self.next
    }

    /// A reading begins now. Returns the time at which it is given up, and the number of those before it that were not
    /// begun at all. It is given up for the next one, unless too many are unanswered.
    pub(super) fn begin(&mut self, now: i64) -> (i64, u64) {
        let missed = (now - self.next).max(0) / self.period;
        self.next += (missed + 1) * self.period;
        let given_up = now + MAX_WAIT_NS;
        let is_full = self
            .unanswered
            .iter()
            .all(|at| at.is_some_and(|at| now < at + MAX_WAIT_NS));
        let until = if is_full { given_up } else { given_up.min(self.next) };
        (until, missed.unsigned_abs())
    }

    /// The reading that was begun last was given up.
    pub(super) fn lost(&mut self, now: i64) {
        self.unanswered.rotate_right(1);
        self.unanswered[0] = Some(now);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: i64 = 1_000_000;

    #[test]
    fn reading_is_given_up_for_the_next() {
        let mut pace = Pace::new(Duration::from_millis(5), 0);
        assert_eq!(pace.next(), 0);
        assert_eq!(pace.begin(MS / 10), (5 * MS, 0));
        pace.lost(5 * MS);
        assert_eq!(pace.next(), 5 * MS);
        assert_eq!(pace.begin(5 * MS), (10 * MS, 0));
    }

    #[test]
    fn slow_reading_is_given_up_early() {
        let mut pace = Pace::new(Duration::from_secs(1), 0);
        assert_eq!(pace.begin(0), (100 * MS, 0));
        assert_eq!(pace.next(), 1_000 * MS);
    }

    #[test]
    fn missed_readings_are_not_made_up_for() {
        let mut pace = Pace::new(Duration::from_millis(5), 0);
        pace.begin(0);
        assert_eq!(pace.begin(21 * MS), (25 * MS, 3));
        assert_eq!(pace.next(), 25 * MS);
    }

    #[test]
    fn slow_line_is_not_filled_with_requests() {
        let mut pace = Pace::new(Duration::from_millis(1), 0);
        for ms in 0..8 {
            assert_eq!(pace.begin(ms * MS), ((ms + 1) * MS, 0));
            pace.lost((ms + 1) * MS);
        }
        assert_eq!(pace.begin(8 * MS), (108 * MS, 0));
        // The first does not count any more.
        assert_eq!(pace.begin(101 * MS).0, 102 * MS);
    }
}
