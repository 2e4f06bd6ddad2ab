//! The earliest of several instants.

use armwire::time::Instant;

/// Later than every real instant.
const NEVER: Instant = Instant::from_micros(u64::MAX);

/// The earliest instant so far, if there is one.
///
/// The next timeout is computed after every event: an array of options takes three times as long.
#[derive(Clone, Copy)]
pub(crate) struct Earliest(Instant);

impl Earliest {
    #[inline]
    pub(crate) fn of(instant: Option<Instant>) -> Self {
        Self(instant.unwrap_or(NEVER))
    }

    /// The earlier of this and `instant`.
    #[inline]
    pub(crate) fn or(self, instant: Option<Instant>) -> Self {
        Self(self.0.min(instant.unwrap_or(NEVER)))
    }

    #[inline]
    pub(crate) fn get(self) -> Option<Instant> {
        (self.0 != NEVER).then_some(self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn none_is_never() {
        let [a, b] = [Some(Instant::from_micros(1)), Some(Instant::from_micros(2))];
        assert_eq!(Earliest::of(None).or(None).get(), None);
        for [first, second, third] in [[a, b, None], [None, b, a], [b, None, a]] {
            assert_eq!(Earliest::of(first).or(second).or(third).get(), a);
        }
    }
}
