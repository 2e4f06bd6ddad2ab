//! A trajectory: poses at their times, which an arm makes at constant speed from one to the next.

use std::error;
use std::fmt;

use armwire::OutOfRange;
use armwire::ling::{JOINTS, Speed};
use armwire::time::{Duration, Instant};

use crate::motion::axes::{self, Axes, Off, Tolerance, between, joints, off, part, seconds};
use crate::motion::engine::{Fault, Next, Seen, Source};
use crate::motion::goal::{Target, TrackingLimit, Way};

/// A pose of a trajectory.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Knot {
    /// Its time since the start.
    pub at: Duration,
    /// The pose.
    pub axes: Axes,
}

/// The distances that are tolerated.
#[derive(Clone, Debug, PartialEq)]
pub struct Tolerances {
    /// The tracking error until the last pose.
    pub path: Tolerance,
    /// The deviation from the last pose after it.
    pub goal: Tolerance,
    /// The time after the last pose until the arm must be at it.
    pub goal_time: Duration,
}

/// The reason why a trajectory is refused. Poses are numbered from 1, 0 is the start.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Refusal {
    /// No move can express this pose.
    Position {
        /// The pose.
        pose: usize,
        /// Its axis that is out of range.
        error: OutOfRange<f32>,
    },
    /// The time of this pose is not after that of the one before.
    Order {
        /// The pose.
        pose: usize,
    },
    /// A joint cannot reach this pose in its time.
    Speed {
        /// The pose.
        pose: usize,
        /// The joint, from 1.
        joint: u8,
        /// Its speed.
        ticks_per_second: f64,
    },
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Position { pose, error } => write!(f, "pose {pose}: {error}"),
            Self::Order { pose } => write!(f, "the time of pose {pose} is not after that of the one before"),
            Self::Speed {
                pose,
                joint,
                ticks_per_second,
            } => {
                let max = Speed::MAX.ticks_per_second();
                write!(
                    f,
                    "joint {joint} would go to pose {pose} at {ticks_per_second:.0} ticks/s, must be at most {max}"
                )
            }
        }
    }
}

impl error::Error for Refusal {}

/// The end of a trajectory.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum End {
    /// The arm is at the last pose.
    Arrived,
    /// An axis was not at the last pose in time: its deviation.
    Away(Off),
    /// A fault of the arm.
    Fault(Fault),
}

/// A trajectory that is played. It keeps its own speeds.
#[derive(Clone, Debug)]
pub struct Trajectory {
    /// The pose at the beginning.
    start: Axes,
    /// The later poses.
    knots: Vec<Knot>,
    tolerances: Option<Tolerances>,
    began: Instant,
    /// The last pose was sent.
    is_sent: bool,
}

impl Trajectory {
    /// A trajectory from the pose `start` at `began`, whose times grow. A first pose at time 0 replaces `start`. Without
    /// tolerances it ends with its last pose, wherever the arm is.
    ///
    /// # Errors
    ///
    /// [`Refusal`] for poses, times or speeds that no arm can have.
    pub fn new(start: Axes, knots: Vec<Knot>, tolerances: Option<Tolerances>, began: Instant) -> Result<Self, Refusal> {
        let at = Duration::ZERO;
        let mut before = Knot { at, axes: start };
        axes::check(&start).map_err(|error| Refusal::Position { pose: 0, error })?;
        for (pose, knot) in (1..).zip(&knots) {
            axes::check(&knot.axes).map_err(|error| Refusal::Position { pose, error })?;
            let is_replaced = pose == 1 && knot.at == Duration::ZERO;
            if !is_replaced {
                check_speeds(pose, &before, knot)?;
            }
            before = *knot;
        }
        Ok(Self {
            start,
            knots,
            tolerances,
            began,
            is_sent: false,
        })
    }

    /// The pose at a time. After the end, the last one.
    pub fn at(&self, now: Instant) -> Axes {
        let elapsed = now.since(self.began);
        let (from, to) = self.segment(elapsed);
        between(&from.axes, &to.axes, part(from.at, to.at, elapsed))
    }

    /// True once the last pose was sent. The arm may not be there yet.
    pub fn is_sent(&self) -> bool {
        self.is_sent
    }

    /// Takes a pose that the arm had at `at`. Returns the end, if it is at the last pose, or is not there in time.
    pub fn on_pose(&self, at: Instant, pose: &Axes) -> Option<End> {
        let tolerances = self.tolerances.as_ref().filter(|_| self.is_sent)?;
        let end = self.began + self.length();
        match off(&self.at(end), pose, &tolerances.goal) {
            None => Some(End::Arrived),
            Some(off) if at.since(end) >= tolerances.goal_time => Some(End::Away(off)),
            Some(_) => None,
        }
    }

    fn length(&self) -> Duration {
        self.knots.last().map_or(Duration::ZERO, |knot| knot.at)
    }

