//! A reading, and the end of all readings.

use std::time::Duration;

use armwire::ling::legacy::OlderGeneration;

use crate::error::Error;
use crate::error::outside::Outside;
use crate::time::stamps::HostTime;

/// A pose at its time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading<P> {
    /// The pose.
    pub pose: P,
    /// The number of the reading, from 1. Of a pose between two readings, that of the earlier.
    pub number: u64,
    /// The time of the pose.
    pub time: HostTime,
    /// Event at the time of the reading.
    pub stamping: Stamping,
    /// The time since then, when this was returned.
    pub age: Duration,
}

/// Event at the time of a reading.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Stamping {
    /// The arrival of the answer's last byte at the adapter, by its clock.
    Adapter,
    /// The receipt of the answer by this program: later by the delays of the line and of the system, at most 10 ms. The
    /// request of an answer that took longer: the line, or the arm, may have held it back.
    Receipt,
}

/// Counts since the reader's start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Counts {
    /// Readings.
    pub samples: u64,
    /// Readings without an acceptable answer in time, or lost on the way from the adapter.
    pub lost: u64,
    /// Readings that were not begun: a call used the arm, an answer took longer than a period, or the system was busy.
    pub missed: u64,
}

/// The reason why there are no readings: after a loss there may be some again.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum End {
    Lost(Outside),
    Legacy(OlderGeneration),
    Closed,
}

impl End {
    /// The end by an error; `None` if a later reading may succeed.
    pub(super) fn by(error: Error) -> Option<Self> {
        match error {
            Error::Lost { reason, .. } => Some(Self::Lost(reason)),
            Error::Legacy { legacy, .. } => Some(Self::Legacy(legacy)),
            Error::Closed { .. } => Some(Self::Closed),
            _ => None,
        }
    }
}
