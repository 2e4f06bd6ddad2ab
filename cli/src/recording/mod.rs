//! MCAP recordings of a line: every frame in both directions, and the joint positions in them, as ROS 2 messages.
//!
//! ```text
//!  line ──► capture: bytes as frames with times ──┐
//!                                                 ├─► Recording ──► writer: MCAP file
//!  adapter: frames with stamps ───────────────────┘       └─► joint_states: frames as joint positions
//! ```

mod capture;
mod frame;
mod joint_states;
pub(crate) mod messages;
#[cfg(test)]
pub(crate) mod tests;
mod writer;

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant};

use crate::describe::Arm;
use crate::error::Error;
use crate::new_file;
pub(crate) use capture::Capture;
pub(crate) use frame::Frame;
use writer::Writer;

/// The longest time for which frames are only in memory: a program that is killed loses as much.
const FLUSH_PERIOD: Duration = Duration::from_secs(1);

/// A recording in progress.
pub(crate) struct Recording {
    path: PathBuf,
    sender: Sender<Frame>,
    frames: Receiver<Frame>,
    /// `None` before the first frame can come, and after an error.
    writer: Option<Writer<File>>,
    flushed: Instant,
}

impl Recording {
    pub(crate) fn new(path: &Path) -> Self {
        let (sender, frames) = channel();
        Self {
            path: path.to_owned(),
            sender,
            frames,
            writer: None,
            flushed: Instant::now(),
        }
    }

    /// A capture of a line, whose frames are written.
    pub(crate) fn capture<P: Arm>(&self) -> Capture<P> {
        Capture::new(self.sender.clone())
    }

    /// The sender of frames that are written.
    pub(crate) fn sender(&self) -> Sender<Frame> {
        self.sender.clone()
    }

    /// Creates the file, unless it is there from before.
    pub(crate) fn create(&mut self) -> Result<(), Error> {
        if self.writer.is_none() {
            let writer = Writer::new(new_file::create(&self.path)?);
            self.writer = Some(writer.map_err(|error| self.failed(error))?);
        }
        Ok(())
    }

    /// Writes the captured frames.
    pub(crate) fn write(&mut self) -> Result<(), Error> {
        let Some(writer) = &mut self.writer else {
            return Ok(());
        };
        let mut written = self.frames.try_iter().try_for_each(|frame| writer.frame(&frame));
        if self.flushed.elapsed() >= FLUSH_PERIOD {
            written = written.and_then(|()| writer.flush());
            self.flushed = Instant::now();
        }
        written.map_err(|error| {
            self.writer = None;
            self.failed(error)
        })
    }

    /// Writes the last frames and the index.
    pub(crate) fn finish(mut self) -> Result<(), Error> {
        self.write()?;
        match self.writer.take() {
            Some(writer) => writer.finish().map_err(|error| self.failed(error)),
            None => Ok(()),
        }
    }

    fn failed(&self, error: mcap::McapError) -> Error {
        let reason = match error {
            mcap::McapError::Io(error) => error.to_string(),
            other => other.to_string(),
        };
        Error::Recording {
            path: self.path.display().to_string(),
            reason,
        }
    }
}
