//! The force-feedback leader: its control mode, and its force feedback.

use armwire::ling::mode_change::Output;
use armwire::ling::{ControlMode, ForceFeedback, ModeChange, ModeReply, ModeState, Request, Response, Speed};

use super::Ling;
use super::wait::until;
use crate::arm::shared::Shared;
use crate::arm::stop;
use crate::error::Error;
use crate::error::received::Missing;
use crate::time::stopwatch::Stopwatch;

/// A change of the control mode, which is read back.
#[derive(Debug)]
pub struct ModeSwitching {
    clock: Stopwatch,
    change: ModeChange,
    /// The last missing answer.
    missing: Option<Error>,
}

impl ModeSwitching {
    /// A change to this mode, from now on.
    pub fn new(mode: ControlMode) -> Self {
        Self {
            clock: Stopwatch::start(),
            change: ModeChange::new(mode),
            missing: None,
        }
    }

    /// Sends the request, or reads once. `None` until the mode is applied: call it again, after 20 ms. An arm that has
    /// not shown that it is a force-feedback leader is asked for its mode before.
    ///
    /// # Errors
    ///
    /// [`Error::ModeNotApplied`] if the arm refuses the mode, or does not apply it within 2 s; [`Error::NoAnswer`] if it
    /// answers nothing; [`Error::MotionRefused`] for current mode; [`Error::NoForceFeedback`] of another arm, and
    /// [`Error::Immovable`] of another robot, which do not get the request. Errors of the line that do not pass.
    pub fn step(&mut self, arm: &mut Ling) -> Result<Option<ModeState>, Error> {
        arm.require_own()?;
        if arm.has_force_feedback != Some(true) {
            arm.read_mode()?;
            self.clock = Stopwatch::start();
        }
        loop {
            match self.change.poll(self.clock.now()) {
                Output::Request(Request::ReadMode) => match arm.read_mode() {
                    Ok(state) => {
                        self.missing = None;
                        self.change.on_mode(self.clock.now(), &state);
                    }
                    Err(error) => self.note(error)?,
                },
                Output::Request(request) => match arm.send_mode(&request) {
                    Ok(reply) => self.change.on_reply(&reply),
                    Err(error) => self.note(error)?,
                },
                Output::Wait(_) => return arm.link.check_interrupt().map(|()| None),
                Output::Done(Ok(state)) => return Ok(Some(state)),
                Output::Done(Err(cause)) => {
                    return Err(self.missing.take().unwrap_or_else(|| Error::ModeNotApplied {
                        name: arm.name().into(),
                        cause,
                    }));
                }
            }
        }
    }

    /// Takes an error that may pass. Only the last request counts.
    fn note(&mut self, error: Error) -> Result<(), Error> {
        match error {
            Error::NoAnswer { .. } => self.missing = Some(error),
            error => {
                stop::passing(error)?;
            }
        }
        Ok(())
    }
}

impl Ling {
    /// Reads the control mode and the currents of a force-feedback leader. An arm that answers may be moved at any speed
    /// from [`slowest`](Self::slowest) on.
    ///
    /// # Errors
    ///
    /// [`Error::NoForceFeedback`] of an arm that answers the request for its joints, but not this one. Later calls return
    /// it at once, and send nothing. An answer that is late or damaged is [`Error::NoAnswer`].
    pub fn read_mode(&mut self) -> Result<ModeState, Error> {
        if self.has_force_feedback == Some(false) {
            return Err(self.no_force_feedback());
        }
        match self.link.read(&Request::ReadMode) {
            Ok(state) => {
                self.has_force_feedback = Some(true);
                Ok(state)
            }
            Err(Error::NoAnswer {
                missing: Missing::Silent | Missing::Elsewhere,
                ..
            }) if self.has_force_feedback.is_none() => {
                // A silent arm is the error of this reading instead.
                self.read_joints()?;
                self.has_force_feedback = Some(false);
                Err(self.no_force_feedback())
            }
            Err(error) => Err(error),
        }
    }

    /// Sets the control mode of a force-feedback leader, and waits until it is applied, at most for 2 s. The torque may be
    /// off then: after a return to position mode it is.
    ///
    /// # Errors
    ///
    /// As of [`ModeSwitching::step`].
    pub fn set_mode(&mut self, mode: ControlMode) -> Result<ModeState, Error> {
        let mut switching = ModeSwitching::new(mode);
        until(|| switching.step(self))
    }

    /// Reads the state of the force feedback.
    ///
    /// # Errors
    ///
    /// As of [`read_mode`](Self::read_mode), which is asked first if it never was.
    pub fn read_force_feedback(&mut self) -> Result<ForceFeedback, Error> {
        self.require_force_feedback()?;
        self.link.read(&Request::ReadForceFeedback)
    }

