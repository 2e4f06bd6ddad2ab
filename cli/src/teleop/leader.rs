//! The leader, which may be unplugged and come back.

use std::num::NonZeroU32;
use std::thread;
use std::time::{Duration, Instant};

use armwire::ling::Kind;
use armwire_host::follow::{Follow, Progress};
use armwire_host::{Error as Host, Port, Stream, StreamReading};

use super::arm::{open, prepare};
use crate::error::Error;
use crate::monitor::{RETRY_PERIOD, Recorder};
use crate::recording::Role;
use crate::signals;

/// A leader on a port.
pub(super) struct Leader<'a> {
    port: &'a Port,
    baud: Option<NonZeroU32>,
    /// The time of the next attempt to open the port while it is lost.
    stream: Result<Stream, Instant>,
    /// Why it was lost, until this is taken.
    loss: Option<Error>,
}

impl<'a> Leader<'a> {
    /// Opens the leader.
    pub(super) fn open(port: &'a Port, baud: Option<NonZeroU32>, recorder: &Recorder) -> Result<Self, Error> {
        let stream = Ok(stream(port, baud, recorder)?);
        Ok(Self {
            port,
            baud,
            stream,
            loss: None,
        })
    }

    /// The port's name.
    pub(super) fn name(&self) -> &str {
        match &self.stream {
            Ok(stream) => stream.name(),
            Err(_) => "the leader",
        }
    }

    /// The reason why the leader was lost, once.
    pub(super) fn take_loss(&mut self) -> Option<Error> {
        self.loss.take()
    }

    /// Requests a reading. Tries to open a lost port while the follower waits: that takes time, in which it is not moved.
    pub(super) fn request(&mut self, follow: &Follow, recorder: &Recorder) -> Result<(), Error> {
        if let Err(retry) = &mut self.stream
            && *retry <= Instant::now()
            && matches!(follow.progress(), Progress::Waiting(..))
        {
            match stream(self.port, self.baud, recorder) {
                Ok(stream) => self.stream = Ok(stream),
                Err(error @ Error::Host(Host::Interrupted(_))) => return Err(error),
                Err(_) => *retry = Instant::now() + RETRY_PERIOD,
            }
        }
        match &mut self.stream {
            Ok(stream) => {
                let requested = stream.request_joints();
                self.unless_lost(requested)
            }
            Err(_) => Ok(()),
        }
    }

    /// The readings that have arrived, after a wait of at most this long for the first byte.
    pub(super) fn receive(&mut self, wait: Duration) -> Result<Vec<StreamReading>, Error> {
        let Ok(stream) = &mut self.stream else {
            thread::sleep(wait);
            return Ok(Vec::new());
        };
        let received = stream.receive(wait);
        self.unless_lost(received)
    }

    /// The result, or nothing from a leader that is lost from now on: it may come back.
    fn unless_lost<T: Default>(&mut self, result: Result<T, Host>) -> Result<T, Error> {
        match result {
            Err(error @ Host::Interrupted(_)) => Err(error.into()),
            Err(error) => {
                self.loss = Some(error.into());
                self.stream = Err(Instant::now());
                Ok(T::default())
            }
            Ok(result) => Ok(result),
        }
    }
}

/// Opens the leader on a port.
fn stream(port: &Port, baud: Option<NonZeroU32>, recorder: &Recorder) -> Result<Stream, Error> {
    let mut arm = open(port, baud, Kind::Leader)?;
    arm.set_interrupt(signals::check);
    recorder.tap(Role::Leader, arm.link());
    let prepared = prepare(&mut arm, recorder).and_then(|()| Ok(arm.require_own()?));
    match prepared {
        Ok(()) => Ok(arm.into_stream()),
        Err(error) => Err(error.explained(|error| arm.explain(error))),
    }
}
