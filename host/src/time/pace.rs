//! Repetitions at a rate.

use armwire::time::{Duration, Instant};

use crate::time::rate::Rate;

/// The times of repetitions, on a grid: a late one does not shift the next, and missed ones are skipped.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pace {
    period: Duration,
    due: Option<Instant>,
}

impl Pace {
    /// A pace whose first repetition is due at the first call of [`begin`](Self::begin).
    pub(crate) fn new(rate: Rate) -> Self {
        Self {
            period: rate.micros(),
            due: None,
        }
    }

    pub(crate) fn period(&self) -> Duration {
        self.period
    }

    /// Begins a repetition that is due, once. Returns the number of those before it that were missed; `None` before its
    /// time.
    pub(crate) fn begin(&mut self, now: Instant) -> Option<u64> {
        let due = self.due.unwrap_or(now);
        if now < due {
            return None;
        }
        let period = self.period.as_micros();
        let missed = now.since(due).as_micros() / period;
        self.due = Some(due + Duration::from_micros(period * (missed + 1)));
        Some(missed)
    }

    /// The time of the next repetition.
    pub(crate) fn next(&self) -> Instant {
        self.due.unwrap_or(Instant::ZERO)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn missed_repetitions_are_skipped() {
        let mut pace = Pace::new(Rate::MOVES);
        let missed = [3, 12, 13, 47, 52, 53].map(|millis| pace.begin(Instant::from_millis(millis)));
        assert_eq!(missed, [Some(0), None, Some(0), Some(2), None, Some(0)]);
        assert_eq!(pace.next(), Instant::from_millis(63));
    }
}
