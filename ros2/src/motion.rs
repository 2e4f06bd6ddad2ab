//! Trajectories of an arm: the one that is played, the one that waits for its time, and the end of each.
//!
//! Time and readings go in, moves and ends come out by [`Motion::poll`]. No clock and no I/O. The moves are those of the
//! library's [`Engine`].

use std::collections::VecDeque;

use armwire::ling::{Immovable, Move};
use armwire::time::{Duration, Instant};
use armwire_bridge::control::StopInForce;
use armwire_host::engine::{self, Engine, Fault};
use armwire_host::joints_file::Joint;
use armwire_host::trajectory::{Knot, Trajectory};
use armwire_host::{AXES, Rate, trajectory as host};
use ros2_client::action::GoalId;

use crate::joint_states::{Reading, Units};
use crate::messages::JointTrajectory;
use crate::tolerances::Tolerances;
use crate::trajectory::{self, Pose, Refusal};

/// Minimum time between two outputs of feedback.
const FEEDBACK_PERIOD: Duration = Duration::from_millis(50);
/// A joint or gripper that moves away from its goal by more than this, in rad or m, was moved by another host.
const JOINT_DRIFT: f64 = 0.05;
const GRIPPER_DRIFT: f64 = 0.002;

/// The sender of a trajectory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Origin {
    /// The topic, which has no replies.
    Topic,
    /// This goal of the action.
    Goal(GoalId),
}

/// A trajectory to play.
#[derive(Clone, Debug)]
pub(crate) struct Order {
    pub(crate) origin: Origin,
    pub(crate) trajectory: JointTrajectory,
    /// `None`: the trajectory ends at its last point, wherever the arm is.
    pub(crate) tolerances: Option<Tolerances>,
}

/// The end of an accepted trajectory.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum End {
    Finished,
    /// Another trajectory began.
    Replaced,
    Cancelled,
    Aborted(Abort),
}

/// The reason why an accepted trajectory was not played to its end.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub(crate) enum Abort {
    #[error("the torque was switched off during the motion")]
    TorqueLost,
    #[error("the torque came on while the port was lost: switch it by the service first")]
    TorqueSwitched,
    #[error(transparent)]
    Immovable(Immovable),
    /// Motion is refused, for a time if the adapter tells it.
    #[error("the adapter stopped the arm{}", .0.map(|stop| format!(", {stop}")).unwrap_or_default())]
    Stopped(Option<StopInForce>),
    #[error("the arm was lost: {0}")]
    ArmLost(String),
    /// The arm cannot follow. It may be there: a silence may be a hiccup of the computer.
    #[error(transparent)]
    Fault(Fault),
    #[error("the node ended")]
    NodeEnded,
    /// The trajectory waited for its time. It does not fit the arm's pose then.
    #[error("at its start: {0}")]
    Start(Refusal),
    #[error("{joint:?} is {distance:.4} from its setpoint, allowed {allowed:.4}")]
    Path { joint: String, distance: f64, allowed: f64 },
    #[error("{joint:?} is {distance:.4} from its goal after the goal time, allowed {allowed:.4}")]
    Goal { joint: String, distance: f64, allowed: f64 },
}

impl From<Immovable> for Abort {
    fn from(reason: Immovable) -> Self {
        match reason {
            Immovable::TorqueOff(_) => Self::TorqueLost,
            reason => Self::Immovable(reason),
        }
    }
}

/// A trajectory's progress, by a reading.
#[derive(Debug, PartialEq)]
pub(crate) struct Progress {
    pub(crate) elapsed: std::time::Duration,
    pub(crate) desired: Vec<f64>,
    pub(crate) actual: Vec<f64>,
    /// System time of the reading, in nanoseconds since 1970.
    pub(crate) at: i64,
}

/// The next action.
#[derive(Debug, PartialEq)]
pub(crate) enum Output {
    /// Send this to the arm.
    Move(Move),
    Started(Origin),
    Feedback(GoalId, Progress),
    Ended(Origin, End),
}

/// The motion of an arm.
#[derive(Debug)]
pub(crate) struct Motion {
    joints: [Joint; AXES],
    /// The number of joints that a trajectory must name: all but the gripper.
    required: usize,
    units: Units,
    reading: Reading,
    engine: Engine,
    playing: Option<Playing>,
    waiting: Option<Waiting>,
    outputs: VecDeque<Output>,
}

#[derive(Debug)]
struct Playing {
    origin: Origin,
    trajectory: Trajectory,
    began: Instant,
    reported: Option<Instant>,
}

#[derive(Debug)]
struct Waiting {
    order: Order,
    starts: Instant,
}

