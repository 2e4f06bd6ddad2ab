//! A Ling arm: its requests, and what a motion depends on.

mod force_feedback;
mod park;
mod reopen;
mod stream;
mod wait;

use std::fmt;
use std::time::{Duration, Instant};

use armwire::ling::effect::{Effect, Outcome};
use armwire::ling::stop::{Grip, Stopped};
use armwire::ling::{
    GripperSpeed, Info, JOINTS, JointState, MotionStatus, Move, Opening, PerServo, Position, Request, SelfCheck, Speed,
    Stop, Stroke, TemperatureLimit, Torque,
};
use armwire_bridge::control::StopInForce;

use crate::arm::known::Known;
use crate::arm::legacy;
use crate::arm::pose::OnPose;
use crate::arm::refusals::Refusals;
use crate::arm::shared::Shared;
use crate::arm::stop;
use crate::error::text::Text;
use crate::error::{Error, SilentMotion, TorqueOffEffect};
use crate::ports::control::Adapter;
use crate::ports::interrupt::Interrupt;
use crate::ports::link::{LineErrors, Link};
use crate::ports::port::Connection;
use crate::time::silence::SilenceLimit;
use crate::time::stamps::HostTime;

pub use force_feedback::ModeSwitching;
pub use park::Parking;
pub use stream::{Stream, StreamReading};
pub use wait::{MotionReadings, Switching, Wait};

/// A Ling arm on a port, which [`Connection::ling`] opens.
///
/// Every call fails with an [`Error`]: the line fails, or no acceptable answer arrives. A read is repeated after a timeout.
/// A call that only sends has no answer: read back what it changes.
///
/// ```no_run
/// use std::time::Duration;
///
/// use armwire::ling::arrival::Tolerances;
/// use armwire::ling::{GripperSpeed, Move, Speed};
///
/// let mut arm = armwire_host::open("/dev/ttyUSB0")?.ling()?;
/// let pose = arm.read_joints()?;
/// let speed = Speed::new(300)?;
/// let target = Move {
///     joints: pose.positions()?.map(|position| (position, speed)),
///     gripper: (pose.opening()?, GripperSpeed(1000)),
/// };
/// arm.move_and_wait(&target, Tolerances::MOVE, Duration::from_secs(5))?;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Ling {
    link: Link<armwire::ling::Ling>,
    connection: Connection,
    /// The gripper's goal in the last move that was sent. `None` before, and after the torque was off: the gripper then
    /// holds nothing.
    gripper: Option<Opening>,
    /// The last move that was sent. `None` as for the gripper, and after what may have given the joints another goal: a
    /// request by the link, silence, a stop that failed.
    target: Option<Move>,
    /// True if the last reading [permits motion](armwire::ling::MotionStatus::check_motion). False before the first one,
    /// and after the torque was or may have been switched: the next move reads first.
    may_move: bool,
    /// The number of stops. Another call that moves the arm in steps ends with one.
    stops: usize,
    /// The last reading of the joints since the last move.
    last: Option<JointState>,
    /// True if the last reading was an Alicia-D's.
    is_own: bool,
    /// True if the arm has answered the request for its control mode, false if it has not. `None` before.
    has_force_feedback: Option<bool>,
    /// Facts by which the arm is known after a loss of its port.
    known: Known,
    /// The adapter's refusals of motion.
    refusals: Refusals,
    /// Gets each reading of the joints.
    pub(crate) on_pose: Option<OnPose<JointState>>,
}

