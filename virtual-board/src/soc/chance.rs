//! Seeded random choices: the same seed gives the same run.

use std::ops::RangeInclusive;

use crate::time::Nanos;

/// A random number generator (SplitMix64).
#[derive(Clone, Debug)]
pub(crate) struct Chance(u64);

impl Chance {
    /// A separate generator for each `purpose`: an additional choice in one place does not change others.
    pub(crate) fn new(seed: u64, purpose: &str) -> Self {
        let purpose = purpose.bytes().fold(seed, |state, byte| mix(state ^ u64::from(byte)));
        Self(purpose)
    }

    pub(crate) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        mix(self.0)
    }

    /// A duration within limits, in nanoseconds.
    pub(crate) fn span(&mut self, limits: RangeInclusive<u64>) -> Nanos {
        let (least, most) = limits.into_inner();
        Nanos(least + self.next() % (most - least + 1))
    }
}

/// The choice number `index` for `purpose`.
pub(crate) fn draw(seed: u64, purpose: &str, index: u64) -> u64 {
    // FNV-1a.
    let hash = purpose.bytes().fold(0xCBF2_9CE4_8422_2325, |hash: u64, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01B3)
    });
    let step = index.wrapping_add(1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    mix(mix(seed ^ hash).wrapping_add(step))
}

fn mix(value: u64) -> u64 {
    let value = (value ^ value >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let value = (value ^ value >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
    value ^ value >> 31
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spans_stay_within_their_limits_and_vary() {
        let mut chance = Chance::new(1, "test");
        let spans: Vec<u64> = (0..1000).map(|_| chance.span(5..=8).0).collect();
        for span in 5..=8 {
            assert!(spans.contains(&span));
        }
        assert!(spans.iter().all(|span| (5..=8).contains(span)));
    }

    #[test]
    fn seed_and_a_purpose_repeat_their_choices() {
        let spans = |seed, purpose| {
            let mut chance = Chance::new(seed, purpose);
            [(); 8].map(|()| chance.span(0..=1_000_000))
        };
        assert_eq!(spans(1, "a"), spans(1, "a"));
        assert_ne!(spans(1, "a"), spans(2, "a"));
        assert_ne!(spans(1, "a"), spans(1, "b"));
    }
}
