//! Replay of a recorded motion: readings in, moves out.
//!
//! A [`Motion`] is a recording that an arm can follow, checked before anything moves. A [`Replay`] makes the moves. It
//! does no I/O and reads no clock.

mod arrival;
mod failure;
mod motion;
mod tracking;

use armwire::ling::{JointState, Move};
use armwire::time::{Duration, Instant};

use crate::motion::axes::{AXES, degrees, farthest, joints};
use crate::motion::engine::{self, Engine, Fault, Next, Seen, Source};
use crate::motion::goal::{Target, TrackingLimit, Way};
use crate::time::silence::SilenceLimit;
use arrival::Arrival;

pub use failure::Failure;
pub use motion::{Motion, Point, Range, Refusal};
pub use tracking::Tracking;

/// The time at the first pose before the motion.
const PAUSE: Duration = Duration::from_millis(500);

/// The next action for the caller of a [`Replay`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Output {
    /// Send this move.
    Move(Move),
    /// Wait until this time.
    Wait(Instant),
    /// The motion was made, and the arm is at rest at the last pose: within 5.7° (0.1 rad). Later polls return it again.
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
    /// The motion was made, and the arm comes to rest. The farthest joint is at this distance from the last pose, in
    /// degrees.
    Arriving(f64),
    /// The replay ended.
    Done,
}

/// A replay of a motion: it goes to the first pose at 20°/s, makes the motion in time, and ends once the arm is at rest at
/// the last pose.
///
/// [`poll`](Self::poll) returns moves, a period apart. Each goes to the pose at the time of the next one. The arm's
/// readings go in by [`on_reading`](Self::on_reading), as they come: the first one before any move.
///
/// ```
/// use armwire::ling::{JointState, MotionStatus, Position};
/// use armwire::time::Instant;
/// use armwire_host::replay::{Motion, Output, Point, Range, Replay};
/// use armwire_host::{Limits, Rate};
///
/// let points = [0, 1_000].map(|millis| Point {
///     at: Instant::from_millis(millis),
///     joints: [Position::CENTRE; 6],
///     gripper: None,
/// });
/// let motion = Motion::new(&points, &Range::default(), Limits::REPLAY, Rate::MOVES)?;
/// let mut replay = Replay::new(motion, false);
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
    engine: Engine,
    script: Script,
    failure: Option<Failure>,
}

/// The source of a replay's targets.
#[derive(Clone, Debug)]
struct Script {
    motion: Motion,
    is_endless: bool,
    phase: Phase,
    tracking: Tracking,
}

#[derive(Clone, Copy, Debug)]
enum Phase {
    Approach,
    /// The arm is at the first pose, until the start at this time.
    Pause(Instant),
    /// The motion began at this time.
    Play(Instant),
    /// The last pose is the goal.
    Arrive(Arrival),
    Done,
}

impl Replay {
    /// A replay, which begins again after its end if it `is_endless`.
    pub fn new(motion: Motion, is_endless: bool) -> Self {
        let rate = motion.rate();
        Self {
            engine: Engine::new(rate, SilenceLimit::FAIL.at(rate.micros()), [None; AXES]),
            script: Script {
                motion,
                is_endless,
                phase: Phase::Approach,
                tracking: Tracking::default(),
            },
            failure: None,
        }
    }

    /// Takes a reading of the joints that was made at `at`.
    pub fn on_reading(&mut self, at: Instant, reading: &JointState) {
        self.engine.on_joints(at, reading);
        if let Phase::Play(start) = self.script.phase
            && start <= at
        {
            let pose = self.script.motion.joints(at.since(start));
            self.script.tracking.add(&pose, reading);
        }
        if let Phase::Arrive(arrival) = &mut self.script.phase {
            arrival.on_joints(at, &reading.joints);
            let pose = self.script.motion.joints(self.script.motion.length());
            self.script.tracking.end(&pose, reading);
        }
    }

    /// The next action.
    ///
    /// # Errors
    ///
    /// [`Failure`], and no move comes any more. The arm is to be stopped, except without torque.
    pub fn poll(&mut self, now: Instant) -> Result<Output, Failure> {
        if let Some(failure) = self.failure {
            return Err(failure);
        }
        if let Phase::Done = self.script.phase {
            return Ok(Output::Done);
        }
        match self.engine.poll(now, &mut self.script) {
            engine::Output::Move(next) => Ok(Output::Move(next)),
            engine::Output::Wait(until) => Ok(Output::Wait(until)),
            engine::Output::End(Ok(())) => Ok(Output::Done),
            engine::Output::End(Err(failure)) => Err(*self.failure.insert(failure)),
        }
    }

    /// State of the replay.
    pub fn progress(&self, now: Instant) -> Progress {
        let motion = &self.script.motion;
        match (self.engine.seen(), self.script.phase) {
            _ if self.failure.is_some() => Progress::Done,
            (None, _) => Progress::Waiting,
            (Some(arm), Phase::Approach | Phase::Pause(_)) => {
                let (_, distance) = farthest(&arm.pose, &motion.joints(Duration::ZERO));
                Progress::Approaching(degrees(distance))
            }
            (_, Phase::Play(start)) => Progress::Playing(now.since(start).min(motion.length())),
            (Some(arm), Phase::Arrive(_)) => {
                let (_, distance) = farthest(&arm.pose, &motion.joints(motion.length()));
                Progress::Arriving(degrees(distance))
            }
            (_, Phase::Done) => Progress::Done,
        }
    }

    /// The distances of the arm from the motion so far.
    pub fn tracking(&self) -> &Tracking {
        &self.script.tracking
    }
}

impl Source for Script {
    type End = Result<(), Failure>;

    fn next(&mut self, now: Instant, period: Duration, arm: &Seen) -> Next<Self::End> {
        self.phase = self.next_phase(now, arm);
        if let Phase::Arrive(arrival) = self.phase
            && let Some(end) = arrival.end(now)
        {
            self.phase = Phase::Done;
            return Next::End(end);
        }
        let limits = *self.motion.limits();
        let (at, limits) = match self.phase {
            // The pose at the time of the next move.
            Phase::Play(start) => ((now + period).since(start), limits),
            Phase::Arrive(_) | Phase::Done => (self.motion.length(), limits),
            Phase::Approach | Phase::Pause(_) => (Duration::ZERO, limits.of_approach()),
        };
        Next::Go(Target {
            joints: self.motion.joints(at),
            gripper: self.motion.gripper(at).map(|opening| opening.per_mille().into()),
            way: Way::Within(limits),
            tracking: TrackingLimit::DEFAULT,
        })
    }

    fn on_fault(&mut self, _: Instant, fault: Fault) -> Option<Self::End> {
        Some(Err(Failure::Fault(fault)))
    }
}

impl Script {
    fn next_phase(&self, now: Instant, arm: &Seen) -> Phase {
        let (length, goal) = (self.motion.length(), joints(&arm.goal));
        match self.phase {
            Phase::Approach if goal == self.motion.joints(Duration::ZERO) => Phase::Pause(now + PAUSE),
            Phase::Pause(until) if until <= now => Phase::Play(now),
            Phase::Play(start) if start + length <= now && goal == self.motion.joints(length) => {
                match self.is_endless {
                    true => Phase::Approach,
                    false => Phase::Arrive(Arrival::new(goal, now)),
                }
            }
            phase => phase,
        }
    }
}
