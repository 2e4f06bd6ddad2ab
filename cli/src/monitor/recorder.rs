//! The recording of a monitor, if the user wants one.

use std::path::Path;

use armwire::Config;

use super::reading::OnFrame;
use super::tap::Tap;
use crate::args::Speaker;
use crate::describe::{Arm, Protocol};
use crate::error::Error;
use crate::link::{Line, Link};
use crate::recording::{Frame, Recording};
use crate::stamps::{Clock, now};

/// Records lines and adapters to one file, also when their port was lost.
pub(super) struct Recorder(Option<Recording>);

impl Recorder {
    pub(super) fn new(path: Option<&Path>) -> Self {
        Self(path.map(Recording::new))
    }

    /// Returns true if there is a recording.
    pub(super) fn is_on(&self) -> bool {
        self.0.is_some()
    }

    /// A link over this line, with a tap on it.
    pub(super) fn link<P>(&self, line: Box<dyn Line>, config: Config) -> Link<P>
    where
        P: Arm + Send + 'static,
        P::Expect: Send,
    {
        let line = match &self.0 {
            Some(recording) => Box::new(Tap::<P>::new(line, recording.capture())),
            None => line,
        };
        Link::new(line, config)
    }

    /// A recipient of frames that an adapter stamped.
    pub(super) fn on_frame(&self, protocol: Protocol) -> Option<OnFrame> {
        let frames = self.0.as_ref()?.sender();
        let mut clock = Clock::default();
        Some(Box::new(move |stamp, bytes| {
            let log_time = now();
            // Without a receiver nothing is recorded any more.
            let _ = frames.send(Frame {
                log_time,
                stamp: clock.system_time(stamp, log_time),
                protocol,
                from: Speaker::Arm,
                bytes: bytes.to_vec(),
            });
        }))
    }

    /// Creates the file, unless it was created before.
    pub(super) fn create(&mut self) -> Result<(), Error> {
        self.0.as_mut().map_or(Ok(()), Recording::create)
    }

    /// Writes the frames so far.
    pub(super) fn write(&mut self) -> Result<(), Error> {
        self.0.as_mut().map_or(Ok(()), Recording::write)
    }

    /// Ends the file.
    pub(super) fn finish(self) -> Result<(), Error> {
        self.0.map_or(Ok(()), Recording::finish)
    }
}