impl Motion {
    /// No motion of an arm with this reading at `now`, which is silent after `silence`.
    pub(crate) fn new(
        joints: [Joint; AXES],
        required: usize,
        units: Units,
        silence: Duration,
        now: Instant,
        reading: Reading,
    ) -> Self {
        let mut drift = [JOINT_DRIFT; AXES];
        drift[AXES - 1] = GRIPPER_DRIFT;
        let drift: [_; AXES] = std::array::from_fn(|axis| Some(joints[axis].scale.length(drift[axis])));
        let mut motion = Self {
            joints,
            required,
            units,
            reading: reading.clone(),
            engine: Engine::new(Rate::MOVES, silence, units.tolerance(&drift)),
            playing: None,
            waiting: None,
            outputs: VecDeque::new(),
        };
        motion.on_reading(now, &reading);
        motion
    }

    /// Checks a trajectory, received at `now`, which is `system` in nanoseconds since 1970. It replaces the present one
    /// when its time comes, and one that waits at once.
    ///
    /// # Errors
    ///
    /// The reason for a refusal, which changes nothing.
    pub(crate) fn accept(&mut self, now: Instant, system: i64, order: Order) -> Result<(), Refusal> {
        self.reading
            .state
            .status
            .check_motion()
            .map_err(|reason| match reason {
                Immovable::TorqueOff(_) => Refusal::TorqueOff,
                reason => Refusal::Immovable(reason),
            })?;
        let lead = micros(trajectory::lead(order.trajectory.header.stamp, system)?);
        let starts = now + lead;
        let trajectory = self.check(&order, starts)?;
        if let Some(waiting) = self.waiting.take() {
            self.end(waiting.order.origin, End::Replaced);
        }
        if lead == Duration::ZERO {
            self.begin(order.origin, trajectory, starts);
        } else {
            self.waiting = Some(Waiting { order, starts });
        }
        Ok(())
    }

    /// Takes a reading that was made at `at`.
    pub(crate) fn on_reading(&mut self, at: Instant, reading: &Reading) {
        self.reading = reading.clone();
        self.engine.on_joints(at, &reading.state);
        if let Err(reason) = reading.state.status.check_motion() {
            // A later torque-on must not resume it.
            self.abort(&reason.into());
            return;
        }
        self.track(at);
    }

    /// Ends the trajectory of a goal. The arm holds its last setpoint.
    pub(crate) fn cancel(&mut self, goal: GoalId) {
        let origin = Origin::Goal(goal);
        if self.playing.as_ref().is_some_and(|playing| playing.origin == origin) {
            self.end_playing(End::Cancelled);
        } else if self.waiting.take_if(|waiting| waiting.order.origin == origin).is_some() {
            self.end(origin, End::Cancelled);
        }
    }

    /// Ends all trajectories. The arm holds its last setpoint.
    pub(crate) fn cancel_all(&mut self) {
        self.end_all(&End::Cancelled);
    }

    /// Ends all trajectories of an arm that does not hold its last setpoint any more.
    pub(crate) fn abort(&mut self, why: &Abort) {
        self.engine.rest();
        self.end_all(&End::Aborted(why.clone()));
    }

    /// Returns true while setpoints are sent.
    pub(crate) fn is_sending(&self) -> bool {
        self.playing
            .as_ref()
            .is_some_and(|playing| !playing.trajectory.is_sent())
    }

    /// The next action at `now`; `None` if nothing is left.
    pub(crate) fn poll(&mut self, now: Instant) -> Option<Output> {
        if self.outputs.is_empty() {
            self.advance(now);
        }
        self.outputs.pop_front()
    }

    fn advance(&mut self, now: Instant) {
        if let Some(Waiting { order, starts }) = self.waiting.take_if(|waiting| now >= waiting.starts) {
            match self.check(&order, starts) {
                Ok(trajectory) => self.begin(order.origin, trajectory, starts),
                Err(refusal) => self.end(order.origin, End::Aborted(Abort::Start(refusal))),
            }
        }
        let Some(playing) = &mut self.playing else { return };
        match self.engine.poll(now, &mut playing.trajectory) {
            engine::Output::Move(next) => self.outputs.push_back(Output::Move(next)),
            engine::Output::Wait(_) => {}
            engine::Output::End(end) => self.end_by(now, end),
        }
    }

    /// Reports the progress of the goal that is played, and ends it at its last point.
    fn track(&mut self, now: Instant) {
        let Some(playing) = &mut self.playing else { return };
        let is_due = |reported: Instant| now.since(reported) >= FEEDBACK_PERIOD;
        if let Origin::Goal(goal) = playing.origin
            && playing.reported.is_none_or(is_due)
        {
            playing.reported = Some(now);
            let progress = Progress {
                elapsed: now.since(playing.began).into(),
                desired: self.units.positions(&playing.trajectory.at(now)),
                actual: self.reading.positions.clone(),
                at: self.reading.at,
            };
            self.outputs.push_back(Output::Feedback(goal, progress));
        }
        if let Some(end) = self
            .engine
            .seen()
            .and_then(|arm| playing.trajectory.on_pose(now, &arm.pose))
        {
            self.end_by(now, end);
        }
    }