impl Connection {
    /// Opens the line of a Ling arm and listens for 0.1 s, because an arm of the older generation must be sent nothing.
    /// Unsolicited bytes received meanwhile are discarded. No other call opens the line of a Ling arm:
    ///
    /// ```compile_fail,E0624
    /// # fn ling(connection: &armwire_host::Connection) {
    /// connection.arm::<armwire::ling::Ling>();
    /// # }
    /// ```
    ///
    /// # Errors
    ///
    /// The line cannot be opened. [`Error::Legacy`], now and from every later call, when the arm is one of the older
    /// generation.
    pub fn ling(&self) -> Result<Ling, Error> {
        let (line, config) = legacy::open(self)?;
        Ok(Ling {
            link: Link::new(line, config),
            connection: self.clone(),
            gripper: None,
            target: None,
            may_move: false,
            stops: 0,
            last: None,
            is_own: false,
            has_force_feedback: None,
            known: Known::default(),
            refusals: Refusals::default(),
            on_pose: None,
        })
    }
}

impl Ling {
    /// The time without an answer after which an arm in motion is asked to stop.
    pub const SILENCE: Duration = Duration::from_micros(SilenceLimit::STOP.least().as_micros());

    /// Reads the arm's kind, serial number and versions.
    pub fn read_info(&mut self) -> Result<Info, Error> {
        let info: Info = self.link.read(&Request::ReadInfo)?;
        self.known.note_serial(info.serial);
        Ok(info)
    }

    /// Reads the joint positions, the gripper and the motion status.
    pub fn read_joints(&mut self) -> Result<JointState, Error> {
        let state: JointState = self.link.read(&Request::ReadJoints)?;
        self.note(&state, self.link.time_of_state());
        Ok(state)
    }

    /// Reads the joints once, as one of many readings. Returns false without an answer until this time.
    ///
    /// The answer may be one to an earlier request: it permits no move, and only forbids one.
    pub(crate) fn read_joints_until(&mut self, until: Instant) -> Result<bool, Error> {
        let (on_pose, may_move, known) = (&mut self.on_pose, &mut self.may_move, &mut self.known);
        let convert = |response| JointState::try_from(response).ok();
        self.link
            .read_until(&Request::ReadJoints, until, convert, |state, time| {
                if let Some(on_pose) = on_pose {
                    on_pose(state, time);
                }
                known.note(state.status);
                *may_move &= state.status.check_motion().is_ok();
            })
    }

    /// The adapter on this arm's port. `None` without one.
    pub(crate) fn find_adapter(&self) -> Result<Option<Adapter>, Error> {
        match self.connection.adapter() {
            Err(Error::NoControl { .. }) => Ok(None),
            adapter => adapter.map(Some),
        }
    }

    /// Takes the adapter whose control port a reader of this arm has.
    pub(crate) fn lend_adapter(&mut self, adapter: Shared<Adapter>) {
        self.refusals.lend(adapter);
    }

    /// Reads the joints of an arm that is to move.
    ///
    /// # Errors
    ///
    /// [`Error::TorqueOff`] if the torque is off, [`Error::Immovable`] for a status that no document explains, and for
    /// another robot.
    pub fn require_torque(&mut self) -> Result<JointState, Error> {
        let state = self.read_joints()?;
        match self.may_move {
            true => Ok(state),
            false => Err(self.immovable(&state, TorqueOffEffect::NothingSent)),
        }
    }

    /// Asks the adapter on this port whether it refuses motion. Without one, without an answer, and while another program
    /// has its control port, that is not known.
    ///
    /// # Errors
    ///
    /// [`Error::MotionRefused`] while it does: the arm does not go to its last goal, which is forgotten.
    pub fn check_refusal(&mut self) -> Result<(), Error> {
        let stop = self.refusals.ask(&self.connection);
        self.unless_refused(stop)
    }

    /// As [`check_refusal`](Self::check_refusal), once a second at most.
    fn check_refusal_in_wait(&mut self) -> Result<(), Error> {
        let stop = self.refusals.in_wait(&self.connection);
        self.unless_refused(stop)
    }

    fn unless_refused(&mut self, stop: Option<StopInForce>) -> Result<(), Error> {
        let Some(stop) = stop else {
            return Ok(());
        };
        self.target = None;
        let name = self.name().into();
        Err(Error::MotionRefused { name, stop })
    }

