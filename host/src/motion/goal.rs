//! The goal of a streamed motion: how far it may be from the one before, how fast the joints go there, and which joint
//! does not.

use armwire::OutOfRange;
use armwire::ling::{GripperSpeed, JOINTS, Move, Rest, Speed};
use armwire::time::{Duration, Instant};

use crate::motion::axes::{self, AXES, Axes, Off, Ticks, Tolerance, off, opening, position, seconds, with_gripper};
use crate::time::rate::Rate;

/// The gripper's speed in [`Way::At`], as the vendor's software always sends it. The setpoints of a trajectory limit the
/// gripper: at [`GripperSpeed::DEFAULT`] it would be late.
const TRAJECTORY_GRIPPER_SPEED: GripperSpeed = GripperSpeed(5500);
/// The speed on the way to a motion: 20°/s.
pub(crate) const APPROACH_SPEED: Speed = speed(228);
/// The difference of two positions that is no motion, in ticks or thousandths: the noise of readings.
const TREMBLE: f64 = Rest::TOLERANCE as f64;
/// The time in which a joint makes up for its distance from the goal before, in seconds.
const CATCH_UP_S: f64 = 0.05;

/// The limits of a streamed motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Maximum speed of each joint, and of its goals.
    pub speeds: [Speed; JOINTS],
    /// Maximum distance between two goals of a joint, in ticks. It limits a program that was held up.
    pub step: u16,
}

impl Limits {
    /// 90°/s, and 5° a step.
    pub const FOLLOW: Self = Self {
        speeds: [speed(1_024); JOINTS],
        step: 56,
    };

    /// 180°/s, and 5° a step.
    pub const REPLAY: Self = Self {
        speeds: [speed(2_048); JOINTS],
        step: 56,
    };

    /// Refuses limits within which a joint does not move.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] for a speed under [`Speed::SLOWEST`], and for a step of 0.
    pub(crate) fn check(&self) -> Result<(), OutOfRange> {
        for speed in self.speeds {
            Speed::for_move(speed.ticks_per_second())?;
        }
        match self.step {
            0 => Err(OutOfRange::new("distance between two goals", "ticks", 0, 1, u16::MAX)),
            _ => Ok(()),
        }
    }

    /// The least rate at which goals a step apart have the speeds; `None` if no rate is fast enough.
    pub(crate) fn least_rate(&self) -> Option<Rate> {
        let hertz = (self.step > 0).then(|| self.fastest().ticks_per_second().div_ceil(self.step))?;
        Rate::new(hertz).ok()
    }

    /// The highest of the speeds.
    pub(crate) fn fastest(&self) -> Speed {
        self.speeds.into_iter().fold(Speed::SLOWEST, Speed::max)
    }

    /// Those on the way to a motion: 20°/s at most.
    pub(crate) fn of_approach(&self) -> Self {
        Self {
            speeds: self.speeds.map(|speed| speed.min(APPROACH_SPEED)),
            ..*self
        }
    }
}

/// The limit of the tracking error, which is the distance of an arm from its moving goal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackingLimit {
    /// The distance that counts as an error.
    pub allowed: Tolerance,
    /// The time after which it counts, if the goal stands, or the distance has grown meanwhile.
    pub time: Duration,
}

impl Target {
    /// Refuses a target that no move can express.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] for a position, a speed or a limit.
    pub(crate) fn check(&self) -> Result<(), OutOfRange<f32>> {
        axes::check(&with_gripper(self.joints, self.gripper.unwrap_or(0.0)))?;
        match self.way {
            Way::Within(limits) => limits.check()?,
            Way::At(speeds) => {
                for speed in speeds {
                    Speed::for_move(speed.ticks_per_second())?;
                }
            }
        }
        Ok(())
    }
}

impl TrackingLimit {
    /// Any distance.
    pub const ANY: Self = Self {
        allowed: [None; AXES],
        time: Duration::ZERO,
    };
    /// A joint is 10° away for 0.5 s: something is in its way. A gripper at an object does not reach its goal.
    pub const DEFAULT: Self = {
        let joint = Some(10.0 * 4_096.0 / 360.0);
        Self {
            allowed: [joint, joint, joint, joint, joint, joint, None],
            time: Duration::from_millis(500),
        }
    };
}