    /// Ends the trajectory that is played. An arm that does not follow it is held where it is.
    fn end_by(&mut self, now: Instant, end: host::End) {
        let (off, is_path) = match end {
            host::End::Arrived => return self.end_playing(End::Finished),
            host::End::Fault(Fault::Immovable(reason)) => return self.abort(&reason.into()),
            host::End::Fault(Fault::TrackingError(error)) => (error, true),
            host::End::Away(deviation) => (deviation, false),
            host::End::Fault(fault) => return self.end_playing(End::Aborted(Abort::Fault(fault))),
        };
        let joint = self.joints[off.axis].name.clone();
        let [distance, allowed] = [off.distance, off.allowed].map(|units| units * self.units.of(off.axis));
        let abort = match is_path {
            true => Abort::Path {
                joint,
                distance,
                allowed,
            },
            false => Abort::Goal {
                joint,
                distance,
                allowed,
            },
        };
        self.outputs.extend(self.engine.hold(now).map(Output::Move));
        self.end_playing(End::Aborted(abort));
    }

    /// The trajectory of an order that starts at this time, from where the arm is then.
    fn check(&self, order: &Order, starts: Instant) -> Result<Trajectory, Refusal> {
        let (positions, goals) = match (&self.playing, self.engine.seen()) {
            // A motion continues from its setpoint: a reading lags behind.
            (Some(playing), _) if !playing.trajectory.is_sent() => {
                let setpoint = self.units.positions(&playing.trajectory.at(starts));
                (setpoint.clone(), setpoint)
            }
            (_, arm) => {
                let positions = self.reading.positions.clone();
                let goals = arm.map(|arm| self.units.positions(&arm.goal));
                (positions.clone(), goals.unwrap_or(positions))
            }
        };
        let pose = Pose { positions, goals };
        let path = trajectory::check(&self.joints, self.required, &order.trajectory, &pose)?;
        let units = self.units;
        let start = units.axes(&path.start);
        let knots = path.knots.iter().map(|knot| Knot {
            at: micros(knot.at),
            axes: units.axes(&knot.positions),
        });
        let tolerances = order.tolerances.as_ref().map(|tolerances| host::Tolerances {
            path: units.tolerance(&tolerances.path),
            goal: units.tolerance(&tolerances.goal),
            goal_time: micros(tolerances.goal_time),
        });
        Trajectory::new(start, knots.collect(), tolerances, starts).map_err(Refusal::Unplayable)
    }

    fn begin(&mut self, origin: Origin, trajectory: Trajectory, began: Instant) {
        self.end_playing(End::Replaced);
        self.playing = Some(Playing {
            origin,
            trajectory,
            began,
            reported: None,
        });
        self.outputs.push_back(Output::Started(origin));
    }

    fn end_playing(&mut self, end: End) {
        if let Some(playing) = self.playing.take() {
            self.engine.end_tracking();
            self.end(playing.origin, end);
        }
    }

    fn end_all(&mut self, end: &End) {
        self.end_playing(end.clone());
        if let Some(waiting) = self.waiting.take() {
            self.end(waiting.order.origin, end.clone());
        }
    }

    fn end(&mut self, origin: Origin, end: End) {
        self.outputs.push_back(Output::Ended(origin, end));
    }
}

/// A time on the clock of the state machines.
fn micros(time: std::time::Duration) -> Duration {
    Duration::from_micros(time.as_micros() as u64)
}

#[cfg(test)]
mod tests {
    use armwire::ling::{JOINTS, JointState, MotionStatus, Stroke};
    use armwire_host::joints_file::{self, Scale};
    use proptest::prelude::*;

    use super::*;
    use crate::messages::{JointTrajectoryPoint, Time};

    /// System time at the start of a test.
    const SYSTEM: i64 = 1_700_000_000_000_000_000;
    const STROKE: Stroke = Stroke::Mm50;
    /// The gripper's number.
    const GRIPPER: usize = JOINTS;

    fn joints() -> [Joint; AXES] {
        let joint = |name: &str| Joint {
            name: name.to_owned(),
            scale: Scale::ARM,
            min: -3.0,
            max: 3.0,
            max_speed: Some(2.0),
            path: None,
            goal: None,
        };
        let mut joints = ["a", "b", "c", "d", "e", "f", "gripper"].map(joint);
        joints[GRIPPER] = Joint {
            min: 0.0,
            max: 0.05,
            max_speed: None,
            ..joint("gripper")
        };
        joints
    }

