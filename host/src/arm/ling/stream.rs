//! A Ling arm that is moved and read at a rate.

use std::mem;
use std::time::Duration;

use armwire::ling::effect::Effect;
use armwire::ling::{JointState, Move, Request, Response};

use super::Ling;
use crate::arm::known::Known;
use crate::error::outside::Outside;
use crate::error::{Error, TorqueOffEffect};
use crate::ports::link::LineErrors;
use crate::time::stamps::HostTime;

/// A Ling arm that is moved and read without waiting for answers, so that a lost one costs one reading.
///
/// Each reading has the [time](armwire::Client::time_of_state) of the arm's state: a line may hold it back.
#[derive(Debug)]
pub struct Stream {
    arm: Ling,
    /// The readings that arrived before the last request, and were not received.
    arrived: Vec<StreamReading>,
    /// The last reading in the stream.
    state: Option<JointState>,
}

/// A reading of the joints in a [`Stream`].
#[derive(Clone, Copy, Debug)]
pub struct StreamReading {
    /// The arm's state.
    pub state: JointState,
    /// Its time.
    pub time: HostTime,
}

impl Ling {
    /// The arm, to be moved and read at a rate.
    pub fn into_stream(self) -> Stream {
        Stream {
            arm: self,
            arrived: Vec::new(),
            state: None,
        }
    }
}

impl Stream {
    /// Requests a reading of the joints.
    ///
    /// # Errors
    ///
    /// The line fails.
    pub fn request_joints(&mut self) -> Result<(), Error> {
        let readings = self.arm.link.start_reading(&Request::ReadJoints, joint_state)?;
        self.note(readings);
        Ok(())
    }

    /// The readings that have arrived, after a wait of at most this long for the first one.
    ///
    /// # Errors
    ///
    /// The line fails. [`Error::Interrupted`] after a wait without bytes.
    pub fn receive(&mut self, wait: Duration) -> Result<Vec<StreamReading>, Error> {
        let wait = if self.arrived.is_empty() { wait } else { Duration::ZERO };
        let readings = self.arm.link.readings(wait, joint_state)?;
        self.note(readings);
        Ok(mem::take(&mut self.arrived))
    }

    /// Takes a reading of this arm that another port delivered, such as that of an adapter which polls it.
    pub fn on_joints(&mut self, reading: StreamReading) {
        self.state = Some(reading.state);
        self.arm.note(&reading.state, reading.time);
    }

    /// Takes readings.
    fn note(&mut self, readings: Vec<(JointState, HostTime)>) {
        for (state, time) in readings {
            let reading = StreamReading { state, time };
            self.on_joints(reading);
            self.arrived.push(reading);
        }
    }

    /// Starts a motion.
    ///
    /// # Errors
    ///
    /// [`Error::TorqueOff`] if the last reading shows the torque off, [`Error::Immovable`] if it forbids motion otherwise,
    /// [`Error::At`] if there is none since the torque was or may have been switched, and of a joint speed under the arm's
    /// [`slowest`](Ling::slowest): nothing is sent. The line fails.
    pub fn move_to(&mut self, target: &Move) -> Result<(), Error> {
        self.arm.require_known_speeds(target)?;
        match (self.arm.may_move, self.state) {
            (true, _) => self.arm.start(target),
            (false, Some(state)) => Err(self.arm.immovable(&state, TorqueOffEffect::MotionEnded)),
            (false, None) => Err(Error::at(self.name(), "the torque was not read before the first move")),
        }
    }

    /// Asks the adapter, as [`Ling::check_refusal`]. It takes a round trip or more: ask before the stream, and when the
    /// joints do not follow.
    ///
    /// # Errors
    ///
    /// [`Error::MotionRefused`].
    pub fn check_refusal(&mut self) -> Result<(), Error> {
        self.arm.check_refusal()
    }

    /// Sends the request that has this effect: later readings show it. Torque-on leaves a motion as it is.
    ///
    /// # Errors
    ///
    /// The line fails.
    pub fn send(&mut self, effect: Effect) -> Result<(), Error> {
        let may_move = self.arm.may_move && !effect.drops_arm();
        self.arm.send(effect)?;
        self.arm.may_move = may_move;
        Ok(())
    }

    /// Closes a port that was lost: one that is kept open keeps its name from the device that comes back.
    pub fn disconnect(&mut self, reason: Outside) {
        self.arm.disconnect(reason);
    }

    /// Opens the port again, after a loss: see [`Ling::reopen`].
    ///
    /// # Errors
    ///
    /// As of [`Ling::reopen`].
    pub fn reopen(&mut self) -> Result<(), Error> {
        self.arrived.clear();
        self.arm.reopen()?;
        self.state = self.arm.last;
        Ok(())
    }

    /// Facts about the arm: see [`Ling::known`].
    pub fn known(&self) -> Known {
        self.arm.known()
    }

    /// The arm, to be called. No call takes an answer to the stream for its own.
    pub fn into_arm(self) -> Ling {
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

fn joint_state(response: Response) -> Option<JointState> {
    response.try_into().ok()
}
