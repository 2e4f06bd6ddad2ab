//! Stopping an arm: readings in, requests out.

use thiserror::Error;

use super::{GripperSpeed, JOINTS, JointState, Move, Opening, Position, Request, Speed, Torque};
use crate::OutOfRange;
use crate::time::{Duration, Instant};

/// Time between two readings.
const PERIOD: Duration = Duration::from_millis(20);
/// An arm is at rest if no joint changes by this number of ticks…
const MOTION: u16 = 2;
/// …for this time.
const REST: Duration = Duration::from_millis(100);
/// The joints' speed on the way back to the pose, in ticks per second.
const SPEED: u16 = 500;

/// Stops a moving arm and keeps its torque on: a state machine without I/O.
///
/// The arm has no request for this. A move to the pose of a reading ends the motion in progress. It is sent once, and
/// again only if a joint leaves that pose by more than [`Move::JOINT_TOLERANCE`], for example because the move was lost;
/// a joint that returns to the pose does not leave it. The arm is at rest when no joint changes by 2 ticks for 100 ms.
/// Then torque-on follows: it changes nothing at the arm, and an adapter takes it as the end of the host's stream of
/// motion. Nothing is sent to an arm without torque.
///
/// A move contains the gripper. Its goal is the last one that the caller has sent. If that is unknown, it is the
/// reading, and a grip may loosen: at an object the goal is behind the reading, which makes the force.
///
/// [`poll`](Self::poll) returns requests; the joints read by [`Request::ReadJoints`] go in by
/// [`on_joints`](Self::on_joints). A failed read needs no call: it is repeated until [`Stop::LIMIT`].
///
/// ```
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
/// assert_eq!(stopped, Stopped::AtRest { state, grip: Grip::Reading });
/// # Ok::<(), armwire::ling::stop::StopError>(())
/// ```
#[derive(Clone, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Stop {
    gripper: Option<Opening>,
    /// The time of the first poll.
    start: Option<Instant>,
    /// The pose of the last move.
    pose: Option<[Position; JOINTS]>,
    /// The distances from that pose in the last reading, in ticks.
    away: Option<[u16; JOINTS]>,
    /// The first of the readings that differ by less than [`MOTION`], and its time.
    rest: Option<(Instant, [Position; JOINTS])>,
    /// The joint that moved last, from 1.
    moving: Option<u8>,
    /// The number of readings.
    readings: u16,
    /// The last reading had a position out of range.
    out_of_range: bool,
    step: Step,
}

#[derive(Clone, Copy, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
enum Step {
    /// The time of the next reading.
    Read(Instant),
    Hold(Move),
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
    /// The arm is at rest in a pose that it was sent.
    AtRest {
        /// The last reading.
        state: JointState,
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
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum StopError {
    /// No reading came.
    #[error("no reading of the joints within 2 s")]
    NoReading,
    /// Readings came, but they do not show the arm at rest.
    #[error("too few readings of the joints within 2 s to show the arm at rest: {readings}")]
    Unconfirmed {
        /// Their number.
        readings: u16,
    },
    /// The arm did not come to rest.
    #[error("joint {joint} still moves after 2 s")]
    Moving {
        /// The joint, from 1.
        joint: u8,
    },
    /// A move cannot express the arm's pose.
    #[error("the pose cannot be held: {0}")]
    Position(OutOfRange),
}

impl Stop {
    /// The time from the first poll until the stop fails.
    pub const LIMIT: Duration = Duration::from_millis(2_000);

    /// A stop with the last goal of the gripper, if the caller knows it.
    pub const fn new(gripper: Option<Opening>) -> Self {
        Self {
            gripper,
            start: None,
            pose: None,
            away: None,
            rest: None,
            moving: None,
            readings: 0,
            out_of_range: false,
            step: Step::Read(Instant::ZERO),
        }
    }

    /// A stop at a pose that the caller has computed, such as the present point of its trajectory. The move there is the
    /// first request: it waits for no reading. The caller knows that the torque is on.
    pub fn at(target: Move) -> Self {
        Self {
            pose: Some(target.joints.map(|(position, _)| position)),
            step: Step::Hold(target),
            ..Self::new(Some(target.gripper.0))
        }
    }

    /// The next action.
    pub fn poll(&mut self, now: Instant) -> Output {
        let limit = *self.start.get_or_insert(now) + Self::LIMIT;
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
            Step::Hold(pose) => {
                self.step = Step::Read(now + PERIOD);
                Output::Request(Request::Move(pose))
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
        if let Step::Read(_) = self.step
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
        let left = self.pose.and_then(|pose| self.left(distances(&pose, &joints)));
        if left.is_some() || self.pose.is_none() {
            self.moving = left;
            self.pose = Some(joints);
            self.away = None;
            self.rest = None;
            return Some(Step::Hold(self.hold(joints, state)));
        }
        let Some((since, first)) = self.rest else {
            self.rest = Some((now, joints));
            return None;
        };
        let moving = numbered(distances(&first, &joints)).find(|(_, distance)| *distance >= MOTION);
        if let Some((joint, _)) = moving {
            self.moving = Some(joint);
            self.rest = Some((now, joints));
            return None;
        }
        if now.since(since) < REST {
            return None;
        }
        let grip = match self.gripper {
            Some(_) => Grip::Goal,
            None => Grip::Reading,
        };
        let stopped = Stopped::AtRest { state: *state, grip };
        Some(match state.status.is_holding() {
            Some(true) => Step::EndStream(stopped),
            _ => Step::End(Ok(stopped)),
        })
    }

    /// Takes the distances of the joints from the pose. Returns the first joint that is leaving it.
    fn left(&mut self, away: [u16; JOINTS]) -> Option<u8> {
        let before = self.away.replace(away)?;
        let mut joints = numbered(away).zip(before);
        let left = joints.find(|((_, now), before)| *now > Move::JOINT_TOLERANCE && now > before);
        left.map(|((joint, _), _)| joint)
    }

    /// A move to this pose.
    fn hold(&self, joints: [Position; JOINTS], state: &JointState) -> Move {
        let speed = Speed::new(SPEED).unwrap_or(Speed::MAX);
        // A reading beyond the open end is held at that end: with an error instead, the joints would move on.
        let gripper = self.gripper.or(state.opening().ok()).unwrap_or(Opening::OPEN);
        Move {
            joints: joints.map(|position| (position, speed)),
            gripper: (gripper, GripperSpeed::DEFAULT),
        }
    }
}

/// The distances of the joints, in ticks.
fn distances(a: &[Position; JOINTS], b: &[Position; JOINTS]) -> [u16; JOINTS] {
    let mut distances = [0; JOINTS];
    for (distance, (a, b)) in distances.iter_mut().zip(a.iter().zip(b)) {
        *distance = a.ticks().abs_diff(b.ticks());
    }
    distances
}

/// The values with the numbers of their joints, from 1.
fn numbered(values: [u16; JOINTS]) -> impl Iterator<Item = (u8, u16)> {
    (1..).zip(values)
}
