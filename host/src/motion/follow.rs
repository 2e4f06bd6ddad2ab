//! Teleoperation: readings of a leader and of a follower in, moves of the follower out.
//!
//! A [`Follow`] decides what the follower does. It does no I/O and reads no clock.

use std::collections::VecDeque;
use std::error;
use std::fmt;

use armwire::OutOfRange;
use armwire::ling::{Immovable, JOINTS, JointState, Move, Opening, Rest};
use armwire::time::{Duration, Instant};

use crate::motion::axes::{AXES, Off, degrees, farthest, seconds};
use crate::motion::engine::{self, Engine, Fault, Next, Seen, Source};
use crate::motion::goal::{Limits, Target, TrackingLimit, Way};
use crate::time::rate::Rate;
use crate::time::silence::SilenceLimit;

/// The time for the first readings.
const MAX_WAIT: Duration = SilenceLimit::STOP.least();
/// Distance of the arms, in ticks, up to which the follower follows at once: 5°.
const NEAR: f64 = 56.0;
/// Distance of the leader from the goal, in ticks, from which on it is not followed: 45°. A joint that turns past ±180°
/// reads a whole turn less.
const FAR: f64 = 512.0;
/// The time of the leader's poses that are kept, to find out how late the follower is.
const HISTORY: Duration = Duration::from_millis(1_000);

/// Reaction to a first distance of more than 5°.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Start {
    /// The follower goes to the leader, at 20°/s.
    #[default]
    Approach,
    /// The follower does not move: [`End::Far`].
    Refuse,
}

/// The next action for the caller of a [`Follow`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Output {
    /// Send this move to the follower.
    Move(Move),
    /// Stop the follower, once. It follows again when both arms are read and within 5° of each other.
    Stop(Pause),
    /// Wait until this time.
    Wait(Instant),
}

/// State of the follower.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Progress {
    /// The first readings are missing.
    Starting,
    /// The follower goes slowly to the leader. The farthest joint is at this distance, in degrees.
    Approaching(f64),
    /// The follower follows.
    Following,
    /// The follower rests for this reason, until the arms are near. The farthest joint is at this distance, in degrees.
    Waiting(Pause, f64),
}

/// The reason why the follower rests.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Pause {
    /// The leader was not read for this time.
    LeaderLate(Duration),
    /// The follower was not read for this time.
    FollowerLate(Duration),
    /// A joint of the leader, from 1, is too far ahead, at this distance in degrees.
    LeaderAhead(u8, f64),
    /// A joint of the follower was away from its goal by 10° for 0.5 s.
    TrackingError(Off),
}

impl fmt::Display for Pause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::LeaderLate(age) => write!(f, "no pose of the leader for {:.2} s", seconds(age)),
            Self::FollowerLate(age) => write!(f, "no pose of the follower for {:.2} s", seconds(age)),
            Self::LeaderAhead(joint, degrees) => write!(f, "joint {joint} of the leader is {degrees:.0}° ahead"),
            Self::TrackingError(Off { axis, distance, .. }) => {
                let (joint, degrees) = (axis + 1, degrees(distance));
                write!(
                    f,
                    "joint {joint} of the follower is {degrees:.1}° away from its goal: is something in its way?"
                )
            }
        }
    }
}

/// The reason why teleoperation ended.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum End {
    /// A reading of the follower forbids motion, for example because the torque is off. Nothing is sent any more.
    Immovable(Immovable),
    /// A joint, from 1, was too far from the leader at the start, at this distance in degrees. Nothing was sent.
    Far(u8, f64),
    /// The arms were not both read within 2 s after the start. Nothing was sent.
    Unread,
}

impl fmt::Display for End {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Immovable(reason) => write!(f, "the follower cannot be moved: {reason}"),
            Self::Far(joint, degrees) => write!(
                f,
                "joint {joint} of the follower is {degrees:.0}° away from the leader's: bring them within 5°"
            ),
            Self::Unread => f.write_str("the arms do not both answer"),
        }
    }
}

impl error::Error for End {}

/// The reason why no follower can follow within its limits.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Refusal {
    /// A joint does not move within the limits.
    Limits(OutOfRange),
    /// Steps at this rate are slower than the limit of the speed.
    Rate {
        /// The rate.
        rate: Rate,
        /// The maximum distance between two goals, in degrees.
        step: f64,
        /// The limit of the speed, in degrees per second.
        max: f64,
        /// The least rate that would do, if one does.
        needed: Option<Rate>,
    },
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Limits(error) => error.fmt(f),
            Self::Rate {
                rate,
                step,
                max,
                needed,
            } => {
                let (hertz, speed) = (rate.hertz(), step * f64::from(rate.hertz()));
                write!(
                    f,
                    "steps of {step:.1}° at {hertz} Hz are {speed:.0}°/s, slower than the limit of {max:.0}°/s: "
                )?;
                Rate::write_needed(needed, f)
            }
        }
    }
}