    fn units() -> Units {
        Units::new(&joints(), STROKE)
    }

    /// A motion and its arm, which is at each setpoint at once unless it is blocked.
    struct Bench {
        motion: Motion,
        /// Time since the start, in ms.
        now: u64,
        arm: Vec<f64>,
        blocked: [bool; AXES],
        status: MotionStatus,
        /// The path tolerance of `a`.
        path: f64,
        /// The setpoints of `a`, with their times in ms.
        moves: Vec<(u64, f64)>,
        /// The same, with the arm's position after each.
        followed: Vec<(u64, f64, f64)>,
        /// The others, with their times in ms.
        outputs: Vec<(u64, Output)>,
    }

    fn reading(millis: u64, positions: &[f64], status: MotionStatus) -> Reading {
        let axes = units().axes(positions).map(|units| units.round() as u16);
        let state = JointState {
            joints: std::array::from_fn(|joint| axes[joint]),
            gripper: axes[GRIPPER],
            status,
        };
        Reading::new(SYSTEM + millis as i64 * 1_000_000, &state, units()).unwrap()
    }

    impl Bench {
        fn new() -> Self {
            Self::of(MotionStatus::Locked)
        }

        /// A motion whose first reading has this status.
        fn of(status: MotionStatus) -> Self {
            let arm = vec![0.0; AXES];
            let reading = reading(0, &arm, status);
            let silence = Duration::from_millis(250);
            Self {
                motion: Motion::new(joints(), 1, units(), silence, Instant::ZERO, reading),
                now: 0,
                arm,
                blocked: [false; AXES],
                status,
                path: 0.3,
                moves: Vec::new(),
                followed: Vec::new(),
                outputs: Vec::new(),
            }
        }

        fn instant(&self) -> Instant {
            Instant::from_millis(self.now)
        }

        /// Polls the motion and takes a reading each 5 ms, until a time.
        fn run(&mut self, until: u64) {
            while self.now < until {
                self.now += 5;
                self.poll();
                self.read();
                self.poll();
            }
        }

        /// Takes a reading.
        fn read(&mut self) {
            let reading = reading(self.now, &self.arm, self.status);
            self.motion.on_reading(self.instant(), &reading);
        }

        fn cancel(&mut self, origin: Origin) {
            let Origin::Goal(id) = origin else { unreachable!() };
            self.motion.cancel(id);
        }

        fn poll(&mut self) {
            while let Some(output) = self.motion.poll(self.instant()) {
                match output {
                    Output::Move(next) => {
                        let joints = next.joints.map(|(position, _)| f64::from(position.radians()));
                        let gripper = f64::from(next.gripper.0.millimetres(STROKE)) / 1_000.0;
                        self.moves.push((self.now, joints[0]));
                        for (nth, position) in joints.into_iter().chain([gripper]).enumerate() {
                            if !self.blocked[nth] {
                                self.arm[nth] = position;
                            }
                        }
                        self.followed.push((self.now, joints[0], self.arm[0]));
                    }
                    output => self.outputs.push((self.now, output)),
                }
            }
        }

        /// A trajectory to one point, 1 s after its start at `at` ms; 0 means now. A goal has tolerances.
        fn order(&mut self, origin: Origin, at: u64, names: &[&str], point: &[f64]) -> Result<(), Refusal> {
            let tolerances = Tolerances {
                path: [&[Some(self.path)][..], &[None; GRIPPER]].concat(),
                goal: [&[Some(0.05)][..], &[None; GRIPPER]].concat(),
                goal_time: std::time::Duration::from_millis(500),
            };
            let tolerances = matches!(origin, Origin::Goal(_)).then_some(tolerances);
            self.order_within(tolerances, origin, at, names, point)
        }

        fn order_within(
            &mut self,
            tolerances: Option<Tolerances>,
            origin: Origin,
            at: u64,
            names: &[&str],
            point: &[f64],
        ) -> Result<(), Refusal> {
            let mut trajectory = JointTrajectory {
                joint_names: names.iter().map(|&name| name.to_owned()).collect(),
                points: vec![JointTrajectoryPoint {
                    positions: point.to_vec(),
                    time_from_start: Time { sec: 1, nanosec: 0 },
                    ..Default::default()
                }],
                ..Default::default()
            };
            if at > 0 {
                trajectory.header.stamp = Time::from_nanos(SYSTEM + at as i64 * 1_000_000);
            }
            let order = Order {
                origin,
                trajectory,
                tolerances,
            };
            self.motion
                .accept(self.instant(), SYSTEM + self.now as i64 * 1_000_000, order)
        }