    /// Checks that the arm is an Alicia-D. One that has shown it is not asked again.
    ///
    /// # Errors
    ///
    /// [`Error::Immovable`] for another robot.
    pub fn require_own(&mut self) -> Result<(), Error> {
        if self.is_own {
            return Ok(());
        }
        let state = self.read_joints()?;
        match self.is_own {
            true => Ok(()),
            false => Err(self.immovable(&state, TorqueOffEffect::NothingSent)),
        }
    }

    /// Reads the temperature of every servo, in °C.
    pub fn read_temperatures(&mut self) -> Result<PerServo<u8>, Error> {
        self.link.read(&Request::ReadTemperatures)
    }

    /// Reads the velocity of every servo, in ticks per second.
    pub fn read_velocities(&mut self) -> Result<PerServo<u16>, Error> {
        self.link.read(&Request::ReadVelocities)
    }

    /// Reads the configured stroke of the gripper.
    pub fn read_stroke(&mut self) -> Result<Stroke, Error> {
        self.link.read(&Request::ReadStroke)
    }

    /// Runs a self-check of every servo.
    pub fn self_check(&mut self) -> Result<SelfCheck, Error> {
        self.link.read(&Request::SelfCheck)
    }

    /// Starts a motion. The arm does not confirm it: read the joints to follow it.
    ///
    /// # Errors
    ///
    /// [`Error::At`] of a joint speed under the arm's [`slowest`](Self::slowest). [`Error::TorqueOff`],
    /// [`Error::Immovable`] and [`Error::MotionRefused`]. The arm is not moved by any of them. The joints are read
    /// before the first move, and before a move after a reading that forbade it. The adapter is asked as by
    /// [`check_refusal`](Self::check_refusal), in a stream of moves once a second.
    pub fn move_to(&mut self, target: &Move) -> Result<(), Error> {
        self.require_known_speeds(target)?;
        if !self.may_move {
            self.require_torque()?;
        }
        let stop = self.refusals.before_move(&self.connection);
        self.unless_refused(stop)?;
        self.start(target)
    }

    /// Starts a motion, as [`move_to`](Self::move_to). An omitted gripper gets its last goal, else its reading: a grip may
    /// loosen then. Returns which it was.
    ///
    /// # Errors
    ///
    /// As of [`move_to`](Self::move_to).
    pub fn move_joints(
        &mut self,
        joints: [(Position, Speed); JOINTS],
        gripper: Option<Opening>,
        gripper_speed: GripperSpeed,
    ) -> Result<Grip, Error> {
        let (opening, grip) = match gripper.or(self.gripper) {
            Some(goal) => (goal, Grip::Goal),
            // As in a stop, a reading beyond the open end stands for that end.
            None => (self.require_torque()?.opening().unwrap_or(Opening::OPEN), Grip::Reading),
        };
        let gripper = (opening, gripper_speed);
        self.move_to(&Move { joints, gripper })?;
        Ok(grip)
    }

    /// Runs `motion`, which gives the gripper this goal. If the [interrupt](Self::set_interrupt) returns an error meanwhile
    /// or afterwards, the arm is stopped, whatever `motion` returns.
    ///
    /// # Errors
    ///
    /// [`Error::Stopped`] after an interrupt, or the error of the stop. Its reason is the interrupt's error if the
    /// check still returns one, else that error's text. Otherwise the error of `motion`, and [`Error::Interrupted`]
    /// before it.
    pub fn stop_if_interrupted<T, E: From<Error>>(
        &mut self,
        gripper: Opening,
        motion: impl FnOnce(&mut Self) -> Result<T, E>,
    ) -> Result<T, E> {
        self.link.check_interrupt()?;
        self.link.take_interrupted();
        let result = motion(self);
        self.unless_interrupted(gripper, result)
    }

