//! Teleoperation: readings of a leader and of a follower in, moves of the follower out.
//!
//! A [`Follow`] decides what the follower does. It does no I/O and reads no clock.

use std::collections::VecDeque;
use std::error;
use std::fmt;

use armwire::ling::{JOINTS, JointState, MotionStatus, Move, Opening};
use armwire::time::{Duration, Instant};

use crate::motion::goal::{APPROACH_SPEED, Deviation, Goal, Limits, degrees, farthest, seconds};
use crate::time::pace::Pace;
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
    Deviation(Deviation),
}

impl fmt::Display for Pause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::LeaderLate(age) => write!(f, "no pose of the leader for {:.2} s", seconds(age)),
            Self::FollowerLate(age) => write!(f, "no pose of the follower for {:.2} s", seconds(age)),
            Self::LeaderAhead(joint, degrees) => write!(f, "joint {joint} of the leader is {degrees:.0}° ahead"),
            Self::Deviation(Deviation { joint, ticks }) => {
                let degrees = degrees(f64::from(ticks));
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
    /// The follower's torque is off, as in this status. Nothing is sent any more.
    TorqueOff(MotionStatus),
    /// A joint, from 1, was too far from the leader at the start, at this distance in degrees. Nothing was sent.
    Far(u8, f64),
    /// The arms were not both read within 2 s after the start. Nothing was sent.
    Unread,
}

impl fmt::Display for End {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::TorqueOff(status) => write!(f, "the follower's torque is off (status {status})"),
            Self::Far(joint, degrees) => write!(
                f,
                "joint {joint} of the follower is {degrees:.0}° away from the leader's: bring them within 5°"
            ),
            Self::Unread => f.write_str("the arms do not both answer"),
        }
    }
}

impl error::Error for End {}

/// A follower that follows a leader.
///
/// [`poll`](Self::poll) returns moves, a period apart, whose goals stay within the [`Limits`]. Readings of both arms go in
/// as they come, with the times at which they were made. A pose that no move can express counts as missing.
///
/// ```
/// use armwire::ling::{JointState, MotionStatus};
/// use armwire::time::{Duration, Instant};
/// use armwire_host::Limits;
/// use armwire_host::follow::{Follow, Output, Start};
///
/// let mut follow = Follow::new(Limits::FOLLOW, Start::Approach, Duration::from_millis(10));
/// let now = Instant::ZERO;
/// let state = JointState { joints: [2048; 6], gripper: 500, status: MotionStatus::Locked };
/// follow.on_follower(now, &state);
/// follow.on_leader(now, &JointState { joints: [2050; 6], ..state });
/// let Output::Move(target) = follow.poll(now)? else { panic!("no move") };
/// assert_eq!(target.joints[0].0.ticks(), 2048);
/// let Output::Wait(now) = follow.poll(now)? else { panic!("no pause") };
/// let Output::Move(target) = follow.poll(now)? else { panic!("no move") };
/// assert_eq!(target.joints[0].0.ticks(), 2050);
/// # Ok::<(), armwire_host::follow::End>(())
/// ```
#[derive(Clone, Debug)]
pub struct Follow {
    limits: Limits,
    start: Start,
    pace: Pace,
    phase: Phase,
    /// The time of the first poll.
    begun: Option<Instant>,
    leader: Option<Reading>,
    follower: Option<Reading>,
    /// The leader's last poses, the oldest first.
    history: VecDeque<(Instant, [u16; JOINTS])>,
    lag: Option<Duration>,
}

/// A reading, and the time at which it was made.
#[derive(Clone, Copy, Debug)]
struct Reading {
    at: Instant,
    state: JointState,
}

#[derive(Clone, Debug)]
enum Phase {
    Starting,
    Approaching(Goal),
    Following(Goal),
    Waiting(Pause),
    Ended(End),
}

impl Follow {
    /// Teleoperation with a move per `period`.
    pub fn new(limits: Limits, start: Start, period: Duration) -> Self {
        Self {
            limits,
            start,
            pace: Pace::new(period),
            phase: Phase::Starting,
            begun: None,
            leader: None,
            follower: None,
            history: VecDeque::new(),
            lag: None,
        }
    }

    /// Takes a reading of the leader that was made at `at`.
    pub fn on_leader(&mut self, at: Instant, state: &JointState) {
        if state.positions().is_err() {
            return;
        }
        self.leader = Some(Reading { at, state: *state });
        self.history.push_back((at, state.joints));
        while self.history.front().is_some_and(|(kept, _)| at.since(*kept) > HISTORY) {
            self.history.pop_front();
        }
    }

    /// Takes a reading of the follower that was made at `at`.
    pub fn on_follower(&mut self, at: Instant, state: &JointState) {
        if state.status.is_torque_off() {
            self.phase = match self.phase {
                Phase::Ended(end) => Phase::Ended(end),
                _ => Phase::Ended(End::TorqueOff(state.status)),
            };
            return;
        }
        if state.positions().is_err() {
            return;
        }
        self.follower = Some(Reading { at, state: *state });
        self.lag = match self.phase {
            Phase::Following(_) => self.lag_of(at, &state.joints),
            _ => None,
        };
    }

