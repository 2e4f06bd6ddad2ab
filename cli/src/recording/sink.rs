//! Files that take frames.

use super::{Frame, Role};

/// A file that takes frames. Errors are in words.
pub(crate) trait Sink {
    /// Writes a frame of an arm, and the joint positions in it.
    fn frame(&mut self, role: Role, frame: &Frame) -> Result<(), String>;

    /// Hands all to the system.
    fn flush(&mut self) -> Result<(), String>;

    /// Writes the index.
    fn finish(self: Box<Self>) -> Result<(), String>;
}