        fn to(&mut self, origin: Origin, at: u64, position: f64) {
            self.order(origin, at, &["a"], &[position]).unwrap();
        }

        fn ends(&self) -> Vec<(u64, Origin, End)> {
            let ends = self.outputs.iter().filter_map(|(at, output)| match output {
                Output::Ended(origin, end) => Some((*at, *origin, end.clone())),
                _ => None,
            });
            ends.collect()
        }

        /// The last setpoint of `a` until a time.
        fn setpoint(&self, at: u64) -> f64 {
            self.moves.iter().rfind(|(moved, _)| *moved <= at).unwrap().1
        }
    }

    fn goal() -> Origin {
        Origin::Goal(GoalId::new_random())
    }

    fn near(a: f64, b: f64) -> bool {
        (a - b).abs() < 0.02
    }

    #[test]
    fn present_motion_goes_on_until_the_stamp() {
        let (mut bench, first, second) = (Bench::new(), goal(), goal());
        bench.to(first, 0, 1.0);
        bench.run(200);
        bench.to(second, 600, -0.5);
        bench.run(3_000);
        assert!(near(bench.setpoint(590), 0.59), "{:?}", bench.moves);
        assert!(near(bench.setpoint(1_100), 0.05), "{:?}", bench.moves);
        assert_eq!(
            bench.ends(),
            [(600, first, End::Replaced), (1_605, second, End::Finished)]
        );
    }

    #[test]
    fn arm_rests_until_the_stamp() {
        let mut bench = Bench::new();
        bench.to(Origin::Topic, 500, 1.0);
        bench.run(495);
        assert_eq!(bench.moves, []);
        bench.run(2_000);
        assert_eq!(bench.moves[0], (500, 0.0));
        assert!(near(bench.setpoint(1_000), 0.5), "{:?}", bench.moves);
    }

    #[test]
    fn two_trajectories_at_once_end_once_each() {
        let (mut bench, first, second, third) = (Bench::new(), goal(), goal(), goal());
        bench.to(first, 0, 1.0);
        bench.to(second, 300, 1.0);
        bench.to(third, 0, -1.0);
        bench.run(2_000);
        let ends = [
            (5, second, End::Replaced),
            (5, first, End::Replaced),
            (1_005, third, End::Finished),
        ];
        assert_eq!(bench.ends(), ends);
    }

    #[test]
    fn cancelled_goal_sends_nothing_more() {
        let (mut bench, Origin::Goal(id)) = (Bench::new(), goal()) else {
            unreachable!()
        };
        bench.to(Origin::Goal(id), 0, 1.0);
        bench.run(300);
        let sent = bench.moves.len();
        bench.motion.cancel(id);
        bench.run(2_000);
        assert_eq!(bench.ends(), [(305, Origin::Goal(id), End::Cancelled)]);
        assert_eq!(bench.moves.len(), sent);
        assert!(!bench.motion.is_sending());
    }

    #[test]
    fn cancel_of_another_goal_changes_nothing() {
        let mut bench = Bench::new();
        bench.to(goal(), 0, 1.0);
        bench.run(300);
        bench.motion.cancel(GoalId::new_random());
        bench.run(400);
        assert!(bench.motion.is_sending() && bench.ends().is_empty());
    }

    #[test]
    fn goal_succeeds_when_the_arm_is_there() {
        let (mut bench, goal) = (Bench::new(), goal());
        bench.to(goal, 0, 0.2);
        bench.run(100);
        bench.blocked[0] = true;
        bench.run(1_200);
        assert_eq!(bench.ends(), []);
        bench.arm[0] = 0.16;
        bench.run(1_300);
        assert_eq!(bench.ends(), [(1_205, goal, End::Finished)]);
    }

    #[test]
    fn goal_that_is_not_reached_is_aborted() {
        let (mut bench, goal) = (Bench::new(), goal());
        bench.blocked[0] = true;
        bench.to(goal, 0, 0.2);
        bench.run(3_000);
        let ends = bench.ends();
        let [(1_500, origin, End::Aborted(abort @ Abort::Goal { .. }))] = &ends[..] else {
            panic!("{ends:?}");
        };
        assert_eq!(*origin, goal);
        let text = "\"a\" is 0.2000 from its goal after the goal time, allowed 0.0500";
        assert_eq!(abort.to_string(), text);
        // The joint does not press on against what blocks it.
        assert_eq!(bench.moves.last(), Some(&(1_500, 0.0)));
    }

