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
pub(super) struct Leader {
    stream: Stream,
    /// The loss of its port, while that lasts.
    loss: Option<Loss>,
    exit_on_loss: bool,
}

/// The loss of a port.
struct Loss {
    reason: String,
    is_told: bool,
    /// The time of the next attempt to open it.
    retry: Instant,
}

impl Leader {
    /// Opens the leader.
    pub(super) fn open(
        port: &Port,
        baud: Option<NonZeroU32>,
        exit_on_loss: bool,
        recorder: &Recorder,
    ) -> Result<Self, Error> {
        let mut arm = open(port, baud, Kind::Leader)?;
        arm.set_interrupt(signals::check);
        recorder.tap(Role::Leader, arm.link());
        let prepared = prepare(&mut arm, recorder).and_then(|()| Ok(arm.require_own()?));
        match prepared {
            Ok(()) => Ok(Self {
                stream: arm.into_stream(),
                loss: None,
                exit_on_loss,
            }),
            Err(error) => Err(error.explained(|error| arm.explain(error))),
        }
    }

    /// The port's name.
    pub(super) fn name(&self) -> &str {
        self.stream.name()
    }

    /// The reason why the leader was lost, once.
    pub(super) fn take_loss(&mut self) -> Option<&str> {
        let loss = self.loss.as_mut().filter(|loss| !loss.is_told)?;
        loss.is_told = true;
        Some(&loss.reason)
    }

    /// Requests a reading. Tries to open a lost port while the follower waits: that takes time, in which it is not moved.
    pub(super) fn request(&mut self, follow: &Follow) -> Result<(), Error> {
        if let Some(loss) = &mut self.loss
            && loss.retry <= Instant::now()
            && matches!(follow.progress(), Progress::Starting | Progress::Waiting(..))
        {
            match self.stream.reopen() {
                Ok(()) => self.loss = None,
                Err(error @ Host::Interrupted(_)) => return Err(error.into()),
                // Another arm is on the port, or another program has it.
                Err(error @ (Host::Lost { .. } | Host::InUse { .. })) => loss.retry_for(error.to_string()),
                Err(_) => loss.retry = Instant::now() + RETRY_PERIOD,
            }
        }
        if self.loss.is_some() {
            return Ok(());
        }
        let requested = self.stream.request_joints();
        self.unless_lost(requested)
    }

    /// The readings that have arrived, after a wait of at most this long for the first byte.
    pub(super) fn receive(&mut self, wait: Duration) -> Result<Vec<StreamReading>, Error> {
        if self.loss.is_some() {
            thread::sleep(wait);
            return Ok(Vec::new());
        }
        let received = self.stream.receive(wait);
        self.unless_lost(received)
    }

    /// The result, or nothing from a leader that is lost from now on: it may come back.
    fn unless_lost<T: Default>(&mut self, result: Result<T, Host>) -> Result<T, Error> {
        match result {
            Err(error @ Host::Interrupted(_)) => Err(error.into()),
            Err(error) if self.exit_on_loss => Err(error.into()),
            Err(error) => {
                self.stream.disconnect(error.to_string().into());
                self.loss = Some(Loss {
                    reason: error.to_string(),
                    is_told: false,
                    retry: Instant::now(),
                });
                Ok(T::default())
            }
            Ok(result) => Ok(result),
        }
    }
}

impl Loss {
    /// Waits for the next attempt, for this reason.
    fn retry_for(&mut self, reason: String) {
        self.is_told &= self.reason == reason;
        (self.reason, self.retry) = (reason, Instant::now() + RETRY_PERIOD);
    }
}
