//! MCAP recordings of a line: every frame in both directions, and the joint positions in them, as ROS 2 messages.
//!
//! ```text
//!  line ──► capture: bytes as frames with times ──┐
//!                                                 ├─► recorder ──► writer: MCAP file
//!  adapter: frames with stamps ───────────────────┘      └─► joint_states: frames as joint positions
//! ```
//!
//! The recorder is that of [`monitor`](crate::monitor).

mod capture;
mod frame;
#[cfg(feature = "recordings")]
mod joint_states;
#[cfg(feature = "recordings")]
pub(crate) mod messages;
#[cfg(all(test, feature = "recordings"))]
pub(crate) mod tests;
#[cfg(feature = "recordings")]
mod writer;

use std::path::Path;

pub(crate) use capture::Capture;
pub(crate) use frame::{Frame, Role};

use crate::error::Error;

/// A file that takes frames. Errors are in words.
pub(crate) trait Sink {
    /// Writes a frame of an arm, and the joint positions in it.
    fn frame(&mut self, role: Role, frame: &Frame) -> Result<(), String>;

    /// Hands all to the system.
    fn flush(&mut self) -> Result<(), String>;

    /// Writes the index.
    fn finish(self: Box<Self>) -> Result<(), String>;
}

/// Creates a file of these arms at this path, where there is none.
#[cfg(feature = "recordings")]
pub(crate) fn create(path: &Path, roles: &[Role]) -> Result<Box<dyn Sink>, Error> {
    let writer = writer::Writer::new(crate::new_file::create(path)?, roles);
    let writer = writer.map_err(|error| Error::Recording {
        path: path.display().to_string(),
        reason: writer::describe(error),
    })?;
    Ok(Box::new(writer))
}

/// Reports that this build writes no files.
#[cfg(not(feature = "recordings"))]
pub(crate) fn create(_: &Path, _: &[Role]) -> Result<Box<dyn Sink>, Error> {
    Err(Error::Usage(
        "a recording needs a build with the feature 'recordings'".to_owned(),
    ))
}
