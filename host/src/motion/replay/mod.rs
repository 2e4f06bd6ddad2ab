//! Replay of a recorded motion: readings in, moves out.
//!
//! A [`Motion`] is a recording that an arm can follow, checked before anything moves. A [`Replay`] makes the moves. It
//! does no I/O and reads no clock.

mod motion;
mod tracking;

use std::error;
use std::fmt;

use armwire::OutOfRange;
use armwire::ling::{JointState, MotionStatus, Move, Opening};
use armwire::time::{Duration, Instant};

use crate::motion::goal::{APPROACH_SPEED, Deviation, Goal, Limits, degrees, farthest, seconds};
use crate::time::pace::Pace;
use crate::time::silence::SilenceLimit;

pub use motion::{Motion, Point, Range, Refusal};
pub use tracking::Tracking;

/// The time at the first pose before the motion, and at the last one behind it.
const PAUSE: Duration = Duration::from_millis(500);

/// The next action for the caller of a [`Replay`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Output {
    /// Send this move.
    Move(Move),
    /// Wait until this time.
    Wait(Instant),
    /// The motion was made. The arm is at rest at its end. Later polls return it again.
    Done,
}

/// State of a replay.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Progress {
    /// It waits for the first reading.
    Waiting,
    /// The arm goes slowly to the first pose. The farthest joint is at this distance from it, in degrees.
    Approaching(f64),
    /// It is at this time of the motion.
    Playing(Duration),
    /// The motion was made.
    Done,
}

/// The reason why a replay ended. The arm is to be stopped, except without torque.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Failure {
    /// The torque is off, as in this status.
    TorqueOff(MotionStatus),
    /// No reading came for this time.
    Silent(Duration),
    /// A joint was away from its goal by 10° for 0.5 s.
    Deviation(Deviation),
    /// No move can express the arm's pose at the start.
    Position(OutOfRange),
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TorqueOff(status) => write!(f, "the torque is off (status {status})"),
            Self::Silent(age) => write!(f, "no reading of the joints for {:.2} s", seconds(*age)),
            Self::Deviation(Deviation { joint, ticks }) => {
                let degrees = degrees(f64::from(*ticks));
                write!(
                    f,
                    "joint {joint} is {degrees:.1}° away from its goal: is something in its way?"
                )
            }
            Self::Position(error) => write!(f, "the arm's pose cannot be held: {error}"),
        }
    }
}

impl error::Error for Failure {}

/// A replay of a motion: it goes to the first pose at 20°/s, and then makes the motion in time.
///
/// [`poll`](Self::poll) returns moves, a period apart. Each goes to the pose at the time of the next one. The arm's
/// readings go in by [`on_reading`](Self::on_reading), as they come: the first one before any move.
///
/// ```
/// use armwire::ling::{JointState, MotionStatus, Position};
/// use armwire::time::{Duration, Instant};
/// use armwire_host::Limits;
/// use armwire_host::replay::{Motion, Output, Point, Range, Replay};
///
/// let points = [0, 1_000].map(|millis| Point {
///     at: Instant::from_millis(millis),
///     joints: [Position::CENTRE; 6],
///     gripper: None,
/// });
/// let motion = Motion::new(&points, &Range::default(), Limits::REPLAY)?;
/// let mut replay = Replay::new(motion, Duration::from_millis(10), false);
/// let mut now = Instant::ZERO;
/// loop {
///     // Read the arm here.
///     let state = JointState { joints: [2048; 6], gripper: 500, status: MotionStatus::Locked };
///     replay.on_reading(now, &state);
///     match replay.poll(now)? {
///         Output::Move(_) => {} // Send it here.
///         Output::Wait(until) => now = until,
///         Output::Done => break,
///     }
/// }
/// assert_eq!(replay.tracking().max_degrees(), [0.0; 6]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Replay {
    motion: Motion,
    is_endless: bool,
    pace: Pace,
    phase: Phase,
    /// `None` before the first reading.
    arm: Option<Arm>,
    /// The time of the first poll.
    begun: Option<Instant>,
    tracking: Tracking,
}

/// The arm that moves.
#[derive(Clone, Debug)]
struct Arm {
    goal: Goal,
    gripper: Opening,
    /// The last reading, and its time.
    reading: JointState,
    at: Instant,
}

#[derive(Clone, Copy, Debug)]
enum Phase {
    Approach,
    /// The arm is at the first pose, until the start at this time.
    Pause(Instant),
    /// The motion began at this time.
    Play(Instant),
    /// The arm is at the last pose, until this time.
    Rest(Instant),
    Done,
    Failed(Failure),
}

impl Replay {
    /// A replay with a move per `period`, which begins again after its end if it `is_endless`.
    pub fn new(motion: Motion, period: Duration, is_endless: bool) -> Self {
        Self {
            motion,
            is_endless,
            pace: Pace::new(period),
            phase: Phase::Approach,
            arm: None,
            begun: None,
            tracking: Tracking::default(),
        }
    }

