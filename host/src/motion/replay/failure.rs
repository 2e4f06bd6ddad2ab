//! The reasons why a replay fails.

use std::error;
use std::fmt;

use armwire::time::Duration;

use crate::motion::axes::{Off, degrees, seconds};
use crate::motion::engine::Fault;

/// The time for the arrival at the last pose.
pub(super) const LIMIT: Duration = Duration::from_millis(2_000);

/// The reason why a replay did not end at its last pose.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Failure {
    /// The arm cannot follow.
    Fault(Fault),
    /// A joint was away from the last pose, 2 s after that was sent.
    Away(Off),
    /// This joint, from 1, still moved 2 s after the last pose was sent.
    Moving(u8),
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let limit = seconds(LIMIT);
        match self {
            Self::Fault(fault) => fault.fmt(f),
            Self::Away(Off { axis, distance, .. }) => {
                let (joint, degrees) = (axis + 1, degrees(*distance));
                write!(
                    f,
                    "joint {joint} is at rest {degrees:.1}° away from the last pose: is something in its way?"
                )
            }
            Self::Moving(joint) => write!(f, "joint {joint} still moves {limit:.0} s after the last pose was sent"),
        }
    }
}

impl error::Error for Failure {}
