//! Stopping an arm: readings in, requests out.

use core::fmt;

use super::arrival::Deviations;
use super::{GripperSpeed, JOINTS, JointState, Move, Opening, Position, Request, Rest, Speed, Torque};
use crate::OutOfRange;
use crate::time::{Duration, Instant};

/// Time between two readings.
const PERIOD: Duration = Duration::from_millis(20);
/// An arm that has been at rest for this time, near its last goal, is held at that goal.
const STANDING: Duration = Duration::from_millis(100);
/// An arm that does not stand there after this time, or of which no more readings came, is held at its last reading.
const SETTLING: Duration = Duration::from_millis(300);
/// A joint may rest this far from its goal, in ticks: 3.5°. A servo holds a load by its error.
const SAG: u16 = 40;
/// A joint that moves away by this number of ticks, 10.5°, leaves the hold. Sag and overshoot are less.
const LEAVING: u16 = 3 * SAG;
/// A joint further than this from the hold has gone on, in ticks: 7°. It returns no faster than the arm moved.
const FAR: u16 = 2 * SAG;
/// The hold goes out so many times at once, against its loss…
const AT_ONCE: u8 = 3;
/// …and so many times at least before the arm is taken for one at rest…
const HOLDS: u8 = 5;
/// …and after this time again, while the arm moves.
const AGAIN: Duration = Duration::from_millis(500);
/// The joints' speed to the pose, in ticks per second: 176°/s. A servo whose trajectory begins at its position, below the
/// setpoint, sinks with each slow move.
const SPEED: u16 = 2000;

/// Stops a moving arm and keeps its torque on: a state machine without I/O.
///
/// The arm has no request for this. A move to the pose of the first reading ends the motion in progress. This setpoint is
/// repeated against its loss, and never replaced: a loaded joint rests below its setpoint, and would sink with each move
/// to its reading. An arm that stands within 3.5° of its [last goal](Self::after) is sent that goal, and does not move.
///
/// The arm is at rest when the readings of 200 ms lie within 3 ticks for each joint, wherever that is: see [`Rest`]. Then
/// torque-on follows: it changes nothing at the arm, and an adapter takes it as the end of the host's stream of motion.
/// Nothing is sent to an arm without torque, and nothing more to one that another program moves.
///
/// A move contains the gripper. Its goal is the last one that the caller has sent. If that is unknown, it is the
/// reading, and a grip may loosen: at an object the goal is behind the reading, which makes the force.
///
/// [`poll`](Self::poll) returns requests; the joints read by [`Request::ReadJoints`] go in by
/// [`on_joints`](Self::on_joints). A failed read needs no call: it is repeated until [`Stop::LIMIT`].
///
/// ```
/// use armwire::ling::arrival::Deviations;
/// use armwire::ling::stop::{Grip, Output, Stopped};
/// use armwire::ling::{JointState, MotionStatus, Request, Stop, Torque};
/// use armwire::time::Instant;
///
/// let state = JointState { joints: [2048; 6], gripper: 500, status: MotionStatus::Locked };
/// let (mut stop, mut now) = (Stop::new(None), Instant::ZERO);
/// let stopped = loop {
///     match stop.poll(now) {
///         // Make the call here, and pass its answer in.
///         Output::Request(Request::ReadJoints) => stop.on_joints(now, &state),
///         Output::Request(request) => assert!(matches!(request, Request::Move(_) | Request::SetTorque(Torque::On))),
///         Output::Wait(until) => now = until,
///         Output::Done(result) => break result?,
///     }
/// };
/// assert_eq!(stopped, Stopped::AtRest { state, deviations: Deviations([0; 6]), grip: Grip::Reading });
/// # Ok::<(), armwire::ling::stop::StopError>(())
/// ```
#[derive(Clone, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Stop {
    gripper: Option<Opening>,
    /// The joints' last goal, if the caller knows it.
    goal: Option<[Position; JOINTS]>,
    /// The time of the first poll.
    start: Option<Instant>,
    /// The hold at the last reading of an arm that may yet stand at its goal.
    fallback: Option<Move>,
    hold: Option<Hold>,
    rest: Rest,
    motion: Motion,
    /// The joint that moved last, from 1.
    moving: Option<u8>,
    /// The number of readings.
    readings: u16,
    /// The last reading had a position out of range.
    out_of_range: bool,
    step: Step,
}