    /// The result, unless the interrupt reports an error now, or has since it was last taken: the arm is stopped then.
    fn unless_interrupted<T, E: From<Error>>(&mut self, gripper: Opening, result: Result<T, E>) -> Result<T, E> {
        let checked = self.link.check_interrupt();
        let reason = match (checked, self.link.take_interrupted()) {
            (Err(Error::Interrupted(reason)), _) => reason,
            (_, Some(reason)) => reason.into(),
            (_, None) => return result,
        };
        let stopped = self.stop(Some(gripper))?;
        let name = self.link.name().into();
        Err(Error::Stopped { name, stopped, reason }.into())
    }

    /// Forgets the joints' goal: the next stop holds an arm that stands at its reading, and one that presses against
    /// something gives way. A loaded joint sinks then, by the distance at which it rests from its goal.
    pub fn forget_goal(&mut self) {
        self.target = None;
    }

    /// Stops the arm and keeps its torque on, as [`Stop`] describes. Takes 2 s at most, and the timeout of one read. An
    /// arm that stands at its last goal is held there. An omitted gripper gets its last goal, else its reading: a grip may
    /// loosen then. The [interrupt](Self::set_interrupt) does not end the stop: an interrupted program calls it.
    ///
    /// # Errors
    ///
    /// [`Error::NotStopped`] if the arm may still move; [`Error::Lost`] and [`Error::Legacy`]. After any other error a
    /// request is repeated.
    pub fn stop(&mut self, gripper: Option<Opening>) -> Result<Stopped, Error> {
        self.stop_by(gripper, stop::stop)
    }

    /// As [`stop`](Self::stop), but the interrupt ends it, as [`Error::Interrupted`]: the caller has taken the one that the
    /// stop is for.
    ///
    /// # Errors
    ///
    /// As [`stop`](Self::stop), and [`Error::Interrupted`].
    pub fn stop_interruptibly(&mut self, gripper: Option<Opening>) -> Result<Stopped, Error> {
        self.stop_by(gripper, stop::stop_interruptibly)
    }

    /// Switches the torque, and reads it back. With torque off the arm falls.
    ///
    /// # Errors
    ///
    /// [`Error::NoEffect`] if the arm shows for 0.5 s that the torque was not switched, or gives no acceptable answer;
    /// [`Error::NoAnswer`] if it gives none. [`Error::Immovable`] for torque-on of another robot: nothing is sent.
    pub fn set_torque(&mut self, torque: Torque) -> Result<Outcome, Error> {
        self.switch(Effect::Torque(torque))
    }

    /// Makes the present pose the zero position, and reads it back. The arm switches its torque off, and falls.
    ///
    /// # Errors
    ///
    /// [`Error::NoEffect`] if the joints are not at zero for 0.5 s, or the arm gives no acceptable answer;
    /// [`Error::NoAnswer`] if it gives none. [`Error::Immovable`] for another robot: nothing is sent.
    pub fn set_zero(&mut self) -> Result<Outcome, Error> {
        self.switch(Effect::Zero)
    }

    /// As [`send`](Self::send), but another robot than an Alicia-D gets torque-off only.
    fn send_to_own(&mut self, effect: Effect) -> Result<(), Error> {
        if effect != Effect::Torque(Torque::Off) {
            self.require_own()?;
        }
        self.send(effect)
    }

    /// Sends the request that has this effect, and reads nothing back.
    pub fn send(&mut self, effect: Effect) -> Result<(), Error> {
        self.may_move = false;
        // Also a request that is cut short may arrive.
        self.known.note_switching(effect.drops_arm());
        self.link.send(&effect.request())?;
        if effect.drops_arm() {
            (self.gripper, self.target) = (None, None);
        }
        Ok(())
    }

    /// Sets the stroke of the gripper.
    pub fn set_stroke(&mut self, stroke: Stroke) -> Result<(), Error> {
        self.link.send(&Request::SetStroke(stroke))
    }