/// How the joints go to a target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Way {
    /// The goals go there within these limits, with speeds that bring an arm to the next one within a period and make up
    /// for its distance from the last one. The limits are those of the joints: the target is the gripper's goal.
    Within(Limits),
    /// The target is the goal, at these speeds: it was checked before.
    At([Speed; JOINTS]),
}

/// Where the arm is to be at the next move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Target {
    /// The joints, in ticks.
    pub joints: Ticks,
    /// The gripper, in thousandths of its stroke; `None` keeps its goal.
    pub gripper: Option<f64>,
    /// How the joints go there.
    pub way: Way,
    /// The limit of the tracking error from now on.
    pub tracking: TrackingLimit,
}

/// Where the last move sends each axis. An axis without a goal is where its reading is.
#[derive(Clone, Debug)]
pub(crate) struct Goal {
    axes: [Option<Axis>; AXES],
    /// The time of the last move.
    moved: Option<Instant>,
    tracking: TrackingLimit,
    /// An axis is too far away.
    astray: Option<Astray>,
}

/// The time in which an axis is too far from its goal.
#[derive(Clone, Debug)]
struct Astray {
    since: Instant,
    /// The goal and the pose then.
    goal: Axes,
    pose: Axes,
    /// The axis, once this counts.
    error: Option<Off>,
}

impl Astray {
    /// Returns true if this axis does not follow: its goal stands, or the distance from it has grown. An arm that only lags
    /// behind a moving goal follows.
    fn is_left_behind(&self, axis: usize, goal: &Axes, pose: &Axes) -> bool {
        let grown = (goal[axis] - pose[axis]).abs() - (self.goal[axis] - self.pose[axis]).abs();
        grown > TREMBLE || (goal[axis] - self.goal[axis]).abs() <= TREMBLE
    }
}

#[derive(Clone, Copy, Debug)]
struct Axis {
    goal: f64,
    /// The least distance of a reading so far.
    nearest: f64,
}

impl Goal {
    /// No goal.
    pub(crate) const NONE: Self = Self {
        axes: [None; AXES],
        moved: None,
        tracking: TrackingLimit::ANY,
        astray: None,
    };

    /// The goal of an arm at this pose.
    pub(crate) fn axes(&self, pose: &Axes) -> Axes {
        std::array::from_fn(|nth| self.axes[nth].map_or(pose[nth], |axis| axis.goal))
    }

    /// Ends the tracking: later readings are no error, until the next target.
    pub(crate) fn end_tracking(&mut self) {
        (self.tracking, self.astray) = (TrackingLimit::ANY, None);
    }

    /// The axis that has been too far from its goal for too long, even if it is near by now.
    pub(crate) fn tracking_error(&self) -> Option<Off> {
        self.astray.as_ref().and_then(|astray| astray.error)
    }

    /// Takes the pose in a reading that was made at `at`. An axis that moves away from its goal by more than `drift` was
    /// moved by another host: it has no goal any more.
    pub(crate) fn on_pose(&mut self, at: Instant, pose: &Axes, drift: &Tolerance) {
        if self.tracking_error().is_none() {
            let (goal, time) = (self.axes(pose), self.tracking.time);
            let before = self.astray.take();
            self.astray = off(&goal, pose, &self.tracking.allowed).map(|off| match before {
                Some(astray) if at.since(astray.since) < time => astray,
                Some(astray) if astray.is_left_behind(off.axis, &goal, pose) => Astray {
                    error: Some(off),
                    ..astray
                },
                _ => Astray {
                    since: at,
                    goal,
                    pose: *pose,
                    error: (time == Duration::ZERO).then_some(off),
                },
            });
        }
        for nth in 0..AXES {
            let Some(axis) = &mut self.axes[nth] else { continue };
            let distance = (axis.goal - pose[nth]).abs();
            axis.nearest = axis.nearest.min(distance);
            if drift[nth].is_some_and(|drift| distance > axis.nearest + drift) {
                self.axes[nth] = None;
            }
        }
    }

