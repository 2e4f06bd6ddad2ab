//! Refusals of requests and commands from the bus.

use crate::control::Refusal;

/// A refused request or command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct RefusedRequest {
    /// The reason.
    pub reason: Refusal,
    /// True if the sender is not silent: it sent motion that had no room, or that was refused only for its speed. A
    /// stream of motion stays alive by it, and none begins.
    pub keeps_stream: bool,
}

/// A refusal that keeps no stream alive.
impl From<Refusal> for RefusedRequest {
    fn from(reason: Refusal) -> Self {
        Self {
            reason,
            keeps_stream: false,
        }
    }
}