    /// The poses before and after a time since the beginning. After the end, the last two.
    fn segment(&self, elapsed: Duration) -> (Knot, Knot) {
        let last = self.knots.len().saturating_sub(1);
        let next = self.knots.partition_point(|knot| knot.at < elapsed).min(last);
        let start = Knot {
            at: Duration::ZERO,
            axes: self.start,
        };
        let from = match next {
            0 => start,
            _ => self.knots[next - 1],
        };
        (from, self.knots.get(next).copied().unwrap_or(start))
    }

    /// The speeds of the joints at a time since the beginning. A slower joint than the slowest is early at each setpoint.
    fn speeds(&self, elapsed: Duration) -> [Speed; JOINTS] {
        let (from, to) = self.segment(elapsed);
        let length = seconds(to.at) - seconds(from.at);
        std::array::from_fn(|joint| match length > 0.0 {
            true => {
                let speed = (to.axes[joint] - from.axes[joint]).abs() / length;
                Speed::for_move(speed.round() as u16).unwrap_or(Speed::SLOWEST)
            }
            false => Speed::SLOWEST,
        })
    }
}

/// Refuses a pose at a time that is not later, or to which a joint would be too fast.
fn check_speeds(pose: usize, from: &Knot, to: &Knot) -> Result<(), Refusal> {
    if to.at <= from.at {
        return Err(Refusal::Order { pose });
    }
    let length = seconds(to.at) - seconds(from.at);
    for joint in 0..JOINTS {
        let ticks_per_second = (to.axes[joint] - from.axes[joint]).abs() / length;
        if ticks_per_second.round() > Speed::MAX.ticks_per_second().into() {
            return Err(Refusal::Speed {
                pose,
                joint: joint as u8 + 1,
                ticks_per_second,
            });
        }
    }
    Ok(())
}

impl Source for Trajectory {
    type End = End;

    fn next(&mut self, now: Instant, _: Duration, _: &Seen) -> Next<End> {
        if self.is_sent {
            return match self.tolerances {
                Some(_) => Next::Rest,
                None => Next::End(End::Arrived),
            };
        }
        let elapsed = now.since(self.began);
        self.is_sent = elapsed >= self.length();
        let tracking = match &self.tolerances {
            Some(tolerances) if !self.is_sent => TrackingLimit {
                allowed: tolerances.path,
                time: Duration::ZERO,
            },
            _ => TrackingLimit::ANY,
        };
        let target = self.at(now);
        Next::Go(Target {
            joints: joints(&target),
            gripper: Some(target[JOINTS]),
            way: Way::At(self.speeds(elapsed)),
            tracking,
        })
    }

    fn on_fault(&mut self, _: Instant, fault: Fault) -> Option<End> {
        Some(End::Fault(fault))
    }
}

#[cfg(test)]
mod tests {
    use armwire::ling::{JointState, MotionStatus, Move};

    use super::*;
    use crate::motion::axes::with_gripper;
    use crate::motion::engine::{Engine, Output};
    use crate::time::rate::Rate;

    fn knot(millis: u64, joint: f64, gripper: f64) -> Knot {
        Knot {
            at: Duration::from_millis(millis),
            axes: with_gripper([joint; JOINTS], gripper),
        }
    }

    fn trajectory(knots: &[Knot], tolerances: Option<Tolerances>) -> Trajectory {
        let start = with_gripper([2_000.0; JOINTS], 0.0);
        Trajectory::new(start, knots.to_vec(), tolerances, Instant::ZERO).unwrap()
    }

    /// The first joint, its speed, and the gripper.
    fn at(trajectory: &Trajectory, millis: u64) -> (f64, u16, f64) {
        let axes = trajectory.at(Instant::from_millis(millis));
        let speeds = trajectory.speeds(Duration::from_millis(millis));
        (axes[0], speeds[0].ticks_per_second(), axes[JOINTS])
    }

    #[test]
    fn axes_move_straight_between_poses() {
        let trajectory = trajectory(&[knot(1_000, 2_100.0, 0.0), knot(3_000, 1_700.0, 500.0)], None);
        let poses = [0, 500, 1_000, 2_000].map(|millis| at(&trajectory, millis));
        assert_eq!(
            poses,
            [
                (2_000.0, 100, 0.0),
                (2_050.0, 100, 0.0),
                (2_100.0, 100, 0.0),
                (1_900.0, 200, 250.0)
            ]
        );
    }

    #[test]
    fn impossible_trajectories_are_refused() {
        let refused = |start: f64, knots: &[Knot]| {
            let start = with_gripper([start; JOINTS], 0.0);
            Trajectory::new(start, knots.to_vec(), None, Instant::ZERO)
                .unwrap_err()
                .to_string()
        };
        for (start, knots, text) in [
            (
                f64::NAN,
                vec![],
                "pose 0: joint position is NaN ticks, must be 0..=4095",
            ),
            (
                2_000.0,
                vec![knot(10, f64::INFINITY, 0.0)],
                "pose 1: joint position is inf ticks, must be 0..=4095",
            ),
            (
                2_000.0,
                vec![knot(10, 2_000.0, 1_001.0)],
                "pose 1: gripper opening is 1001 ‰, must be 0..=1000",
            ),
            (
                2_000.0,
                vec![knot(10, 2_000.0, 0.0), knot(10, 2_100.0, 0.0)],
                "the time of pose 2 is not after that of the one before",
            ),
            (
                2_000.0,
                vec![knot(10, 2_051.0, 0.0)],
                "joint 1 would go to pose 1 at 5100 ticks/s, must be at most 5000",
            ),
        ] {
            assert_eq!(refused(start, &knots), text);
        }
    }