    /// Goes towards a target, with an arm at this pose.
    pub(crate) fn advance(&mut self, now: Instant, target: &Target, pose: &Axes, period: Duration) -> Move {
        let before = self.axes(pose);
        let passed = self.moved.map_or(Duration::ZERO, |moved| now.since(moved));
        let mut joints = std::array::from_fn(|_| (position(0.0), Speed::SLOWEST));
        let mut goal = before;
        for joint in 0..JOINTS {
            let (to, from) = (target.joints[joint], before[joint]);
            let speed = match target.way {
                Way::At(speeds) => {
                    goal[joint] = to;
                    speeds[joint]
                }
                Way::Within(limits) => {
                    let max = limits.speeds[joint];
                    let step = (f64::from(max.ticks_per_second()) * seconds(passed)).min(limits.step.into());
                    goal[joint] = match (to - from).abs() <= step {
                        true => to,
                        false => from + step.copysign(to - from),
                    };
                    let late = (from - pose[joint]).abs();
                    speed_within((goal[joint] - from).abs() / seconds(period) + late / CATCH_UP_S, max)
                }
            };
            joints[joint] = (position(goal[joint]), speed);
        }
        goal[JOINTS] = target.gripper.unwrap_or(before[JOINTS]);
        if self.tracking != target.tracking {
            (self.tracking, self.astray) = (target.tracking, None);
        }
        let gripper_speed = match target.way {
            Way::At(_) => TRAJECTORY_GRIPPER_SPEED,
            Way::Within(_) => GripperSpeed::DEFAULT,
        };
        let nearest = f64::INFINITY;
        self.axes = goal.map(|goal| Some(Axis { goal, nearest }));
        self.moved = Some(now);
        Move {
            joints,
            gripper: (opening(goal[JOINTS]), gripper_speed),
        }
    }
}

const fn speed(ticks_per_second: u16) -> Speed {
    match Speed::for_move(ticks_per_second) {
        Ok(speed) => speed,
        Err(_) => Speed::SLOWEST,
    }
}

