//! A received frame in the queue.

use armwire_bridge::can::{Frame, Id};

/// A received frame in the queue: a classic one, a quarter of the size of an FD frame.
pub(crate) struct Waiting {
    pub(super) id: Id,
    pub(super) len: usize,
    pub(super) data: [u8; 8],
}

impl Waiting {
    pub(crate) fn into_frame(self) -> Option<Frame> {
        // A DLC above 8 means 8 in a classic frame (ISO 11898-1).
        Frame::new(self.id, &self.data[..self.len.min(8)]).ok()
    }
}