    /// Takes a reading of the joints that was made at `at`.
    pub fn on_reading(&mut self, at: Instant, reading: &JointState) {
        if let Phase::Done | Phase::Failed(_) = self.phase {
            return;
        }
        if let Err(failure) = self.take(at, reading) {
            self.phase = Phase::Failed(failure);
        }
    }

    /// The next action.
    ///
    /// # Errors
    ///
    /// [`Failure`], and no move comes any more.
    pub fn poll(&mut self, now: Instant) -> Result<Output, Failure> {
        let begun = *self.begun.get_or_insert(now);
        match self.phase {
            Phase::Done => return Ok(Output::Done),
            Phase::Failed(failure) => return Err(failure),
            Phase::Approach | Phase::Pause(_) | Phase::Play(_) | Phase::Rest(_) => {}
        }
        let age = now.since(self.arm.as_ref().map_or(begun, |arm| arm.at));
        if age > SilenceLimit::FAILURE.at(self.pace.period()) {
            let failure = Failure::Silent(age);
            self.phase = Phase::Failed(failure);
            return Err(failure);
        }
        if self.pace.begin(now).is_none() {
            return Ok(Output::Wait(self.pace.next()));
        }
        self.phase = self.next_phase(now);
        let Some(arm) = &mut self.arm else {
            return Ok(Output::Wait(self.pace.next()));
        };
        let (motion, period) = (&self.motion, self.pace.period());
        let (at, limits) = match self.phase {
            // The pose at the time of the next move.
            Phase::Play(start) => ((now + period).since(start), *motion.limits()),
            Phase::Rest(_) => (motion.length(), *motion.limits()),
            Phase::Approach | Phase::Pause(_) => (Duration::ZERO, approach(motion.limits())),
            Phase::Done | Phase::Failed(_) => return Ok(Output::Done),
        };
        arm.gripper = motion.gripper(at).unwrap_or(arm.gripper);
        let target = motion.joints(at);
        let next = arm
            .goal
            .advance(now, &target, arm.gripper, &limits, &arm.reading, period);
        Ok(Output::Move(next))
    }

    /// State of the replay.
    pub fn progress(&self, now: Instant) -> Progress {
        match (&self.arm, self.phase) {
            (None, _) => Progress::Waiting,
            (Some(arm), Phase::Approach | Phase::Pause(_)) => {
                let (_, distance) = farthest(&arm.reading.joints.map(f64::from), &self.motion.joints(Duration::ZERO));
                Progress::Approaching(degrees(distance))
            }
            (_, Phase::Play(start)) => Progress::Playing(now.since(start).min(self.motion.length())),
            (_, Phase::Rest(_)) => Progress::Playing(self.motion.length()),
            (_, Phase::Done | Phase::Failed(_)) => Progress::Done,
        }
    }

    /// The distances of the arm from the motion so far.
    pub fn tracking(&self) -> &Tracking {
        &self.tracking
    }

    fn take(&mut self, at: Instant, reading: &JointState) -> Result<(), Failure> {
        if reading.status.is_torque_off() {
            return Err(Failure::TorqueOff(reading.status));
        }
        let Some(arm) = &mut self.arm else {
            self.arm = Some(Arm {
                goal: Goal::of(at, reading).map_err(Failure::Position)?,
                // As in a stop, a reading beyond the open end stands for that end.
                gripper: reading.opening().unwrap_or(Opening::OPEN),
                reading: *reading,
                at,
            });
            return Ok(());
        };
        (arm.reading, arm.at) = (*reading, at);
        if let Phase::Play(start) = self.phase
            && start <= at
        {
            self.tracking.add(&self.motion.joints(at.since(start)), reading);
        }
        match arm.goal.deviation(at, reading) {
            Some(deviation) => Err(Failure::Deviation(deviation)),
            None => Ok(()),
        }
    }

    fn next_phase(&self, now: Instant) -> Phase {
        let length = self.motion.length();
        match self.phase {
            Phase::Approach => match &self.arm {
                Some(arm) if *arm.goal.ticks() == self.motion.joints(Duration::ZERO) => Phase::Pause(now + PAUSE),
                _ => Phase::Approach,
            },
            Phase::Pause(until) if until <= now => Phase::Play(now),
            Phase::Play(start) if start + length <= now => match self.is_endless {
                true => Phase::Approach,
                false => Phase::Rest(now + PAUSE),
            },
            Phase::Rest(until) if until <= now => Phase::Done,
            phase => phase,
        }
    }
}

/// The limits on the way to the first pose.
fn approach(limits: &Limits) -> Limits {
    Limits {
        speed: limits.speed.min(APPROACH_SPEED),
        ..*limits
    }
}