    #[test]
    fn arm_that_leaves_its_path_is_stopped() {
        let (mut bench, goal) = (Bench::new(), goal());
        bench.order(goal, 0, &["a", "gripper"], &[1.0, 0.05]).unwrap();
        bench.run(205);
        let gripper = bench.arm[GRIPPER];
        bench.blocked = [true; AXES];
        bench.run(3_000);
        let ends = bench.ends();
        assert!(
            matches!(&ends[..], [(500..=520, _, End::Aborted(Abort::Path { joint, .. }))] if joint == "a"),
            "{ends:?}"
        );
        let hold = bench.moves.last().unwrap();
        assert_eq!((hold.1, bench.arm[GRIPPER]), (bench.arm[0], gripper));
    }

    #[test]
    fn path_tolerance_ends_with_its_trajectory() {
        let (mut bench, first, second) = (Bench::new(), goal(), goal());
        bench.path = 0.02;
        bench.to(first, 0, 0.5);
        bench.run(300);
        bench.cancel(first);
        // Less than the drift.
        bench.arm[0] -= 0.04;
        bench.run(400);
        bench.path = 0.3;
        bench.to(second, 0, 0.2);
        bench.run(2_000);
        let ends = [(305, first, End::Cancelled), (1_405, second, End::Finished)];
        assert_eq!(bench.ends(), ends);
    }

    #[test]
    fn replaced_trajectory_leaves_no_tracking_error() {
        let (mut bench, first, second) = (Bench::new(), goal(), goal());
        bench.path = 0.02;
        bench.to(first, 0, 0.5);
        bench.run(300);
        bench.arm[0] -= 0.04;
        bench.read();
        bench.to(second, 0, 0.2);
        bench.run(2_000);
        let ends = [(305, first, End::Replaced), (1_305, second, End::Finished)];
        assert_eq!(bench.ends(), ends);
    }

    #[test]
    fn later_reading_hides_no_tracking_error() {
        let (mut bench, goal) = (Bench::new(), goal());
        bench.path = 0.02;
        bench.to(goal, 0, 0.5);
        bench.run(300);
        for distance in [-0.04, 0.04] {
            bench.arm[0] += distance;
            bench.read();
        }
        bench.run(305);
        let ends = bench.ends();
        assert!(
            matches!(&ends[..], [(305, _, End::Aborted(Abort::Path { .. }))]),
            "{ends:?}"
        );
    }

    #[test]
    fn torque_off_aborts_all_trajectories() {
        let (mut bench, first, second) = (Bench::new(), goal(), goal());
        bench.to(first, 0, 1.0);
        bench.to(second, 700, 0.5);
        bench.run(200);
        bench.status = MotionStatus::Idle;
        bench.run(205);
        bench.status = MotionStatus::Locked;
        bench.run(3_000);
        let lost = End::Aborted(Abort::TorqueLost);
        assert_eq!(bench.ends(), [(205, first, lost.clone()), (205, second, lost)]);
        assert!(bench.moves.iter().all(|(at, _)| *at <= 205), "{:?}", bench.moves);
    }

    #[test]
    fn trajectory_without_torque_is_refused() {
        let mut bench = Bench::new();
        bench.status = MotionStatus::Idle;
        bench.run(5);
        assert_eq!(bench.order(Origin::Topic, 0, &["a"], &[1.0]), Err(Refusal::TorqueOff));
    }

    #[test]
    fn unknown_status_aborts_and_refuses_trajectories() {
        let (mut bench, goal) = (Bench::new(), goal());
        bench.to(goal, 0, 1.0);
        bench.run(200);
        bench.status = MotionStatus::Other(0x42);
        bench.run(1_000);
        let unknown = Immovable::UnknownStatus(0x42);
        assert_eq!(bench.ends(), [(205, goal, End::Aborted(Abort::Immovable(unknown)))]);
        assert!(bench.moves.iter().all(|(at, _)| *at <= 205), "{:?}", bench.moves);
        let refused = bench.order(Origin::Topic, 0, &["a"], &[1.0]).unwrap_err();
        assert_eq!(refused.to_string(), "no document explains the arm's status 0x42");
    }

    #[test]
    fn arm_that_had_no_torque_at_first_moves() {
        let (mut bench, goal) = (Bench::of(MotionStatus::Idle), goal());
        assert_eq!(bench.order(goal, 0, &["a"], &[0.5]), Err(Refusal::TorqueOff));
        bench.status = MotionStatus::Locked;
        bench.run(5);
        bench.to(goal, 0, 0.5);
        bench.run(2_000);
        assert_eq!(bench.ends(), [(1_010, goal, End::Finished)]);
    }

    #[test]
    fn end_without_tolerances_is_that_of_the_library() {
        for origin in [Origin::Topic, goal()] {
            let mut bench = Bench::new();
            bench.blocked = [true; AXES];
            bench.order_within(None, origin, 0, &["a"], &[0.5]).unwrap();
            bench.run(3_000);
            assert!(matches!(bench.moves.last(), Some((1_005, setpoint)) if near(*setpoint, 0.5)));
            assert_eq!(bench.ends(), [(1_015, origin, End::Finished)]);
        }
    }