impl error::Error for Refusal {}

/// A follower that follows a leader.
///
/// [`poll`](Self::poll) returns moves, a period apart, whose goals stay within the [`Limits`]. Readings of both arms go in
/// as they come, with the times at which they were made. A pose that no move can express counts as missing.
///
/// ```
/// use armwire::ling::{JointState, MotionStatus};
/// use armwire::time::Instant;
/// use armwire_host::{Limits, Rate};
/// use armwire_host::follow::{Follow, Output, Start};
///
/// let mut follow = Follow::new(Limits::FOLLOW, Start::Approach, Rate::MOVES)?;
/// let now = Instant::ZERO;
/// let state = JointState { joints: [2048; 6], gripper: 500, status: MotionStatus::Locked };
/// follow.on_follower(now, &state);
/// follow.on_leader(now, &JointState { joints: [2050; 6], ..state });
/// let Output::Move(target) = follow.poll(now)? else { panic!("no move") };
/// assert_eq!(target.joints[0].0.ticks(), 2048);
/// let Output::Wait(now) = follow.poll(now)? else { panic!("no pause") };
/// let Output::Move(target) = follow.poll(now)? else { panic!("no move") };
/// assert_eq!(target.joints[0].0.ticks(), 2050);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Follow {
    engine: Engine,
    script: Script,
    /// The joints of the follower's last reading.
    follower: Option<[u16; JOINTS]>,
    lag: Option<Duration>,
}

/// The source of the follower's targets.
#[derive(Clone, Debug)]
struct Script {
    limits: Limits,
    start: Start,
    phase: Phase,
    /// The end of the time for the first readings, from the first poll on.
    deadline: Option<Instant>,
    silence: Duration,
    leader: Option<Reading>,
    /// The leader's last poses, the oldest first.
    history: VecDeque<(Instant, [u16; JOINTS])>,
}

/// A reading, and the time at which it was made.
#[derive(Clone, Copy, Debug)]
struct Reading {
    at: Instant,
    state: JointState,
}

#[derive(Clone, Copy, Debug)]
enum Phase {
    Starting,
    Approaching,
    Following,
    Waiting(Pause),
    Ended(End),
}

impl Follow {
    /// Teleoperation with moves at this rate.
    ///
    /// # Errors
    ///
    /// [`Refusal`] for limits within which a joint does not move: a speed under
    /// [`Speed::SLOWEST`](armwire::ling::Speed::SLOWEST), or a step of 0. And for a rate at which the steps are slower than
    /// the speeds: the follower would fall behind.
    pub fn new(limits: Limits, start: Start, rate: Rate) -> Result<Self, Refusal> {
        limits.check().map_err(Refusal::Limits)?;
        let needed = limits.least_rate();
        if needed.is_none_or(|needed| rate.hertz() < needed.hertz()) {
            return Err(Refusal::Rate {
                rate,
                step: degrees(limits.step.into()),
                max: degrees(limits.fastest().ticks_per_second().into()),
                needed,
            });
        }
        let silence = SilenceLimit::PAUSE.at(rate.micros());
        Ok(Self {
            engine: Engine::new(rate, silence, [None; AXES]),
            script: Script {
                limits,
                start,
                phase: Phase::Starting,
                deadline: None,
                silence,
                leader: None,
                history: VecDeque::new(),
            },
            follower: None,
            lag: None,
        })
    }

    /// Takes a reading of the leader that was made at `at`.
    pub fn on_leader(&mut self, at: Instant, state: &JointState) {
        if state.positions().is_err() {
            return;
        }
        let Script { leader, history, .. } = &mut self.script;
        *leader = Some(Reading { at, state: *state });
        history.push_back((at, state.joints));
        while history.front().is_some_and(|(kept, _)| at.since(*kept) > HISTORY) {
            history.pop_front();
        }
    }

    /// Takes a reading of the follower that was made at `at`.
    pub fn on_follower(&mut self, at: Instant, state: &JointState) {
        self.engine.on_joints(at, state);
        if state.positions().is_err() {
            return;
        }
        self.follower = Some(state.joints);
        self.lag = match self.script.phase {
            Phase::Following => self.script.lag_of(at, &state.joints),
            _ => None,
        };
    }

    /// The next action.
    ///
    /// # Errors
    ///
    /// [`End`], and no move comes any more.
    pub fn poll(&mut self, now: Instant) -> Result<Output, End> {
        if let Phase::Ended(end) = self.script.phase {
            return Err(end);
        }
        self.script.deadline.get_or_insert(now + MAX_WAIT);
        match self.engine.poll(now, &mut self.script) {
            engine::Output::Move(next) => Ok(Output::Move(next)),
            engine::Output::Wait(until) => Ok(Output::Wait(until)),
            engine::Output::End(Ok(pause)) => {
                self.engine.rest();
                self.script.phase = Phase::Waiting(pause);
                Ok(Output::Stop(pause))
            }
            engine::Output::End(Err(end)) => {
                self.script.phase = Phase::Ended(end);
                Err(end)
            }
        }
    }

