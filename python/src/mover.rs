//! A Ling arm that is moved: what its next motion depends on.

use armwire::ling::stop::{Grip, Stopped};
use armwire::ling::{GripperSpeed, JOINTS, JointState, Ling, Move, Opening, Position, Request, Speed, Torque};
use armwire_host::{Error, Link, stop_interruptibly};

use crate::session::{call, send};

/// An open arm, with what its last readings and requests say about its next motion.
pub(crate) struct Mover {
    link: Link<Ling>,
    /// The gripper's goal in the last move that was sent. `None` before, and after the torque was off: the gripper then
    /// holds nothing.
    gripper: Option<Opening>,
    /// True if the last reading did not show the torque off. False before the first one, and after the torque was
    /// switched: the next move reads first.
    may_move: bool,
}

impl Mover {
    pub(crate) fn new(link: Link<Ling>) -> Self {
        Self {
            link,
            gripper: None,
            may_move: false,
        }
    }

    /// The arm's link, for requests that no motion depends on.
    pub(crate) fn link(&mut self) -> &mut Link<Ling> {
        &mut self.link
    }

    pub(crate) fn read_joints(&mut self) -> Result<JointState, Error> {
        let state: JointState = call(&mut self.link, &Request::ReadJoints, |response| {
            response.try_into().ok()
        })?;
        self.may_move = state.status.is_holding() != Some(false);
        if !self.may_move {
            self.gripper = None;
        }
        Ok(state)
    }

    /// Reads the joints of an arm in motion.
    ///
    /// # Errors
    ///
    /// [`Error::Refused`] if the torque went off after a move. An arm that was not moved may be moved by hand.
    pub(crate) fn read_motion(&mut self) -> Result<JointState, Error> {
        let has_moved = self.has_moved();
        let state = self.read_joints()?;
        match has_moved && !self.may_move {
            true => Err(self.without_torque(&state, "the arm is not moved")),
            false => Ok(state),
        }
    }

    /// Starts a motion. An omitted gripper gets its last goal, else its reading.
    ///
    /// # Errors
    ///
    /// [`Error::Refused`] if the torque is off. It is read before the first move, and before a move after a reading
    /// that showed it off: a stream of moves costs no readings.
    pub(crate) fn move_to(
        &mut self,
        joints: [(Position, Speed); JOINTS],
        gripper: Option<Opening>,
        gripper_speed: GripperSpeed,
    ) -> Result<Grip, Error> {
        let goal = gripper.or(self.gripper);
        let (opening, grip) = match goal {
            Some(opening) if self.may_move => (opening, Grip::Goal),
            Some(opening) => {
                self.read_torque()?;
                (opening, Grip::Goal)
            }
            // As in a stop, a reading beyond the open end stands for that end.
            None => (self.read_torque()?.opening().unwrap_or(Opening::OPEN), Grip::Reading),
        };
        let gripper = (opening, gripper_speed);
        send(&mut self.link, &Request::Move(Move { joints, gripper }))?;
        self.gripper = Some(opening);
        Ok(grip)
    }

    /// True if a move was sent since the torque was last off.
    pub(crate) fn has_moved(&self) -> bool {
        self.gripper.is_some()
    }

    /// Stops the arm and keeps its torque on. An omitted gripper gets its last goal, else its reading.
    ///
    /// # Errors
    ///
    /// [`Error::NotStopped`] if the arm may still move, and errors of the line.
    pub(crate) fn stop(&mut self, gripper: Option<Opening>) -> Result<Stopped, Error> {
        self.may_move = false;
        let goal = gripper.or(self.gripper);
        let stopped = stop_interruptibly(&mut self.link, goal)?;
        match stopped {
            Stopped::AtRest { .. } => (self.gripper, self.may_move) = (goal, true),
            Stopped::WithoutTorque(_) => self.gripper = None,
        }
        Ok(stopped)
    }

    pub(crate) fn set_torque(&mut self, torque: Torque) -> Result<(), Error> {
        self.may_move = false;
        if torque == Torque::Off {
            self.gripper = None;
        }
        send(&mut self.link, &Request::SetTorque(torque))
    }

    /// Makes the current pose the zero position. The arm switches its torque off.
    pub(crate) fn set_zero(&mut self) -> Result<(), Error> {
        self.may_move = false;
        self.gripper = None;
        send(&mut self.link, &Request::SetZero)
    }

    /// A reading of an arm that may move.
    fn read_torque(&mut self) -> Result<JointState, Error> {
        let state = self.read_joints()?;
        match self.may_move {
            true => Ok(state),
            false => Err(self.without_torque(&state, "nothing was sent")),
        }
    }

    fn without_torque(&self, state: &JointState, effect: &str) -> Error {
        let status = state.status;
        let reason = format!("the torque is off (status {status}), so {effect}: set_torque(True) switches it on");
        Error::refused(self.link.name(), reason)
    }
}