    #[test]
    fn refused_trajectory_leaves_the_motion() {
        let (mut bench, goal) = (Bench::new(), goal());
        bench.to(goal, 0, 1.0);
        bench.run(300);
        assert!(bench.order(Origin::Topic, 0, &["a"], &[-2.9]).is_err());
        bench.run(2_000);
        assert_eq!(bench.ends(), [(1_005, goal, End::Finished)]);
    }

    #[test]
    fn waiting_trajectory_must_fit_at_its_start() {
        let (mut bench, first, second) = (Bench::new(), goal(), goal());
        bench.to(first, 0, 1.0);
        // From 1.0 its speed is allowed, from 0.2 not.
        bench.to(second, 1_500, 2.9);
        bench.run(200);
        let Origin::Goal(id) = first else { unreachable!() };
        bench.motion.cancel(id);
        bench.run(3_000);
        let ends = bench.ends();
        assert!(
            matches!(
                &ends[..],
                [(205, _, End::Cancelled), (1_500, _, End::Aborted(Abort::Start(_)))]
            ),
            "{ends:?}"
        );
        assert!(bench.moves.iter().all(|(at, _)| *at <= 200), "{:?}", bench.moves);
    }

    #[test]
    fn omitted_gripper_keeps_its_grip() {
        let mut bench = Bench::new();
        // Closed around an object at 0.03.
        bench.arm[GRIPPER] = 0.03;
        bench.blocked[GRIPPER] = true;
        bench.order(Origin::Topic, 0, &["gripper"], &[0.0]).unwrap();
        bench.run(1_500);
        bench.blocked[GRIPPER] = false;
        bench.to(Origin::Topic, 0, 0.5);
        bench.run(1_600);
        assert_eq!(bench.arm[GRIPPER], 0.0);
    }

    #[test]
    fn gripper_moved_by_another_host_stays() {
        let mut bench = Bench::new();
        bench.order(Origin::Topic, 0, &["gripper"], &[0.0]).unwrap();
        bench.run(1_500);
        bench.arm[GRIPPER] = 0.04;
        bench.run(1_600);
        bench.to(Origin::Topic, 0, 0.5);
        bench.run(1_700);
        assert!((bench.arm[GRIPPER] - 0.04).abs() < 1e-9, "{:?}", bench.arm);
    }

    #[test]
    fn feedback_compares_the_arm_with_its_setpoint() {
        let (mut bench, goal) = (Bench::new(), goal());
        bench.to(goal, 0, 1.0);
        bench.run(1_100);
        let feedback: Vec<_> = bench
            .outputs
            .iter()
            .filter_map(|(at, output)| match output {
                Output::Feedback(_, progress) => Some((*at, progress)),
                _ => None,
            })
            .collect();
        assert!((20..=22).contains(&feedback.len()), "{feedback:?}");
        for (at, progress) in feedback {
            assert!(
                progress.elapsed <= std::time::Duration::from_millis(at),
                "{at}: {progress:?}"
            );
            assert!(near(progress.desired[0], progress.actual[0]), "{at}: {progress:?}");
        }
    }

    #[test]
    fn silent_arm_aborts_the_trajectory_it_plays() {
        let (mut bench, goal) = (Bench::new(), goal());
        bench.to(goal, 0, 1.0);
        bench.run(200);
        while bench.now < 600 {
            bench.now += 5;
            bench.poll();
        }
        let silent = Abort::Fault(Fault::Silent(Duration::from_millis(255)));
        assert_eq!(silent.to_string(), "no reading of the joints for 0.26 s");
        assert_eq!(bench.ends(), [(455, goal, End::Aborted(silent))]);
        assert!(bench.moves.iter().all(|(at, _)| *at < 455), "{:?}", bench.moves);
    }

    /// An event of a motion.
    #[derive(Clone, Debug)]
    enum Event {
        /// A trajectory, of the topic or a goal, starts after this time in ms.
        Order {
            is_goal: bool,
            after: u64,
            position: f64,
        },
        /// The goal with this number, modulo their count, is cancelled.
        Cancel(usize),
        Hold,
        Block(bool),
        Torque(bool),
    }

    fn events() -> impl Strategy<Value = Vec<(u64, Event)>> {
        let order =
            (any::<bool>(), prop_oneof![Just(0), 1..2_000_u64], -3.1..3.1).prop_map(|(is_goal, after, position)| {
                Event::Order {
                    is_goal,
                    after,
                    position,
                }
            });
        let event = prop_oneof![
            6 => order,
            2 => any::<usize>().prop_map(Event::Cancel),
            1 => Just(Event::Hold),
            1 => any::<bool>().prop_map(Event::Block),
            1 => any::<bool>().prop_map(Event::Torque),
        ];
        prop::collection::vec((0..400_u64, event), 0..20)
    }