/// The speed of a motion, from readings.
#[derive(Clone, Copy, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
struct Motion {
    /// The last reading, and its time.
    last: Option<(Instant, [u16; JOINTS])>,
    /// The fastest joint in two readings that followed each other, in ticks per second.
    fastest: u16,
}

/// The one setpoint of a stop.
#[derive(Clone, Copy, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
struct Hold {
    target: Move,
    /// How often it is to be sent now.
    due: u8,
    /// How often it was sent, and when last.
    sent: u8,
    sent_at: Instant,
    /// The largest distance of a joint, in ticks.
    farthest: u16,
    /// The least distance of the joints since they obeyed, in ticks. `None` before.
    nearest: Option<u16>,
}

#[derive(Clone, Copy, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
enum Step {
    /// The time of the next reading.
    Read(Instant),
    EndStream(Stopped),
    End(Result<Stopped, StopError>),
}

/// The next action for the caller of a [`Stop`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Output {
    /// Make this request. Pass the answer of [`Request::ReadJoints`] to [`Stop::on_joints`].
    Request(Request),
    /// Poll again at this time.
    Wait(Instant),
    /// The end. Later polls return it again.
    Done(Result<Stopped, StopError>),
}

/// End of a stop. It is exhaustive: its cases differ in whether the arm is held.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Stopped {
    /// The arm is at rest, and is held.
    AtRest {
        /// The last reading.
        state: JointState,
        /// How far the joints rest from the setpoint.
        deviations: Deviations,
        /// The goal of the gripper.
        grip: Grip,
    },
    /// The arm has no torque, as in this reading. It is not held, and nothing moves it.
    WithoutTorque(JointState),
}

/// The goal of the gripper in the pose that holds the arm.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Grip {
    /// The given goal.
    Goal,
    /// The reading. A grip may have loosened.
    Reading,
}

/// The reason why an arm may still move. Only its supply's switch stops it then.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum StopError {
    /// No reading came.
    NoReading,
    /// Readings came, but they do not show the arm at rest.
    Unconfirmed {
        /// Their number.
        readings: u16,
    },
    /// The arm did not come to rest.
    Moving {
        /// The joint, from 1.
        joint: u8,
    },
    /// A joint came to the hold, and left it.
    MovedByAnother {
        /// The joint, from 1.
        joint: u8,
    },
    /// A move cannot express the arm's pose.
    Position(OutOfRange),
}

impl fmt::Display for StopError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoReading => f.write_str("no reading of the joints within 2 s"),
            Self::Unconfirmed { readings } => {
                f.write_str("too few readings of the joints within 2 s to show the arm at rest: ")?;
                readings.fmt(f)
            }
            Self::Moving { joint } => write!(f, "joint {joint} still moves after 2 s"),
            Self::MovedByAnother { joint } => {
                write!(f, "joint {joint} left the hold: another program or a force moves it")
            }
            Self::Position(error) => write!(f, "the pose cannot be held: {error}"),
        }
    }
}

impl core::error::Error for StopError {}

impl Stop {
    /// The time from the first poll until the stop fails.
    pub const LIMIT: Duration = Duration::from_millis(2_000);

    /// A stop at the first reading, whatever the arm's goal: an arm that presses against something gives way by that
    /// force. The last goal of the gripper stays, if the caller knows it.
    pub const fn new(gripper: Option<Opening>) -> Self {
        Self {
            gripper,
            goal: None,
            start: None,
            fallback: None,
            hold: None,
            rest: Rest::new(),
            motion: Motion { last: None, fastest: 0 },
            moving: None,
            readings: 0,
            out_of_range: false,
            step: Step::Read(Instant::ZERO),
        }
    }

