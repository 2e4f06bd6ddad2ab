//! The recording of a monitor, if the user wants one.

use std::mem;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant};

use armwire_host::Link;
use armwire_host::describe::{Arm, Protocol};
use armwire_host::stamps::{Clock, HostTime};

use super::reading::OnFrame;
use crate::args::Speaker;
use crate::error::Error;
use crate::recording::{self, Capture, Frame, Role, Sink};

/// Maximum time for which frames are only in memory: a program that is killed loses as much.
const FLUSH_PERIOD: Duration = Duration::from_secs(1);

/// Records lines and adapters to one file, also when their port was lost.
pub(crate) struct Recorder {
    /// `None` without a recording.
    path: Option<PathBuf>,
    roles: &'static [Role],
    sender: Sender<(Role, Frame)>,
    frames: Receiver<(Role, Frame)>,
    file: Recording,
    flushed: Instant,
}

/// The file of a recording.
enum Recording {
    /// Not created before the first frame can arrive.
    Pending,
    Open(Box<dyn Sink>),
    /// Writing failed.
    Failed,
}

impl Recorder {
    /// A recorder of one arm.
    pub(super) fn new(path: Option<&Path>) -> Self {
        Self::of(path, &[Role::Only])
    }

    /// A recorder of a leader and a follower.
    pub(crate) fn of_pair(path: Option<&Path>) -> Self {
        Self::of(path, &[Role::Leader, Role::Follower])
    }

    fn of(path: Option<&Path>, roles: &'static [Role]) -> Self {
        let (sender, frames) = channel();
        Self {
            path: path.map(Path::to_owned),
            roles,
            sender,
            frames,
            file: Recording::Pending,
            flushed: Instant::now(),
        }
    }

    /// Returns true if there is a recording.
    pub(crate) fn is_on(&self) -> bool {
        self.path.is_some()
    }

    /// The link, whose bytes are recorded from now on.
    pub(super) fn tapped<P>(&self, mut link: Link<P>) -> Link<P>
    where
        P: Arm + Send + 'static,
        P::Expect: Send,
    {
        self.tap(Role::Only, &mut link);
        link
    }

    /// Records the bytes on the link of this arm from now on.
    pub(crate) fn tap<P>(&self, role: Role, link: &mut Link<P>)
    where
        P: Arm + Send + 'static,
        P::Expect: Send,
    {
        if self.is_on() {
            link.set_tap(Capture::<P>::new(role, self.sender.clone()));
        }
    }

    /// A recipient of frames that an adapter stamped.
    pub(super) fn on_frame(&self, protocol: Protocol) -> Option<OnFrame> {
        let (frames, mut clock) = (self.sender.clone(), Clock::default());
        let on_frame: OnFrame = Box::new(move |stamp, bytes| {
            let received = HostTime::now();
            // Without a receiver nothing is recorded any more.
            let frame = Frame {
                log_time: received.unix_ns,
                stamp: clock.host_time(stamp, received).unix_ns,
                protocol,
                from: Speaker::Arm,
                bytes: bytes.to_vec(),
            };
            let _ = frames.send((Role::Only, frame));
        });
        self.is_on().then_some(on_frame)
    }

    /// Creates the file, unless it was created before.
    pub(crate) fn create(&mut self) -> Result<(), Error> {
        if let Some(path) = &self.path
            && matches!(self.file, Recording::Pending)
        {
            self.file = Recording::Open(recording::create(path, self.roles)?);
        }
        Ok(())
    }

    /// Writes the frames so far.
    pub(crate) fn write(&mut self) -> Result<(), Error> {
        let Recording::Open(file) = &mut self.file else {
            return Ok(());
        };
        let mut written = self
            .frames
            .try_iter()
            .try_for_each(|(role, frame)| file.frame(role, &frame));
        if self.flushed.elapsed() >= FLUSH_PERIOD {
            written = written.and_then(|()| file.flush());
            self.flushed = Instant::now();
        }
        written.map_err(|reason| {
            self.file = Recording::Failed;
            self.failed(reason)
        })
    }

    /// Writes the last frames and the index.
    pub(crate) fn finish(mut self) -> Result<(), Error> {
        self.write()?;
        match mem::replace(&mut self.file, Recording::Failed) {
            Recording::Open(file) => file.finish().map_err(|reason| self.failed(reason)),
            Recording::Pending | Recording::Failed => Ok(()),
        }
    }

    fn failed(&self, reason: String) -> Error {
        let path = self.path.as_deref().unwrap_or(Path::new("")).display().to_string();
        Error::Recording { path, reason }
    }
}