    /// Sets the temperature limit of the overheat protection.
    pub fn set_temperature_limit(&mut self, limit: TemperatureLimit) -> Result<(), Error> {
        self.link.send(&Request::SetTemperatureLimit(limit))
    }

    /// True if a move was sent since the torque was last off.
    pub fn has_moved(&self) -> bool {
        self.gripper.is_some()
    }

    /// Makes calls run this check at least every 100 ms while they wait, for Ctrl-C. Its error ends the call, as
    /// [`Error::Interrupted`], and stops the arm if [`move_and_wait`](Self::move_and_wait) runs.
    pub fn set_interrupt(&mut self, check: impl FnMut() -> Interrupt + Send + 'static) {
        self.link.set_interrupt(check);
    }

    /// The port's name, as typed by the user.
    pub fn name(&self) -> &str {
        self.link.name()
    }

    /// Errors on the line so far.
    pub fn line_errors(&self) -> LineErrors {
        self.link.line_errors()
    }

    /// Adds to an error what others know: see [`Connection::explain`].
    #[must_use]
    pub fn explain(&self, error: Error) -> Error {
        self.connection.explain(error)
    }

    /// The frame that ended the last call: see [`Link::frame`].
    pub fn frame(&self) -> &[u8] {
        self.link.frame()
    }

    /// The arm's link, for any request. A move by it is not known here: [`move_to`](Self::move_to) is for moves. The
    /// next one reads the torque first, for a request by the link may switch it.
    pub fn link(&mut self) -> &mut Link<armwire::ling::Ling> {
        self.may_move = false;
        self.target = None;
        &mut self.link
    }

    /// The arm's link alone.
    pub fn into_link(self) -> Link<armwire::ling::Ling> {
        self.link
    }

    /// Takes a reading of the arm's state at this time.
    fn note(&mut self, state: &JointState, time: HostTime) {
        if let Some(on_pose) = &mut self.on_pose {
            on_pose(*state, time);
        }
        self.last = Some(*state);
        self.is_own = !matches!(state.status, MotionStatus::Foreign(_));
        self.known.note(state.status);
        self.may_move = self.permits_motion(state);
        if state.status.is_torque_off() {
            (self.gripper, self.target) = (None, None);
        }
    }

    /// True if a reading, the last one, permits motion.
    fn permits_motion(&self, state: &JointState) -> bool {
        state.status.check_motion().is_ok() && !self.known.must_be_off()
    }

    /// Fails if a joint's speed is one that the arm may take for 0.
    fn require_known_speeds(&self, target: &Move) -> Result<(), Error> {
        for (_, speed) in target.joints {
            Speed::from_slowest(self.slowest(), speed.ticks_per_second())
                .map_err(|error| Error::at(self.name(), error))?;
        }
        Ok(())
    }

    /// Sends a move.
    fn start(&mut self, target: &Move) -> Result<(), Error> {
        let (gripper, _speed) = target.gripper;
        self.link.send(&Request::Move(*target))?;
        (self.gripper, self.target) = (Some(gripper), Some(*target));
        self.last = None;
        Ok(())
    }

    fn stop_by(
        &mut self,
        gripper: Option<Opening>,
        drive: impl FnOnce(&mut Link<armwire::ling::Ling>, &mut Stop) -> Result<Stopped, Error>,
    ) -> Result<Stopped, Error> {
        self.may_move = false;
        self.stops += 1;
        let gripper = gripper.or(self.gripper);
        let mut stop = match (self.target.take(), gripper) {
            (Some(mut target), Some(gripper)) => {
                target.gripper.0 = gripper;
                Stop::after(&target)
            }
            (_, gripper) => Stop::new(gripper),
        };
        let stopped = drive(&mut self.link, &mut stop)?;
        match stopped {
            Stopped::AtRest { state, .. } => {
                self.known.note(state.status);
                (self.gripper, self.may_move) = (gripper, self.permits_motion(&state));
                self.target = stop.held().copied();
            }
            Stopped::WithoutTorque(state) => {
                self.known.note(state.status);
                self.gripper = None;
            }
        }
        Ok(stopped)
    }