    /// A stop of an arm whose last move was this one. An arm that stands there is held there, as it is.
    pub fn after(last: &Move) -> Self {
        Self {
            goal: Some(last.joints.map(|(position, _)| position)),
            ..Self::new(Some(last.gripper.0))
        }
    }

    /// A stop at a pose that the caller has computed, such as the present point of its trajectory. The move there is the
    /// first request: it waits for no reading. The caller knows that the torque is on.
    pub const fn at(target: Move) -> Self {
        let mut stop = Self::new(Some(target.gripper.0));
        stop.hold = Some(Hold::new(target));
        stop
    }

    /// The move that holds the arm, for a [later stop](Self::after). `None` if none was sent.
    pub fn held(&self) -> Option<&Move> {
        self.hold.as_ref().filter(|hold| hold.sent > 0).map(|hold| &hold.target)
    }

    /// The next action.
    pub fn poll(&mut self, now: Instant) -> Output {
        let start = *self.start.get_or_insert(now);
        let limit = start + Self::LIMIT;
        if self.hold.is_none()
            && now.since(start) >= SETTLING
            && let Some(target) = self.fallback
        {
            self.hold(target);
        }
        if let Some(hold) = self.hold.as_mut().filter(|hold| hold.due > 0) {
            self.step = Step::Read(now + PERIOD);
            return Output::Request(Request::Move(hold.send(now, &self.motion)));
        }
        match self.step {
            Step::Read(_) if now >= limit => {
                let error = match (self.moving, self.readings) {
                    (Some(joint), _) => StopError::Moving { joint },
                    (None, 0) => StopError::NoReading,
                    (None, readings) => StopError::Unconfirmed { readings },
                };
                self.step = Step::End(Err(error));
                Output::Done(Err(error))
            }
            Step::Read(at) if at > now => Output::Wait(at.min(limit)),
            Step::Read(_) => {
                self.step = Step::Read(now + PERIOD);
                Output::Request(Request::ReadJoints)
            }
            Step::EndStream(stopped) => {
                self.step = Step::End(Ok(stopped));
                Output::Request(Request::SetTorque(Torque::On))
            }
            Step::End(result) => Output::Done(result),
        }
    }

    /// Takes a reading of the joints that arrived at `now`.
    pub fn on_joints(&mut self, now: Instant, state: &JointState) {
        self.readings = self.readings.saturating_add(1);
        let is_due = self.hold.as_ref().is_some_and(|hold| hold.due > 0);
        if let Step::Read(_) = self.step
            && !is_due
            && let Some(step) = self.judge(now, state)
        {
            self.step = step;
        }
    }

    /// The step after a reading. `None` while the arm may still move.
    fn judge(&mut self, now: Instant, state: &JointState) -> Option<Step> {
        if state.status.is_torque_off() {
            return Some(Step::End(Ok(Stopped::WithoutTorque(*state))));
        }
        let joints = match state.positions() {
            Ok(joints) => joints,
            Err(error) => {
                // One reading may be wrong.
                let is_repeated = core::mem::replace(&mut self.out_of_range, true);
                return is_repeated.then_some(Step::End(Err(StopError::Position(error))));
            }
        };
        self.out_of_range = false;
        self.motion.on_joints(now, &state.joints);
        let rest = self.rest.on_joints(now, &state.joints);
        self.moving = rest.err().or(self.moving);
        let rest = rest.unwrap_or(Duration::ZERO);
        let Some(hold) = &mut self.hold else {
            let pose = match self.goal.filter(|goal| is_near(goal, &joints)) {
                Some(_) if rest < STANDING => {
                    self.fallback = Some(self.target(joints, state));
                    return None;
                }
                Some(goal) => goal,
                None => joints,
            };
            self.hold(self.target(pose, state));
            return None;
        };
        if let Err(joint) = hold.on_joints(rest, &joints) {
            return Some(Step::End(Err(StopError::MovedByAnother { joint })));
        }
        if hold.sent < HOLDS || rest < Rest::TIME {
            hold.due = u8::from(hold.sent < HOLDS || now.since(hold.sent_at) >= AGAIN);
            return None;
        }
        let deviations = hold.target.deviations(state);
        let grip = match self.gripper {
            Some(_) => Grip::Goal,
            None => Grip::Reading,
        };
        let stopped = Stopped::AtRest {
            state: *state,
            deviations,
            grip,
        };
        Some(match state.status.is_holding() {
            Some(true) => Step::EndStream(stopped),
            _ => Step::End(Ok(stopped)),
        })
    }