    /// The next action.
    ///
    /// # Errors
    ///
    /// [`End`], and no move comes any more.
    pub fn poll(&mut self, now: Instant) -> Result<Output, End> {
        let begun = *self.begun.get_or_insert(now);
        if let Phase::Ended(end) = self.phase {
            return Err(end);
        }
        if self.pace.begin(now).is_none() {
            return Ok(Output::Wait(self.pace.next()));
        }
        let (Some(leader), Some(follower)) = (self.leader, self.follower) else {
            if now.since(begun) <= MAX_WAIT {
                return Ok(Output::Wait(self.pace.next()));
            }
            return Err(self.end(End::Unread));
        };
        if let Phase::Starting | Phase::Waiting(_) = self.phase {
            self.begin(now, &leader, &follower, now.since(begun))?;
        }
        let is_approach = matches!(self.phase, Phase::Approaching(_));
        let late = self.late(now, &leader, &follower);
        let (Phase::Approaching(goal) | Phase::Following(goal)) = &mut self.phase else {
            return Ok(Output::Wait(self.pace.next()));
        };
        let target = leader.state.joints.map(f64::from);
        let (joint, ahead) = farthest(goal.ticks(), &target);
        let pause = if late.is_some() {
            late
        } else if !is_approach && ahead > FAR {
            Some(Pause::LeaderAhead(joint as u8 + 1, degrees(ahead)))
        } else {
            goal.deviation(follower.at, &follower.state).map(Pause::Deviation)
        };
        if let Some(pause) = pause {
            self.phase = Phase::Waiting(pause);
            return Ok(Output::Stop(pause));
        }
        let limits = Limits {
            speed: match is_approach {
                true => self.limits.speed.min(APPROACH_SPEED),
                false => self.limits.speed,
            },
            ..self.limits
        };
        // A reading beyond the open end stands for that end.
        let gripper = leader.state.opening().unwrap_or(Opening::OPEN);
        let next = goal.advance(now, &target, gripper, &limits, &follower.state, self.pace.period());
        if is_approach && farthest(goal.ticks(), &target).1 <= NEAR {
            self.phase = Phase::Following(goal.clone());
        }
        Ok(Output::Move(next))
    }

    /// State of the follower.
    pub fn progress(&self) -> Progress {
        match self.phase {
            Phase::Starting | Phase::Ended(_) => Progress::Starting,
            Phase::Approaching(_) => Progress::Approaching(self.distance()),
            Phase::Following(_) => Progress::Following,
            Phase::Waiting(pause) => Progress::Waiting(pause, self.distance()),
        }
    }

    /// The time by which the follower is behind the leader: the age of the leader's pose that the follower's last reading
    /// is nearest to, within 0.26°. `None` unless it follows.
    pub fn lag(&self) -> Option<Duration> {
        self.lag
    }

    fn end(&mut self, end: End) -> End {
        self.phase = Phase::Ended(end);
        end
    }

    /// Begins to follow, if the arms are near, or for the first time.
    fn begin(&mut self, now: Instant, leader: &Reading, follower: &Reading, waited: Duration) -> Result<(), End> {
        if self.late(now, leader, follower).is_some() {
            return match self.phase {
                Phase::Starting if waited > MAX_WAIT => Err(self.end(End::Unread)),
                _ => Ok(()),
            };
        }
        let Ok(goal) = Goal::of(now, &follower.state) else {
            return Ok(());
        };
        let (joint, distance) = farthest(goal.ticks(), &leader.state.joints.map(f64::from));
        self.phase = match (&self.phase, self.start) {
            _ if distance <= NEAR => Phase::Following(goal),
            (Phase::Starting, Start::Approach) => Phase::Approaching(goal),
            (Phase::Starting, Start::Refuse) => return Err(self.end(End::Far(joint as u8 + 1, degrees(distance)))),
            _ => return Ok(()),
        };
        Ok(())
    }

    /// The distance of the farthest joint, in degrees; 0 before the first readings.
    fn distance(&self) -> f64 {
        let joints = |reading: &Option<Reading>| reading.map(|reading| reading.state.joints.map(f64::from));
        match (joints(&self.leader), joints(&self.follower)) {
            (Some(leader), Some(follower)) => degrees(farthest(&leader, &follower).1),
            _ => 0.0,
        }
    }

    /// The age at `at` of the leader's pose that is nearest to this one. The newest of those that are about as near.
    fn lag_of(&self, at: Instant, joints: &[u16; JOINTS]) -> Option<Duration> {
        let distance = |pose: &[u16; JOINTS]| {
            let joints = joints.iter().zip(pose);
            joints.map(|(one, other)| one.abs_diff(*other)).fold(0, u16::max)
        };
        let poses = || self.history.iter().rev().filter(|(made, _)| *made <= at);
        let least = poses().map(|(_, pose)| distance(pose)).min()?;
        let nearest = poses().find(|(_, pose)| distance(pose) <= least + Move::JOINT_TOLERANCE)?;
        Some(at.since(nearest.0))
    }

    /// The reason to rest, if an arm was not read for too long.
    fn late(&self, now: Instant, leader: &Reading, follower: &Reading) -> Option<Pause> {
        let limit = SilenceLimit::PAUSE.at(self.pace.period());
        let ages = [now.since(leader.at), now.since(follower.at)];
        match ages.map(|age| age > limit) {
            [true, _] => Some(Pause::LeaderLate(ages[0])),
            [_, true] => Some(Pause::FollowerLate(ages[1])),
            [false, false] => None,
        }
    }
}
