//! The wait for an answer.

use armwire::time::{Duration, Instant};

/// Maximum wait for one answer: a limit of the answer, not of the arm's silence. An arm answers within a millisecond, and
/// a line adds some: CAN most.
const MAX_WAIT: Duration = Duration::from_millis(100);
/// Maximum number of readings that may be unanswered at once. More would fill a line that is slower than the rate.
const MAX_UNANSWERED: usize = 8;

/// The wait of readings for their answers.
#[derive(Debug, Default)]
pub(super) struct Patience {
    /// The times at which the last readings without an answer were given up.
    unanswered: [Option<Instant>; MAX_UNANSWERED],
}

impl Patience {
    /// The time at which a reading that begins now is given up: that of the next one, unless too many are unanswered.
    pub(super) fn end(&self, now: Instant, next: Instant) -> Instant {
        let given_up = now + MAX_WAIT;
        let is_full = self
            .unanswered
            .iter()
            .all(|at| at.is_some_and(|at| now < at + MAX_WAIT));
        if is_full { given_up } else { given_up.min(next) }
    }

    /// The reading that was begun last was given up.
    pub(super) fn lost(&mut self, now: Instant) {
        self.unanswered.rotate_right(1);
        self.unanswered[0] = Some(now);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn ms(millis: u64) -> Instant {
        Instant::from_millis(millis)
    }

    #[test]
    fn reading_is_given_up_for_the_next() {
        let mut patience = Patience::default();
        assert_eq!(patience.end(ms(0), ms(5)), ms(5));
        patience.lost(ms(5));
        assert_eq!(patience.end(ms(5), ms(10)), ms(10));
    }

    #[test]
    fn slow_reading_is_given_up_early() {
        assert_eq!(Patience::default().end(ms(0), ms(1_000)), ms(100));
    }

    #[test]
    fn slow_line_is_not_filled_with_requests() {
        let mut patience = Patience::default();
        for millis in 0..8 {
            assert_eq!(patience.end(ms(millis), ms(millis + 1)), ms(millis + 1));
            patience.lost(ms(millis + 1));
        }
        assert_eq!(patience.end(ms(8), ms(9)), ms(108));
        // The first does not count any more.
        assert_eq!(patience.end(ms(101), ms(102)), ms(102));
    }
}