    /// Holds the arm by this move.
    fn hold(&mut self, target: Move) {
        self.hold = Some(Hold::new(target));
        self.rest = Rest::new();
    }

    /// The move that holds the arm in this pose.
    fn target(&self, joints: [Position; JOINTS], state: &JointState) -> Move {
        let speed = Speed::new(SPEED).unwrap_or(Speed::MAX);
        // A reading beyond the open end is held at that end: with an error instead, the joints would move on.
        let gripper = self.gripper.or(state.opening().ok()).unwrap_or(Opening::OPEN);
        Move {
            joints: joints.map(|position| (position, speed)),
            gripper: (gripper, GripperSpeed::DEFAULT),
        }
    }
}

impl Motion {
    fn on_joints(&mut self, now: Instant, joints: &[u16; JOINTS]) {
        if let Some((at, before)) = self.last.replace((now, *joints)) {
            let way = joints
                .iter()
                .zip(before)
                .map(|(now, before)| now.abs_diff(before))
                .max();
            let time = now.since(at).as_micros().max(1);
            let speed = u64::from(way.unwrap_or(0)) * 1_000_000 / time;
            self.fastest = self.fastest.max(u16::try_from(speed).unwrap_or(u16::MAX));
        }
    }
}

impl Hold {
    const fn new(target: Move) -> Self {
        Self {
            target,
            due: AT_ONCE,
            sent: 0,
            sent_at: Instant::ZERO,
            farthest: 0,
            nearest: None,
        }
    }

    /// The move, which is sent now. A joint that went on meanwhile returns no faster than the arm moved.
    fn send(&mut self, now: Instant, motion: &Motion) -> Move {
        self.due -= 1;
        (self.sent, self.sent_at) = (self.sent.saturating_add(1), now);
        let mut target = self.target;
        if let Some((_, joints)) = motion.last {
            let fastest = Speed::new(motion.fastest).unwrap_or(Speed::MAX).max(Speed::SLOWEST);
            let axes = target.joints.iter_mut().zip(joints);
            let far = axes.filter(|((goal, _), at)| goal.ticks().abs_diff(*at) > FAR);
            far.for_each(|((_, speed), _)| *speed = fastest.min(*speed));
        }
        target
    }

    /// Takes a reading of joints that have been at rest for this time.
    ///
    /// # Errors
    ///
    /// The joint, from 1, that left the hold. A joint whose move was lost has not obeyed yet: it leaves nothing.
    fn on_joints(&mut self, rest: Duration, joints: &[Position; JOINTS]) -> Result<(), u8> {
        let axes = self.target.joints.iter().zip(joints);
        let ways = axes.map(|((goal, _), at)| goal.ticks().abs_diff(at.ticks()));
        let (joint, way) = (1..).zip(ways).max_by_key(|(_, way)| *way).unwrap_or((1, 0));
        self.farthest = self.farthest.max(way);
        if rest >= STANDING || self.farthest - way > LEAVING {
            self.nearest.get_or_insert(way);
        }
        let Some(nearest) = &mut self.nearest else {
            return Ok(());
        };
        *nearest = way.min(*nearest);
        if way - *nearest > LEAVING { Err(joint) } else { Ok(()) }
    }
}

/// Returns true if every joint may rest here with this goal.
fn is_near(goal: &[Position; JOINTS], joints: &[Position; JOINTS]) -> bool {
    let mut joints = goal.iter().zip(joints);
    joints.all(|(goal, at)| goal.ticks().abs_diff(at.ticks()) <= SAG)
}
