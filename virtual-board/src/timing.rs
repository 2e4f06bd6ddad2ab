//! Durations for which the manual and the data sheet give no single value.

use crate::soc::chance::draw;
use crate::time::Nanos;

/// The choice of variable durations: flash operations and the USB controller's internal steps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Timing {
    /// The typical duration.
    #[default]
    Typical,
    /// A duration between typical and maximum, drawn from the [seed](crate::Config::seed).
    Drawn,
    /// The maximum duration.
    Worst,
}

/// The source of durations.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Clock {
    pub(crate) timing: Timing,
    pub(crate) seed: u64,
    /// Number of drawn durations.
    drawn: u64,
}

impl Clock {
    pub(crate) fn new(timing: Timing, seed: u64) -> Self {
        Self { timing, seed, drawn: 0 }
    }

    /// The duration of `what` this time.
    pub(crate) fn span(&mut self, what: &'static str, typical: Nanos, worst: Nanos) -> Nanos {
        match self.timing {
            Timing::Typical => typical,
            Timing::Worst => worst,
            Timing::Drawn => {
                self.drawn += 1;
                let range = worst.since(typical).0 + 1;
                typical + Nanos(draw(self.seed, what, self.drawn) % range)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn drawn_time_lies_between_typical_and_maximum() {
        let mut clock = Clock::new(Timing::Drawn, 7);
        let spans: Vec<Nanos> = (0..200).map(|_| clock.span("test", Nanos(10), Nanos(20))).collect();
        assert_eq!(
            (spans.iter().min(), spans.iter().max()),
            (Some(&Nanos(10)), Some(&Nanos(20)))
        );
        for (timing, span) in [(Timing::Typical, Nanos(10)), (Timing::Worst, Nanos(20))] {
            assert_eq!(Clock::new(timing, 7).span("test", Nanos(10), Nanos(20)), span);
        }
    }
}
