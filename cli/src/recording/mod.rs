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
mod sink;
#[cfg(all(test, feature = "recordings"))]
pub(crate) mod tests;
#[cfg(feature = "recordings")]
mod writer;

use std::path::Path;

pub(crate) use capture::Capture;
pub(crate) use frame::{Frame, Role};
pub(crate) use sink::Sink;

use crate::error::Error;

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