    /// Stops an arm that is silent for this cause.
    fn unanswered(&mut self, cause: Text, gripper: Opening) -> Error {
        let last = self.last;
        // The arm may have been switched off and on.
        self.target = None;
        let stopped = self.stop(Some(gripper)).map_err(|error| match error {
            Error::NotStopped { cause, .. } => cause,
            error => error.to_string().into(),
        });
        Error::Unanswered {
            name: self.link.name().into(),
            silence: Box::new(SilentMotion { cause, last, stopped }),
        }
    }

    /// The error of a motion that this reading forbids.
    fn immovable(&self, state: &JointState, effect: TorqueOffEffect) -> Error {
        match state.status.check_motion() {
            Ok(()) if self.known.must_be_off() => Error::TorqueSwitched {
                name: self.link.name().into(),
            },
            Err(reason) if !state.status.is_torque_off() => Error::Immovable {
                name: self.link.name().into(),
                reason,
                effect,
            },
            _ => self.without_torque(state, effect),
        }
    }

    fn without_torque(&self, state: &JointState, effect: TorqueOffEffect) -> Error {
        Error::TorqueOff {
            name: self.link.name().into(),
            status: state.status,
            effect,
        }
    }
}

impl fmt::Debug for Ling {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Ling")
            .field("name", &self.name())
            .field("gripper", &self.gripper)
            .field("may_move", &self.may_move)
            .finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc;

    use armwire::ling::{ControlMode, Frame, JointForce, JointMask, Ling as Protocol, MAX_FRAME, ModeState, Response};
    use armwire::messages::Messages;
    use armwire_bridge::control::{self, FromAdapter, FromHost, Initiator, Reply};

    use super::*;
    use crate::arm::fake::{self, FakeLine, frame};
    use crate::describe::Arm;
    use crate::ports::control::{Received, Transport};
    use crate::ports::line::Line;

    /// An arm on this line.
    pub(super) fn ling(line: Box<dyn Line>) -> Ling {
        Ling {
            link: Link::new(line, Protocol::CONFIG),
            connection: crate::open("/dev/fake").unwrap(),
            gripper: None,
            target: None,
            may_move: false,
            stops: 0,
            last: None,
            is_own: false,
            has_force_feedback: None,
            known: Known::default(),
            refusals: Refusals::default(),
            on_pose: None,
        }
    }

    fn holding() -> Ling {
        ling(FakeLine::boxed(|bytes| Ok(fake::holding(bytes))))
    }

    /// The answer of a robot with two arms that answers for its control mode as a force-feedback leader. `None` for a change.
    fn answer_of_two_arms(request: &Request) -> Option<Vec<u8>> {
        match request {
            Request::ReadMode => Some(frame(&Response::Mode(ModeState {
                mode: ControlMode::Position,
                blocked: JointMask(0),
                valid: JointMask(0),
                joints: [JointForce::default(); JOINTS],
            }))),
            Request::ReadJoints => {
                let (command, function, data) = (0x06, 0x00, &[0; 33][..]);
                let mut out = [0; MAX_FRAME];
                let frame = Frame {
                    command,
                    function,
                    data,
                };
                let n = frame.encode(&mut out).unwrap();
                Some(out[..n].to_vec())
            }
            _ => None,
        }
    }