    #[test]
    fn last_pose_is_held_after_the_end() {
        let trajectory = trajectory(&[knot(1_000, 2_100.0, 30.0)], None);
        assert_eq!(
            [1_000, 500_000].map(|millis| at(&trajectory, millis)),
            [(2_100.0, 100, 30.0); 2]
        );
    }

    #[test]
    fn first_pose_at_time_0_is_a_step() {
        let trajectory = trajectory(&[knot(0, 2_010.0, 0.0), knot(1_000, 2_110.0, 0.0)], None);
        assert_eq!([0, 500].map(|millis| at(&trajectory, millis).0), [2_010.0, 2_060.0]);
    }

    /// An arm at each goal at once, unless it is blocked.
    struct Bench {
        engine: Engine,
        trajectory: Trajectory,
        now: Instant,
        state: JointState,
        is_blocked: bool,
        moves: Vec<Move>,
    }

    impl Bench {
        fn new(path: Option<f64>) -> Self {
            let tolerances = Tolerances {
                path: [path; 7],
                goal: [Some(30.0); 7],
                goal_time: Duration::from_millis(500),
            };
            let mut bench = Self {
                engine: Engine::new(Rate::MOVES, Duration::from_millis(250), [None; 7]),
                trajectory: trajectory(&[knot(1_000, 2_100.0, 0.0)], Some(tolerances)),
                now: Instant::ZERO,
                state: JointState {
                    joints: [2_000; JOINTS],
                    gripper: 0,
                    status: MotionStatus::Locked,
                },
                is_blocked: false,
                moves: Vec::new(),
            };
            bench.engine.on_joints(bench.now, &bench.state);
            bench
        }

        /// Runs until the end, and returns its time in milliseconds.
        fn run(&mut self, until: u64, is_read: bool) -> Option<(u64, End)> {
            while self.now < Instant::from_millis(until) {
                self.now += Duration::from_millis(5);
                let mut end = None;
                match self.engine.poll(self.now, &mut self.trajectory) {
                    Output::Move(next) => {
                        self.moves.push(next);
                        if !self.is_blocked {
                            self.state.joints = next.joints.map(|(position, _)| position.ticks());
                        }
                    }
                    Output::Wait(_) => {}
                    Output::End(over) => end = Some(over),
                }
                if is_read {
                    self.engine.on_joints(self.now, &self.state);
                    let pose = self.engine.seen().unwrap().pose;
                    end = end.or(self.trajectory.on_pose(self.now, &pose));
                }
                if let Some(end) = end {
                    return Some((self.now.as_micros() / 1_000, end));
                }
            }
            None
        }
    }

    #[test]
    fn arm_arrives_with_the_last_pose() {
        let mut bench = Bench::new(Some(30.0));
        assert_eq!(bench.run(3_000, true), Some((1_005, End::Arrived)));
        assert_eq!(bench.state.joints, [2_100; JOINTS]);
        assert!(
            bench
                .moves
                .iter()
                .all(|next| next.joints[0].1.ticks_per_second() == 100)
        );
    }

    #[test]
    fn arm_that_leaves_the_path_is_held_where_it_is() {
        let mut bench = Bench::new(Some(30.0));
        bench.is_blocked = true;
        let (at, end) = bench.run(3_000, true).unwrap();
        assert!((300..330).contains(&at), "{at}");
        assert!(matches!(end, End::Fault(Fault::TrackingError(_))), "{end:?}");
        let hold = bench.engine.hold(bench.now).unwrap();
        assert_eq!(hold.joints.map(|(position, _)| position.ticks()), [2_000; JOINTS]);
    }

    #[test]
    fn arm_that_does_not_arrive_in_time_is_away() {
        let mut bench = Bench::new(None);
        bench.is_blocked = true;
        let off = Off {
            axis: 0,
            distance: 100.0,
            allowed: 30.0,
        };
        assert_eq!(bench.run(3_000, true), Some((1_500, End::Away(off))));
    }

    #[test]
    fn reading_before_the_end_is_no_arrival() {
        let mut bench = Bench::new(None);
        bench.is_blocked = true;
        bench.run(1_005, true);
        assert!(bench.trajectory.is_sent());
        let on_path = with_gripper([2_050.0; JOINTS], 0.0);
        assert_eq!(bench.trajectory.on_pose(Instant::from_millis(500), &on_path), None);
    }

    #[test]
    fn silent_arm_ends_a_trajectory() {
        let mut bench = Bench::new(None);
        bench.run(100, true);
        let (at, end) = bench.run(3_000, false).unwrap();
        assert!(matches!(end, End::Fault(Fault::Silent(_))), "{end:?}");
        assert_eq!(at, 355);
    }
}