    /// Requests the force feedback, or its end. The answer says whether it is effective: with it the motors push the
    /// joints.
    ///
    /// # Errors
    ///
    /// As of [`read_force_feedback`](Self::read_force_feedback), [`Error::MotionRefused`] as of
    /// [`check_refusal`](Self::check_refusal), and [`Error::Immovable`] of another robot.
    pub fn set_force_feedback(&mut self, is_on: bool) -> Result<ForceFeedback, Error> {
        self.require_force_feedback()?;
        if is_on {
            self.require_own()?;
            self.check_refusal()?;
        }
        self.forget_motion();
        self.link.read(&Request::SetForceFeedback(is_on))
    }

    /// The slowest speed of a joint that is to move: that of a force-feedback leader after its answer to
    /// [`read_mode`](Self::read_mode).
    pub const fn slowest(&self) -> Speed {
        match self.has_force_feedback {
            Some(true) => Speed::SLOWEST_OF_FORCE_FEEDBACK,
            _ => Speed::SLOWEST,
        }
    }

    fn require_force_feedback(&mut self) -> Result<(), Error> {
        match self.has_force_feedback {
            Some(true) => Ok(()),
            _ => self.read_mode().map(drop),
        }
    }

    /// Requests a mode.
    fn send_mode(&mut self, request: &Request) -> Result<ModeReply, Error> {
        if *request == Request::SetMode(ControlMode::Current) {
            self.check_refusal()?;
        }
        self.forget_motion();
        self.link
            .read_with(request, |response: Response| ModeReply::try_from(response).ok())
    }

    /// The torque may be switched: the next move reads first.
    fn forget_motion(&mut self) {
        self.may_move = false;
        (self.gripper, self.target) = (None, None);
    }

    fn no_force_feedback(&self) -> Error {
        let name = self.name().into();
        Error::NoForceFeedback { name }
    }
}

impl Shared<Ling> {
    /// Sets the control mode, as [`Ling::set_mode`]. Other calls have their turn between two readings.
    ///
    /// # Errors
    ///
    /// As of [`Ling::set_mode`].
    pub fn set_mode(&self, mode: ControlMode) -> Result<ModeState, Error> {
        let mut switching = ModeSwitching::new(mode);
        until(|| self.call(|arm| switching.step(arm)))
    }
}

#[cfg(test)]
mod tests {
    use armwire::ling::{GripperSpeed, JOINTS, JointForce, JointMask, Move, Opening, Position};
    use armwire::messages::Messages;

    use super::*;
    use crate::arm::fake::{self, FakeLine, frame};

    /// A leader. So many of its answers for its mode arrive damaged.
    fn leader(damaged: u8) -> Ling {
        let mut left = damaged;
        let line = FakeLine::boxed(move |bytes| {
            if armwire::ling::Ling.parse_request(bytes) != Ok(Request::ReadMode) {
                return Ok(fake::holding(bytes));
            }
            let mut answer = frame(&Response::Mode(ModeState {
                mode: ControlMode::Position,
                blocked: JointMask(0),
                valid: JointMask(0x3F),
                joints: [JointForce::default(); JOINTS],
            }));
            if left > 0 {
                left -= 1;
                answer[6] ^= 1;
            }
            Ok(answer)
        });
        super::super::tests::ling(line)
    }

    #[test]
    fn damaged_answer_for_the_mode_names_no_arm() {
        // A call makes three attempts.
        let mut arm = leader(3);
        let error = arm.read_mode().unwrap_err();
        let is_damaged = matches!(
            error,
            Error::NoAnswer {
                missing: Missing::Damaged,
                ..
            }
        );
        assert!(is_damaged, "{error}");
        assert_eq!(arm.slowest(), Speed::SLOWEST);
        assert_eq!(arm.read_mode().unwrap().mode, ControlMode::Position);
        assert_eq!(arm.slowest(), Speed::SLOWEST_OF_FORCE_FEEDBACK);
    }

    #[test]
    fn leader_that_answered_for_its_mode_moves_slowly() {
        let mut arm = leader(0);
        let target = Move {
            joints: [(Position::CENTRE, Speed::SLOWEST_OF_FORCE_FEEDBACK); JOINTS],
            gripper: (Opening::OPEN, GripperSpeed(1_000)),
        };
        arm.move_to(&target).unwrap_err();
        arm.read_mode().unwrap();
        arm.move_to(&target).unwrap();
        assert!(arm.has_moved());
    }
}
