//! Refusals of requests and commands from the bus.

use crate::control::Refusal;

/// A refused request or command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Refused {
    /// The reason.
    pub(crate) reason: Refusal,
    /// True if the sender is not silent: it sent motion for which there was no room. Its stream of motion stays alive, and
    /// none begins.
    pub(crate) keeps_stream: bool,
}

/// A refusal that keeps no stream alive.
impl From<Refusal> for Refused {
    fn from(reason: Refusal) -> Self {
        Self {
            reason,
            keeps_stream: false,
        }
    }
}
