//! A Ling arm that is moved and read at a rate.

use std::time::{Duration, Instant};

use armwire::ling::{JointState, Move, Request, Response};

use super::Ling;
use crate::error::{Error, TorqueOffEffect};
use crate::link::LineErrors;

/// The time after a request in which its answer may come.
const MAX_DELAY: Duration = Duration::from_millis(100);

/// A Ling arm that is moved and read without waiting for answers, so that a lost one costs one reading.
///
/// Readings come in the order of their requests, but name none: a reading is as old as the line delays it. A call could
/// take one for its own answer. Hence there are none before [`into_arm`](Self::into_arm).
#[derive(Debug)]
pub struct Stream {
    arm: Ling,
    /// The time of the last request, unless a reading came since.
    requested: Option<Instant>,
    /// The last reading in the stream.
    state: Option<JointState>,
}

impl Ling {
    /// The arm, to be moved and read at a rate.
    pub fn into_stream(self) -> Stream {
        Stream {
            arm: self,
            requested: None,
            state: None,
        }
    }
}

impl Stream {
    /// Requests a reading of the joints.
    ///
    /// # Errors
    ///
    /// The line fails. [`Error::Lost`] if it fails within the request: open it again.
    pub fn request_joints(&mut self) -> Result<(), Error> {
        self.arm.link.post(&Request::ReadJoints)?;
        self.requested = Some(Instant::now());
        Ok(())
    }

    /// The readings that have arrived, after a wait of at most this long for the first byte.
    ///
    /// # Errors
    ///
    /// The line fails. [`Error::Interrupted`] after a wait without bytes.
    pub fn receive(&mut self, wait: Duration) -> Result<Vec<JointState>, Error> {
        let joints = |response: Response| match response {
            Response::Joints(state) => Some(state),
            _ => None,
        };
        let responses = self.arm.link.unsolicited(wait, joints)?.unwrap_or_default();
        let readings: Vec<_> = responses.into_iter().flatten().collect();
        for state in &readings {
            self.requested = None;
            self.state = Some(*state);
            self.arm.note(state);
        }
        Ok(readings)
    }

    /// Starts a motion.
    ///
    /// # Errors
    ///
    /// [`Error::TorqueOff`] if the last reading shows the torque off, [`Error::At`] if there is none since the torque was or
    /// may have been switched: nothing is sent. The line fails.
    pub fn move_to(&mut self, target: &Move) -> Result<(), Error> {
        match (self.arm.may_move, self.state) {
            (true, _) => self.arm.start(target),
            (false, Some(state)) => Err(self.arm.without_torque(&state, TorqueOffEffect::MotionEnded)),
            (false, None) => Err(Error::at(self.name(), "the torque was not read before the first move")),
        }
    }

    /// The arm, to be called. Waits for a reading that was requested, for 0.1 s at most. Errors of the line show in the
    /// next call.
    pub fn into_arm(mut self) -> Ling {
        while let Some(requested) = self.requested {
            let left = MAX_DELAY.saturating_sub(requested.elapsed());
            let received = self.arm.link.uninterrupted(|link| link.unsolicited(left, |_| ()));
            match received {
                // Bytes came, and with them the reading.
                Ok(Some(responses)) if !responses.is_empty() => break,
                Ok(_) if !left.is_zero() => {}
                Ok(_) | Err(_) => break,
            }
        }
        self.arm
    }

    /// The port's name, as typed by the user.
    pub fn name(&self) -> &str {
        self.arm.name()
    }

    /// Errors on the line so far.
    pub fn line_errors(&self) -> LineErrors {
        self.arm.line_errors()
    }
}
