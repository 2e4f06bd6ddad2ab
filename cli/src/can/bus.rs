//! What this computer has of a CAN bus, whatever leads to it.

use std::time::Duration;

use armwire_bridge::can::Frame;

use crate::error::Error;

/// What this computer has of a CAN bus.
pub(crate) trait Bus: Send {
    /// What the user calls it.
    fn name(&self) -> &str;

    /// Hands a frame over to be sent.
    fn send(&mut self, frame: &Frame) -> Result<(), Error>;

    /// The next frame, waiting so long for it; none when none came.
    fn receive(&mut self, wait: Duration) -> Result<Option<Frame>, Error>;

    /// What the controller has to complain of, if anything.
    fn trouble(&mut self) -> Option<String>;

    /// What to ask oneself about its bit rate when nobody answers there.
    fn hint(&self) -> String;
}