/// The speed of a joint that is to move, nearest to this one and at most `max`.
fn speed_within(ticks_per_second: f64, max: Speed) -> Speed {
    let nearest = ticks_per_second.round().min(max.ticks_per_second().into());
    Speed::for_move(nearest as u16).unwrap_or(Speed::SLOWEST)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose(ticks: f64) -> Axes {
        with_gripper([ticks; JOINTS], 0.0)
    }

    const PERIOD: Duration = Duration::from_millis(10);

    /// A goal that was sent to an arm at this position.
    fn goal_at(ticks: f64) -> Goal {
        let mut goal = Goal::NONE;
        advance(&mut goal, Instant::ZERO, ticks, ticks, Limits::FOLLOW);
        goal
    }

    fn advance(goal: &mut Goal, now: Instant, ticks: f64, at: f64, limits: Limits) -> Move {
        let target = Target {
            joints: [ticks; JOINTS],
            gripper: Some(0.0),
            way: Way::Within(limits),
            tracking: TrackingLimit::DEFAULT,
        };
        goal.advance(now, &target, &pose(at), PERIOD)
    }

    /// The first joint of the move after so many milliseconds without one.
    fn advanced(goal: &mut Goal, millis: u64, target: f64, at: u16) -> (u16, u16) {
        let now = goal.moved.unwrap() + Duration::from_millis(millis);
        let (position, speed) = advance(goal, now, target, at.into(), Limits::FOLLOW).joints[0];
        (position.ticks(), speed.ticks_per_second())
    }

    #[test]
    fn steps_are_limited_by_speed_and_by_distance() {
        let mut goal = goal_at(2_000.0);
        assert_eq!(advanced(&mut goal, 10, 4_000.0, 2_000), (2_010, 1_024));
        assert_eq!(advanced(&mut goal, 500, 4_000.0, 2_010), (2_066, 1_024));
        assert_eq!(advanced(&mut goal, 10, 0.0, 2_066).0, 2_056);
    }

    #[test]
    fn speed_arrives_with_the_next_goal() {
        let mut goal = goal_at(2_000.0);
        assert_eq!(advanced(&mut goal, 10, 2_005.0, 2_000), (2_005, 500));
        // Four ticks late, which are made up for in 50 ms.
        assert_eq!(advanced(&mut goal, 10, 2_010.0, 2_001), (2_010, 580));
        assert_eq!(advanced(&mut goal, 10, 2_010.0, 2_010), (2_010, 50));
    }

    #[test]
    fn slow_goals_arrive_at_high_rates() {
        let mut goal = goal_at(2_000.0);
        let limits = Limits {
            speeds: [Speed::SLOWEST; JOINTS],
            ..Limits::FOLLOW
        };
        for millis in 1..=1_000 {
            advance(&mut goal, Instant::from_millis(millis), 2_100.0, 2_000.0, limits);
        }
        let [joint, ..] = goal.axes(&pose(0.0));
        assert!((joint - 2_050.0).abs() < 0.001, "{joint}");
    }

    #[test]
    fn each_joint_has_its_own_limit() {
        let mut goal = goal_at(2_000.0);
        let mut limits = Limits::FOLLOW;
        limits.speeds[3] = Speed::SLOWEST;
        let next = advance(&mut goal, Instant::from_millis(100), 2_100.0, 2_000.0, limits);
        let reached = next.joints.map(|(position, _)| position.ticks());
        assert_eq!(reached, [2_056, 2_056, 2_056, 2_005, 2_056, 2_056]);
        assert_eq!(next.joints[3].1, Speed::SLOWEST);
    }

    #[test]
    fn tracking_error_counts_after_half_a_second() {
        let mut goal = goal_at(2_000.0);
        let mut error = |millis, at| {
            goal.on_pose(Instant::from_millis(millis), &pose(at), &[None; AXES]);
            goal.tracking_error().map(|off| (off.axis, off.distance))
        };
        assert_eq!(error(0, 2_114.0), None);
        assert_eq!(error(499, 2_120.0), None);
        assert_eq!(error(500, 2_113.0), None);
        assert_eq!(error(600, 1_800.0), None);
        assert_eq!(error(1_100, 1_800.0), Some((0, 200.0)));
    }

    /// The tracking error of a joint that is at these distances behind a goal which moves by 10 ticks a reading.
    fn error_behind(distance: impl Fn(f64) -> f64) -> Option<f64> {
        let mut goal = goal_at(1_000.0);
        for reading in 1..=200 {
            let to = 1_000.0 + 10.0 * f64::from(reading);
            let at = to - distance(to);
            let now = Instant::from_millis(10 * reading as u64);
            advance(&mut goal, now, to, at, Limits::FOLLOW);
            goal.on_pose(now, &pose(at), &[None; AXES]);
        }
        goal.tracking_error().map(|off| off.distance)
    }

    #[test]
    fn arm_that_lags_behind_a_moving_goal_follows() {
        assert_eq!(error_behind(|_| 150.0), None);
        // It catches up.
        assert_eq!(error_behind(|to| (4_000.0 - to) / 10.0), None);
    }

    #[test]
    fn arm_that_stays_behind_a_moving_goal_does_not_follow() {
        // It stands at 1200.
        assert_eq!(error_behind(|to| (to - 1_200.0).max(0.0)), Some(620.0));
        assert!(
            error_behind(|to| (to - 1_000.0) / 2.0).is_some(),
            "it moves at half of the speed"
        );
    }

    #[test]
    fn axis_that_is_moved_away_gives_its_goal_up() {
        let mut goal = goal_at(2_000.0);
        let drift = [Some(30.0); AXES];
        let mut held = |at| {
            goal.on_pose(Instant::ZERO, &pose(at), &drift);
            goal.axes(&pose(at))[0]
        };
        // It comes nearer, to 10 ticks.
        assert_eq!([2_100.0, 2_010.0, 2_040.0].map(&mut held), [2_000.0; 3]);
        assert_eq!([2_041.0, 2_060.0].map(held), [2_041.0, 2_060.0]);
    }
}
