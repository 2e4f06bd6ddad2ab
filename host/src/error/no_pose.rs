//! The reason why there is no pose.

use std::fmt::{self, Display};
use std::time::Duration;

/// The reason why there is no pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum NoPose {
    /// There is no reading yet.
    NotYet,
    /// The newest reading is too old: the arm does not answer, or a call uses it.
    Stale {
        /// Its age.
        age: Duration,
        /// The limit.
        limit: Duration,
    },
    /// The time is before the oldest reading that is kept.
    Before {
        /// By this.
        before: Duration,
    },
    /// The time is after the newest reading.
    After {
        /// By this.
        ahead: Duration,
    },
    /// The readings around the time are too far apart.
    Gap {
        /// Their distance.
        gap: Duration,
        /// The limit.
        limit: Duration,
    },
}

impl Display for NoPose {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::NotYet => write!(f, "no pose was read yet"),
            Self::Stale { age, limit } => write!(
                f,
                "the newest pose is {} old, and the limit is {}",
                Millis(age),
                Millis(limit)
            ),
            Self::Before { before } => write!(f, "the time is {} before the oldest pose", Millis(before)),
            Self::After { ahead } => write!(f, "the time is {} after the newest pose", Millis(ahead)),
            Self::Gap { gap, limit } => write!(
                f,
                "the poses around that time are {} apart, and the limit is {}",
                Millis(gap),
                Millis(limit)
            ),
        }
    }
}

/// A duration in milliseconds.
struct Millis(Duration);

impl Display for Millis {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.1} ms", self.0.as_secs_f64() * 1_000.0)
    }
}
