//! Replay of a motion that was recorded by hand.

use std::sync::OnceLock;

use armwire::ling::{GripperSpeed, JOINTS, JointState, MotionStatus, Opening, Request, Torque};
use armwire::time::{Duration, Instant};
use armwire_host::Limits;
use armwire_host::engine::Fault;
use armwire_host::replay::{Motion, Output, Point, Progress, Range, Replay};
use armwire_sim::faults::Rates;
use armwire_sim::ling::Config;

use crate::world::{Arm, NOISY, STEP, by_hand, push};

const PERIOD: Duration = Duration::from_millis(10);
/// A degree, in ticks.
const DEGREE: f64 = 4_096.0 / 360.0;

/// A recording of an arm that a hand moves for 20 s. Each reading arrives up to 2 ms late.
fn recorded() -> &'static [Point] {
    static POINTS: OnceLock<Vec<Point>> = OnceLock::new();
    POINTS.get_or_init(record)
}

fn record() -> Vec<Point> {
    let mut arm = Arm::new(Config::leader(), NOISY, 1);
    let mut points = Vec::new();
    let mut now = Instant::ZERO;
    while now <= Instant::from_millis(20_000) {
        push(arm.at(now), by_hand(now.since(Instant::ZERO)));
        if now.as_micros().is_multiple_of(PERIOD.as_micros()) {
            arm.send(now, &Request::ReadJoints);
        }
        now += STEP;
        for reading in arm.readings(now) {
            let late = Duration::from_micros(now.as_micros() * 7_919 % 2_000);
            points.push(Point {
                at: now + late,
                joints: reading.positions().unwrap(),
                gripper: Some(Opening::new(reading.gripper).unwrap()),
            });
        }
    }
    assert!((1_900..1_990).contains(&points.len()), "{}", points.len());
    points
}

/// An arm that replays a motion.
struct Run {
    arm: Arm,
    replay: Replay,
    now: Instant,
    /// The joints of the last move.
    goal: Option<[u16; JOINTS]>,
    /// The gripper's speed in it.
    gripper_speed: Option<GripperSpeed>,
}

impl Run {
    fn new(range: Range, limits: Limits, rates: Rates) -> Self {
        let motion = Motion::new(recorded(), &range, limits).unwrap();
        Self {
            arm: Arm::new(Config::follower(), rates, 2),
            replay: Replay::new(motion, PERIOD, false),
            now: Instant::ZERO,
            goal: None,
            gripper_speed: None,
        }
    }

    /// Runs for one step. Returns false after the end.
    fn step(&mut self) -> Result<bool, Fault> {
        for reading in self.arm.readings(self.now) {
            self.replay.on_reading(self.now, &reading);
        }
        match self.replay.poll(self.now)? {
            Output::Move(target) => {
                self.arm.send(self.now, &Request::Move(target));
                self.gripper_speed = Some(target.gripper.1);
                self.goal = Some(target.joints.map(|(position, _)| position.ticks()));
            }
            Output::Wait(_) => {}
            Output::Done => return Ok(false),
        }
        if self.now.as_micros().is_multiple_of(PERIOD.as_micros()) {
            self.arm.send(self.now, &Request::ReadJoints);
        }
        self.now += STEP;
        Ok(true)
    }
}

#[test]
fn replay_reproduces_a_recording_within_one_degree() {
    for speed in [1.0, 0.5] {
        let range = Range {
            speed,
            ..Range::default()
        };
        let mut run = Run::new(range, Limits::REPLAY, NOISY);
        let mut compared = 0;
        while run.step().unwrap() {
            let Progress::Playing(at) = run.replay.progress(run.now) else {
                continue;
            };
            // The first reading arrived within 3 ms.
            let at = Duration::from_micros((at.as_micros() as f64 * speed) as u64 + 1_000);
            // The last readings may be lost.
            if at > Duration::from_millis(19_900) {
                continue;
            }
            let path = by_hand(at);
            for (joint, ticks) in run.arm.at(run.now).joints().into_iter().enumerate() {
                let off = (f64::from(ticks) - path[joint]).abs();
                assert!(off <= DEGREE, "joint {joint} is {off} ticks off at {at:?}");
            }
            compared += 1;
        }
        assert!(f64::from(compared) >= 19_800.0 / speed, "{compared}");
        let tracking = run.replay.tracking();
        assert!(tracking.readings() > 1_900, "{}", tracking.readings());
        assert!(
            tracking.max_degrees().iter().all(|degrees| *degrees < 2.0),
            "{tracking:?}"
        );
        assert!(
            tracking.rms_degrees().iter().all(|degrees| *degrees < 0.3),
            "{tracking:?}"
        );
        let end = run.arm.at(run.now).joints();
        let later = run.now + Duration::from_millis(10_000);
        assert_eq!(run.arm.at(later).joints(), end);
    }
}

