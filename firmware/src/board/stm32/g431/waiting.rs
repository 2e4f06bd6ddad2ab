//! A received frame in the queue.

use armwire_bridge::can::Frame;

/// A received frame in the queue.
pub(crate) struct Waiting(pub(super) Frame);

impl Waiting {
    pub(crate) fn into_frame(self) -> Option<Frame> {
        Some(self.0)
    }
}