    /// State of the follower.
    pub fn progress(&self) -> Progress {
        match self.script.phase {
            Phase::Starting | Phase::Ended(_) => Progress::Starting,
            Phase::Approaching => Progress::Approaching(self.distance()),
            Phase::Following => Progress::Following,
            Phase::Waiting(pause) => Progress::Waiting(pause, self.distance()),
        }
    }

    /// The time by which the follower is behind the leader: the age of the leader's pose that the follower's last reading
    /// is nearest to, within 0.26°. `None` unless it follows.
    pub fn lag(&self) -> Option<Duration> {
        self.lag
    }

    /// The distance of the farthest joint, in degrees; 0 before the first readings.
    fn distance(&self) -> f64 {
        match (self.script.leader, self.follower) {
            (Some(leader), Some(follower)) => {
                let [leader, follower] = [leader.state.joints, follower].map(|joints| joints.map(f64::from));
                degrees(farthest(&leader, &follower).1)
            }
            _ => 0.0,
        }
    }
}

impl Source for Script {
    /// A pause, or the end of teleoperation.
    type End = Result<Pause, End>;

    fn next(&mut self, now: Instant, _: Duration, arm: &Seen) -> Next<Self::End> {
        let Some(leader) = self.leader else {
            return self.unread(now).map_or(Next::Rest, Next::End);
        };
        let age = now.since(leader.at);
        let is_late = age > self.silence;
        let target = leader.state.joints.map(f64::from);
        let (joint, distance) = farthest(&arm.goal, &target);
        let (joint, off) = (joint as u8 + 1, degrees(distance));
        let is_near = distance <= NEAR;
        self.phase = match (self.phase, self.start) {
            (Phase::Starting | Phase::Waiting(_), _) if is_late => {
                return self.unread(now).map_or(Next::Rest, Next::End);
            }
            _ if is_late => return Next::End(Ok(Pause::LeaderLate(age))),
            (Phase::Following, _) if distance > FAR => return Next::End(Ok(Pause::LeaderAhead(joint, off))),
            (Phase::Following, _) => Phase::Following,
            _ if is_near => Phase::Following,
            (Phase::Approaching, _) | (Phase::Starting, Start::Approach) => Phase::Approaching,
            (Phase::Starting, Start::Refuse) => return Next::End(Err(End::Far(joint, off))),
            _ => return Next::Rest,
        };
        // A reading beyond the open end stands for that end.
        let gripper = leader.state.opening().unwrap_or(Opening::OPEN);
        Next::Go(Target {
            joints: target,
            gripper: Some(gripper.per_mille().into()),
            way: Way::Within(match self.phase {
                Phase::Approaching => self.limits.of_approach(),
                _ => self.limits,
            }),
            tracking: TrackingLimit::DEFAULT,
        })
    }

    fn on_fault(&mut self, now: Instant, fault: Fault) -> Option<Self::End> {
        let is_moving = matches!(self.phase, Phase::Approaching | Phase::Following);
        match fault {
            Fault::Immovable(reason) => Some(Err(End::Immovable(reason))),
            Fault::Silent(age) if is_moving => Some(Ok(Pause::FollowerLate(age))),
            Fault::TrackingError(off) => Some(Ok(Pause::TrackingError(off))),
            Fault::Silent(_) | Fault::Position(_) | Fault::Target(_) => self.unread(now),
        }
    }
}

impl Script {
    /// The end, if the time for the first readings is over.
    fn unread(&self, now: Instant) -> Option<Result<Pause, End>> {
        let is_over = self.deadline.is_some_and(|deadline| now > deadline);
        (matches!(self.phase, Phase::Starting) && is_over).then_some(Err(End::Unread))
    }

    /// The age at `at` of the leader's pose that is nearest to this one. The newest of those that are about as near.
    fn lag_of(&self, at: Instant, joints: &[u16; JOINTS]) -> Option<Duration> {
        let distance = |pose: &[u16; JOINTS]| {
            let joints = joints.iter().zip(pose);
            joints.map(|(one, other)| one.abs_diff(*other)).fold(0, u16::max)
        };
        let poses = || self.history.iter().rev().filter(|(made, _)| *made <= at);
        let least = poses().map(|(_, pose)| distance(pose)).min()?;
        let nearest = poses().find(|(_, pose)| distance(pose) <= least + Rest::TOLERANCE)?;
        Some(at.since(nearest.0))
    }
}
