//! The motion of one arm along the targets of a source: targets and readings in, moves out. No I/O and no clock.
//!
//! [`Follow`](crate::follow::Follow), [`Replay`](crate::replay::Replay) and
//! [`Trajectory`](crate::trajectory::Trajectory) are sources of targets.

use std::error;
use std::fmt;

use armwire::OutOfRange;
use armwire::ling::{Immovable, JOINTS, JointState, Move, Speed};
use armwire::time::{Duration, Instant};

use crate::motion::axes::{Axes, Off, Tolerance, axes, degrees, joints, seconds};
use crate::motion::goal::{Goal, Target, TrackingLimit, Way};
use crate::time::pace::Pace;
use crate::time::rate::Rate;

/// A source of targets.
pub trait Source {
    /// The end of its targets.
    type End;

    /// The target of the move at `now`. The next one is a period later.
    fn next(&mut self, now: Instant, period: Duration, arm: &Seen) -> Next<Self::End>;

    /// The reaction to a fault, as long as it lasts: the end, or `None` to send nothing meanwhile.
    fn on_fault(&mut self, now: Instant, fault: Fault) -> Option<Self::End>;
}

/// The next of a source.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Next<E> {
    /// Go there.
    Go(Target),
    /// Send nothing for a period.
    Rest,
    /// Its targets are over.
    End(E),
}

/// The arm as a source sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seen {
    /// The pose of the last reading.
    pub pose: Axes,
    /// The goal of the last move. An axis without one has its pose.
    pub goal: Axes,
}

/// The reason why an arm cannot follow targets now.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Fault {
    /// A reading forbids motion, for example because the torque went off.
    Immovable(Immovable),
    /// No move can express the arm's pose.
    Position(OutOfRange),
    /// No move can express the source's target, or a speed of it.
    Target(OutOfRange<f32>),
    /// No reading came for this time.
    Silent(Duration),
    /// An axis was too far from its goal for too long.
    TrackingError(Off),
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Immovable(reason) => reason.fmt(f),
            Self::Position(error) => write!(f, "the arm's pose cannot be held: {error}"),
            Self::Target(error) => write!(f, "a target cannot be sent: {error}"),
            Self::Silent(age) => write!(f, "no reading of the joints for {:.2} s", seconds(*age)),
            Self::TrackingError(Off { axis, distance, .. }) => {
                let (joint, degrees) = (axis + 1, degrees(*distance));
                write!(
                    f,
                    "joint {joint} is {degrees:.1}° away from its goal: is something in its way?"
                )
            }
        }
    }
}

impl error::Error for Fault {}

/// The next action for the caller of an [`Engine`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Output<E> {
    /// Send this move.
    Move(Move),
    /// Wait until this time, or for a reading.
    Wait(Instant),
    /// The source's targets are over.
    End(E),
}

/// The motion of one arm.
///
/// [`poll`](Self::poll) returns moves to the targets of a source, a period apart, while there is no fault. The arm's
/// readings go in by [`on_joints`](Self::on_joints), with the times at which they were made. A pose that no move can
/// express counts as missing.
#[derive(Clone, Debug)]
pub struct Engine {
    pace: Pace,
    silence: Duration,
    drift: Tolerance,
    /// The time of the first poll.
    begun: Option<Instant>,
    /// The last pose, and its time.
    pose: Option<(Instant, Axes)>,
    /// The error of the last reading before the first pose.
    outside: Option<OutOfRange>,
    immovable: Option<Immovable>,
    goal: Goal,
}

impl Engine {
    /// A motion with moves at this rate, of an arm that is silent after `silence`. A resting axis that moves away from its
    /// goal by more than `drift` was moved by another host, and gives its goal up.
    pub fn new(rate: Rate, silence: Duration, drift: Tolerance) -> Self {
        Self {
            pace: Pace::new(rate),
            silence,
            drift,
            begun: None,
            pose: None,
            outside: None,
            immovable: None,
            goal: Goal::NONE,
        }
    }

    /// Takes a reading of the joints that was made at `at`.
    pub fn on_joints(&mut self, at: Instant, state: &JointState) {
        if let Err(reason) = state.status.check_motion() {
            self.immovable = Some(reason);
        }
        match axes(state) {
            Ok(pose) => {
                self.pose = Some((at, pose));
                self.goal.on_pose(at, &pose, &self.drift);
            }
            Err(error) => self.outside = Some(error),
        }
    }

    /// The next action, with the targets of `source`. One that no move can express is a [`Fault::Target`].
    pub fn poll<S: Source>(&mut self, now: Instant, source: &mut S) -> Output<S::End> {
        let begun = *self.begun.get_or_insert(now);
        if let Some(fault) = self.fault(now, begun) {
            if let Some(end) = source.on_fault(now, fault) {
                return Output::End(end);
            }
            self.pace.begin(now);
            return Output::Wait(self.pace.next());
        }
        let (Some(_), Some(arm)) = (self.pace.begin(now), self.seen()) else {
            return Output::Wait(self.pace.next());
        };
        let period = self.pace.period();
        match source.next(now, period, &arm) {
            Next::Go(target) => match target.check() {
                Ok(()) => Output::Move(self.goal.advance(now, &target, &arm.pose, period)),
                Err(error) => match source.on_fault(now, Fault::Target(error)) {
                    Some(end) => Output::End(end),
                    None => Output::Wait(self.pace.next()),
                },
            },
            Next::Rest => Output::Wait(self.pace.next()),
            Next::End(end) => Output::End(end),
        }
    }

    /// The arm; `None` before its first pose.
    pub fn seen(&self) -> Option<Seen> {
        let (_, pose) = self.pose?;
        let goal = self.goal.axes(&pose);
        Some(Seen { pose, goal })
    }

    /// Gives the goal up: the arm was stopped, or lost its torque. The next motion begins where it is.
    pub fn rest(&mut self) {
        self.goal = Goal::NONE;
        self.immovable = None;
    }

    /// Ends the tracking of a source that gives no targets any more. The arm keeps its goal, without a limit of the
    /// tracking error.
    pub fn end_tracking(&mut self) {
        self.goal.end_tracking();
    }

    /// The move that holds the joints where they are, so that they do not press on, and keeps the gripper's goal. `None`
    /// before the first pose.
    pub fn hold(&mut self, now: Instant) -> Option<Move> {
        let (_, pose) = self.pose?;
        let target = Target {
            joints: joints(&pose),
            gripper: None,
            way: Way::At([Speed::SLOWEST; JOINTS]),
            tracking: TrackingLimit::ANY,
        };
        Some(self.goal.advance(now, &target, &pose, self.pace.period()))
    }

    fn fault(&self, now: Instant, begun: Instant) -> Option<Fault> {
        if let Some(reason) = self.immovable {
            return Some(Fault::Immovable(reason));
        }
        let seen = match (self.pose, self.outside) {
            (None, Some(error)) => return Some(Fault::Position(error)),
            (pose, _) => pose.map_or(begun, |(at, _)| at),
        };
        let age = now.since(seen);
        match age > self.silence {
            true => Some(Fault::Silent(age)),
            false => self.goal.tracking_error().map(Fault::TrackingError),
        }
    }
}
