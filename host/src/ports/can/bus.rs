//! The interface of this computer to a CAN bus, through any adapter.

use std::time::Duration;

use armwire_bridge::can::Frame;

use crate::error::Error;

/// An interface of this computer to a CAN bus.
pub(super) trait Bus: Send {
    /// Queues a frame for transmission.
    fn send(&mut self, frame: &Frame) -> Result<(), Error>;

    /// The next frame within this time. `None` on timeout.
    fn receive(&mut self, wait: Duration) -> Result<Option<Frame>, Error>;

    /// The controller's error state, if any.
    fn error_state(&mut self) -> Option<String>;

    /// A hint about the bit rate for a missing answer.
    fn hint(&self) -> String;
}