#[test]
fn arm_goes_slowly_to_the_first_pose() {
    let range = Range {
        from: Duration::from_millis(2_000),
        ..Range::default()
    };
    let mut run = Run::new(range, Limits::REPLAY, Rates::NONE);
    let mut before = run.arm.body().joints();
    while !matches!(run.replay.progress(run.now), Progress::Playing(_)) {
        assert!(run.step().unwrap());
        let joints = run.arm.at(run.now).joints();
        // 20°/s are a quarter of a tick in a step, and joints are whole ticks.
        let step = joints.iter().zip(before).map(|(now, before)| now.abs_diff(before));
        assert!(step.max() <= Some(1), "{joints:?} after {before:?}");
        before = joints;
    }
    assert!(run.now > Instant::from_millis(1_500), "{:?}", run.now);
}

#[test]
fn gripper_has_the_speed_of_a_stop() {
    let mut run = Run::new(Range::default(), Limits::REPLAY, Rates::NONE);
    while run.step().unwrap() {
        assert!(run.gripper_speed.is_none_or(|speed| speed == GripperSpeed::DEFAULT));
    }
    assert!(run.gripper_speed.is_some());
}

#[test]
fn killed_replay_leaves_the_arm_at_its_last_goal() {
    for millis in (300..12_000).step_by(777) {
        let mut run = Run::new(Range::default(), Limits::REPLAY, Rates::NONE);
        while run.now < Instant::from_millis(millis) {
            assert!(run.step().unwrap());
        }
        let later = run.now + Duration::from_millis(10_000);
        let arm = run.arm.at(later);
        assert_eq!((Some(arm.joints()), arm.is_holding()), (run.goal, true), "{millis}");
    }
}

#[test]
fn arm_without_torque_is_sent_no_move() {
    let mut run = Run::new(Range::default(), Limits::REPLAY, Rates::NONE);
    run.arm.send(run.now, &Request::SetTorque(Torque::Off));
    run.now += STEP;
    let failure = loop {
        if let Err(failure) = run.step() {
            break failure;
        }
    };
    assert!(matches!(failure, Fault::TorqueOff(_)), "{failure:?}");
    assert_eq!(run.goal, None);
    assert_eq!(run.replay.poll(run.now), Err(failure));
}

#[test]
fn silent_arm_ends_a_replay() {
    let mut run = Run::new(Range::default(), Limits::REPLAY, Rates::NONE);
    while run.now < Instant::from_millis(2_000) {
        run.step().unwrap();
    }
    let failure = loop {
        run.now += PERIOD;
        if let Err(failure) = run.replay.poll(run.now) {
            break failure;
        }
    };
    assert!(matches!(failure, Fault::Silent(_)), "{failure:?}");
    assert!(run.now < Instant::from_millis(2_300), "{:?}", run.now);
}

#[test]
fn arm_that_is_held_back_ends_a_replay() {
    let mut run = Run::new(Range::default(), Limits::REPLAY, Rates::NONE);
    while run.now < Instant::from_millis(2_000) {
        run.step().unwrap();
    }
    // Something holds the arm: its readings stay.
    let held = JointState {
        joints: run.arm.at(run.now).joints(),
        gripper: 0,
        status: MotionStatus::Locked,
    };
    let failure = loop {
        run.now += PERIOD;
        run.replay.on_reading(run.now, &held);
        if let Err(failure) = run.replay.poll(run.now) {
            break failure;
        }
    };
    assert!(matches!(failure, Fault::TrackingError(_)), "{failure:?}");
    assert!(run.now < Instant::from_millis(6_000), "{:?}", run.now);
}

#[test]
fn endless_replay_goes_back_to_its_start() {
    let range = Range {
        to: Some(Duration::from_millis(1_000)),
        ..Range::default()
    };
    let motion = Motion::new(recorded(), &range, Limits::REPLAY).unwrap();
    let mut run = Run::new(Range::default(), Limits::REPLAY, Rates::NONE);
    run.replay = Replay::new(motion, PERIOD, true);
    let (mut starts, mut was_playing) = (0, false);
    while starts < 3 {
        assert!(run.step().unwrap());
        let is_playing = matches!(run.replay.progress(run.now), Progress::Playing(_));
        starts += u32::from(is_playing && !was_playing);
        was_playing = is_playing;
    }
}
