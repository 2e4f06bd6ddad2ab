//! How long the part takes where its manual and data sheet give no single time.

use crate::soc::chance::draw;
use crate::time::Nanos;

/// How long the part takes for what may take shorter or longer: flash operations and the USB controller's own steps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Timing {
    /// The typical time.
    #[default]
    Typical,
    /// A time from the typical to the longest, drawn from the [seed](crate::Config::seed).
    Drawn,
    /// The longest time.
    Worst,
}

/// What draws times.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Clock {
    pub(crate) timing: Timing,
    pub(crate) seed: u64,
    /// How many were drawn.
    drawn: u64,
}

impl Clock {
    pub(crate) fn new(timing: Timing, seed: u64) -> Self {
        Self { timing, seed, drawn: 0 }
    }

    /// How long `what` takes this time.
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
    fn a_drawn_time_lies_between_the_typical_and_the_longest() {
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