    #[test]
    fn each_accepted_trajectory_ends_once_without_jumps() {
        proptest!(|(events in events())| {
            let mut bench = Bench::new();
            let mut accepted = Vec::new();
            for (wait, event) in events {
                bench.run(bench.now + wait);
                match event {
                    Event::Order { is_goal, after, position } => {
                        let origin = if is_goal { goal() } else { Origin::Topic };
                        let at = if after == 0 { 0 } else { bench.now + after };
                        if bench.order(origin, at, &["a"], &[position]).is_ok() {
                            accepted.push(origin);
                        }
                    }
                    Event::Cancel(nth) if !accepted.is_empty() => {
                        if let Origin::Goal(id) = accepted[nth % accepted.len()] {
                            bench.motion.cancel(id);
                        }
                    }
                    Event::Cancel(_) => {}
                    Event::Hold => bench.motion.cancel_all(),
                    Event::Block(is_blocked) => bench.blocked[0] = is_blocked,
                    Event::Torque(true) => bench.status = MotionStatus::Locked,
                    Event::Torque(false) => bench.status = MotionStatus::Idle,
                }
            }
            bench.run(bench.now + 5_000);
            let mut ended: Vec<_> = bench.ends().into_iter().map(|(_, origin, _)| origin).collect();
            for origin in accepted {
                let nth = ended.iter().position(|ended| *ended == origin);
                prop_assert!(nth.is_some(), "{origin:?} did not end");
                ended.swap_remove(nth.unwrap());
            }
            prop_assert_eq!(ended, []);
            prop_assert!(!bench.motion.is_sending());
            // A setpoint is at most as far from the one before, or from the arm, as the speed allows.
            for pair in bench.followed.windows(2) {
                let ((before, _, from), (at, to, _)) = (pair[0], pair[1]);
                let allowed = 2.0 * (at - before) as f64 / 1_000.0 + 0.011;
                let setpoint = pair[0].1;
                prop_assert!((to - setpoint).abs() <= allowed || (to - from).abs() <= allowed, "{:?}", pair);
            }
        });
    }
    #[test]
    fn trajectory_in_the_units_of_the_file_moves_the_arm() {
        let text = "[arm.joints]\njoint1 = { name = \"base\", factor = -57.29577951308232, offset = 90, min = 0 }\n\
                    gripper = { name = \"finger\", factor = 0.5, offset = -0.025 }";
        let joints = joints_file::parse(text).unwrap()["arm"].clone().with_stroke(STROKE).all;
        let units = Units::new(&joints, STROKE);
        let state = JointState {
            joints: [2_048; JOINTS],
            gripper: 1_000,
            status: MotionStatus::Locked,
        };
        let reading = Reading::new(SYSTEM, &state, units).unwrap();
        let names: Vec<_> = joints.iter().map(|joint| joint.name.clone()).collect();
        let silence = Duration::from_millis(60_000);
        let mut motion = Motion::new(joints, JOINTS, units, silence, Instant::ZERO, reading);
        let mut order = |base: f64, finger: f64| {
            let order = Order {
                origin: Origin::Topic,
                trajectory: JointTrajectory {
                    joint_names: names.clone(),
                    points: vec![JointTrajectoryPoint {
                        positions: vec![base, 0.0, 0.0, 0.0, 0.0, 0.0, finger],
                        time_from_start: Time { sec: 1, nanosec: 0 },
                        ..Default::default()
                    }],
                    ..Default::default()
                },
                tolerances: None,
            };
            motion.accept(Instant::ZERO, SYSTEM, order)?;
            let mut last = None;
            for millis in (0..=1_500).step_by(5) {
                while let Some(output) = motion.poll(Instant::from_millis(millis)) {
                    if let Output::Move(next) = output {
                        last = Some((next.joints[0].0.ticks(), next.gripper.0.per_mille()));
                    }
                }
            }
            Ok::<_, Refusal>(last)
        };
        let refused = |result: Result<_, Refusal>| result.unwrap_err().to_string();
        assert_eq!(
            refused(order(-1.0, 0.0)),
            "point 0: \"base\" at -1 is out of range 0.0000 to 270.0000"
        );
        assert_eq!(
            refused(order(90.0, 0.001)),
            "point 0: \"finger\" at 0.001 is out of range -0.0250 to 0.0000"
        );
        // 45° less are an eighth of a turn up, and -0.005 m of the finger 40 mm of opening.
        assert_eq!(order(45.0, -0.005), Ok(Some((2_048 + 512, 800))));
    }
}
