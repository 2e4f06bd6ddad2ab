//! The silence of an arm: the time in which this node has listened, and has received no reading.

use armwire::time::{Duration, Instant};

/// Maximum time by which a step adds to a silence. What a step takes longer is a hiccup of the computer, in which the node
/// did not listen: it is no silence of the arm.
const MAX_STEP: Duration = Duration::from_millis(50);

/// The silence of an arm since its last reading, by the node's steps.
pub(crate) struct Silence {
    /// The end of the last step.
    at: Instant,
    listened: Duration,
}

impl Silence {
    /// No silence at `now`.
    pub(crate) fn new(now: Instant) -> Self {
        Self {
            at: now,
            listened: Duration::ZERO,
        }
    }

    /// The silence after a step that ended at `now`.
    pub(crate) fn after_step(&mut self, now: Instant, is_received: bool) -> Duration {
        self.listened = match is_received {
            true => Duration::ZERO,
            false => self.listened + now.since(self.at).min(MAX_STEP),
        };
        self.at = now;
        self.listened
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The silence in ms after steps that end at these times in ms, with or without a reading.
    fn after(steps: &[(u64, bool)]) -> u64 {
        let mut silence = Silence::new(Instant::ZERO);
        let mut after = Duration::ZERO;
        for &(millis, is_received) in steps {
            after = silence.after_step(Instant::from_millis(millis), is_received);
        }
        after.as_micros() / 1_000
    }

    #[test]
    fn silence_is_the_time_since_a_reading() {
        assert_eq!(after(&[(5, false), (10, true), (15, false), (30, false)]), 20);
        assert_eq!(after(&[(5, false), (10, false), (15, true)]), 0);
    }

    #[test]
    fn hiccup_of_the_computer_is_no_silence() {
        assert_eq!(after(&[(5, false), (800, false), (805, false)]), 60);
    }
}