    #[test]
    fn another_robot_gets_no_force_feedback() {
        let (changes, sent) = mpsc::channel();
        let mut arm = ling(FakeLine::boxed(move |bytes| {
            let request = Protocol.parse_request(bytes).unwrap();
            Ok(answer_of_two_arms(&request).unwrap_or_else(|| {
                changes.send(request).unwrap();
                Vec::new()
            }))
        }));
        arm.read_mode().unwrap();
        let error = arm.set_mode(ControlMode::Current).unwrap_err();
        assert!(matches!(error, Error::Immovable { .. }), "{error}");
        let error = arm.set_force_feedback(true).unwrap_err();
        assert!(matches!(error, Error::Immovable { .. }), "{error}");
        drop(arm);
        assert_eq!(sent.iter().count(), 0);
    }

    #[test]
    fn every_read_of_the_joints_is_reported() {
        let (poses, reported) = mpsc::channel();
        let mut arm = holding();
        arm.on_pose = Some(Box::new(move |pose, _| poses.send(pose).unwrap()));
        let state = arm.read_joints().unwrap();
        MotionReadings::default().read(&mut arm).unwrap();
        assert!(arm.read_joints_until(Instant::now()).unwrap());
        drop(arm);
        assert_eq!(reported.iter().collect::<Vec<_>>(), [state; 3]);
    }

    #[test]
    fn reading_at_a_rate_permits_no_move() {
        let mut arm = holding();
        // It may be the answer to a request before the torque was switched.
        assert!(arm.read_joints_until(Instant::now()).unwrap());
        assert!(!arm.may_move);
        arm.read_joints().unwrap();
        assert!(arm.may_move);
        assert!(arm.read_joints_until(Instant::now()).unwrap());
        assert!(arm.may_move);
    }

    #[test]
    fn grip_is_kept_until_torque_off_is_sent() {
        for (writes, has_moved) in [(0, true), (1, false)] {
            for effect in [Effect::Torque(Torque::Off), Effect::Zero] {
                let mut left = writes;
                let mut arm = ling(FakeLine::boxed(move |_| {
                    left = usize::checked_sub(left, 1).ok_or_else(|| Error::at("fake", "no"))?;
                    Ok(Vec::new())
                }));
                arm.gripper = Some(Opening::OPEN);
                assert_eq!(arm.send(effect).is_err(), has_moved);
                assert_eq!(arm.has_moved(), has_moved);
            }
        }
    }

    /// An adapter that was told to stop the arm.
    #[derive(Default)]
    struct Stopped(Option<FromAdapter>);

    impl Transport for Stopped {
        fn name(&self) -> &str {
            "control"
        }

        fn send(&mut self, message: &FromHost) -> Result<(), Error> {
            let reply = match message.request {
                control::Request::GetStop => Reply::Stop(Some(StopInForce {
                    by: Initiator::Can,
                    left_ms: 1_200,
                })),
                _ => Reply::Done,
            };
            let sequence = message.sequence;
            self.0 = Some(FromAdapter::Reply { sequence, reply });
            Ok(())
        }

        fn receive(&mut self, _: Duration) -> Result<Option<Received>, Error> {
            Ok(self.0.take().map(Ok))
        }

        fn hint(&self) -> String {
            String::new()
        }
    }

    #[test]
    fn adapter_of_a_reader_is_asked_until_the_reader_ends() {
        let mut arm = holding();
        arm.check_refusal().expect("its port has no adapter");
        let adapter = Shared::new("control", Adapter::new(Box::new(Stopped::default())));
        arm.lend_adapter(adapter.clone());
        let text = "fake: motion is refused for 1.2 s more: stopped by a host on CAN";
        assert_eq!(arm.check_refusal().unwrap_err().to_string(), text);
        let hold = Move {
            joints: [(Position::CENTRE, Speed::SLOWEST); JOINTS],
            gripper: (Opening::OPEN, GripperSpeed(1_000)),
        };
        assert_eq!(arm.move_to(&hold).unwrap_err().to_string(), text);
        assert!(!arm.has_moved(), "it was sent");
        drop(adapter.take());
        arm.move_to(&hold).expect("nobody refuses it");
        assert!(arm.has_moved());
    }
}
