//! Replay of a motion that was recorded by hand.

use std::sync::OnceLock;

use armwire::ling::{GripperSpeed, JOINTS, JointState, MotionStatus, Opening, Position, Request, Speed, Torque};
use armwire::time::{Duration, Instant};
use armwire_host::engine::Fault;
use armwire_host::replay::{Failure, Motion, Output, Point, Progress, Range, Refusal, Replay};
use armwire_host::{Limits, Off, Rate};
use armwire_sim::faults::Rates;
use armwire_sim::ling::{Config, Plant};

use crate::world::{Arm, NOISY, STEP, Stalls, by_hand, push};

const PERIOD: Duration = Duration::from_millis(10);
/// A degree, in ticks.
const DEGREE: f64 = 4_096.0 / 360.0;

/// A recording of an arm that a hand moves for 20 s. Each reading arrives up to 2 ms late.
fn recorded() -> &'static [Point] {
    static POINTS: OnceLock<Vec<Point>> = OnceLock::new();
    POINTS.get_or_init(record)
}

fn record() -> Vec<Point> {
    // The hand is exact.
    let leader = Config {
        plant: Plant::IDEAL,
        ..Config::leader()
    };
    let mut arm = Arm::new(leader, NOISY, 1);
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
    /// The stalls of the line. `None` without any.
    stalls: Option<Stalls>,
    /// The joints of the last move.
    goal: Option<[u16; JOINTS]>,
    /// The gripper's speed in it.
    gripper_speed: Option<GripperSpeed>,
}

impl Run {
    fn new(range: Range, limits: Limits, rates: Rates) -> Self {
        let motion = Motion::new(recorded(), &range, limits, Rate::MOVES).unwrap();
        Self::of(motion, Plant::IDEAL, rates)
    }

    /// A replay by an arm with this plant.
    fn of(motion: Motion, plant: Plant, rates: Rates) -> Self {
        let config = Config {
            plant,
            ..Config::follower()
        };
        Self {
            arm: Arm::new(config, rates, 2),
            replay: Replay::new(motion, false),
            now: Instant::ZERO,
            stalls: None,
            goal: None,
            gripper_speed: None,
        }
    }

    /// Runs for one step. Returns false after the end.
    fn step(&mut self) -> Result<bool, Failure> {
        let readings = self.arm.readings(self.now);
        let readings = match &mut self.stalls {
            Some(stalls) => stalls.pass(self.now, readings),
            None => readings.into_iter().map(|reading| (self.now, reading)).collect(),
        };
        for (at, reading) in readings {
            self.replay.on_reading(at, &reading);
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

    /// Runs until the end. Returns the arm's pose there.
    fn end(&mut self) -> Result<[u16; JOINTS], Failure> {
        while self.step()? {}
        Ok(self.arm.at(self.now).joints())
    }
}

/// A motion of the joints by 149°/s to +150°, in 1 s.
fn fast() -> Vec<Point> {
    let ticks = |n: u16| Position::new(2_048 + 17 * n).unwrap();
    let point = |n: u16| Point {
        at: Instant::from_millis(10 * u64::from(n)),
        joints: [ticks(n); JOINTS],
        gripper: None,
    };
    (0..=100).map(point).collect()
}

/// The motion at this rate.
fn fast_at(hertz: u16) -> Result<Motion, Refusal> {
    let rate = Rate::new(hertz).unwrap();
    Motion::new(&fast(), &Range::default(), Limits::REPLAY, rate)
}

#[test]
fn slow_steps_are_refused_with_the_rate_that_does() {
    let refused = fast_at(10).unwrap_err();
    let Refusal::Rate {
        joint: 1,
        needed: Some(rate),
        ..
    } = refused
    else {
        panic!("{refused:?}")
    };
    assert!(fast_at(rate.hertz() - 1).is_err());
    let mut run = Run::of(fast_at(rate.hertz()).unwrap(), Plant::TYPICAL, Rates::NONE);
    assert_near(run.end().unwrap(), 3_748);
    let text = "joint 1 moves by 7.5° within 50 ms at 0.00 s, and steps of 4.9° at 10 Hz are slower: 30 Hz would do";
    assert_eq!(refused.to_string(), text);
}

/// Asserts that the joints are within 0.1 rad of this position.
fn assert_near(joints: [u16; JOINTS], ticks: u16) {
    assert!(joints.iter().all(|joint| joint.abs_diff(ticks) <= 65), "{joints:?}");
}

#[test]
fn replay_ends_at_rest_at_the_last_pose() {
    for plant in [
        "ideal",
        "typical",
        "typical,lag=50ms",
        "typical,sag=60,noise=0",
        "lag=40ms,overshoot=20%",
    ] {
        let mut run = Run::of(fast_at(100).unwrap(), plant.parse().unwrap(), Rates::NONE);
        let end = run.end().unwrap_or_else(|failure| panic!("{plant}: {failure}"));
        assert_near(end, 3_748);
        let later = run.arm.at(run.now + Duration::from_millis(10_000)).joints();
        assert!(
            end.iter().zip(later).all(|(end, later)| end.abs_diff(later) <= 3),
            "{plant}: {end:?} {later:?}"
        );
    }
}

#[test]
fn arm_that_stays_away_from_the_last_pose_is_an_error() {
    // The last pose is at 149.4°.
    let mut run = Run::of(
        fast_at(100).unwrap(),
        "typical,obstacle=3:141deg".parse().unwrap(),
        Rates::NONE,
    );
    let failure = run.end().unwrap_err();
    assert!(matches!(failure, Failure::Away(Off { axis: 2, .. })), "{failure:?}");
    let text = failure.to_string();
    assert!(
        text.starts_with("joint 3 is at rest 8.") && text.contains("° away from the last pose"),
        "{text}"
    );
    assert_eq!(run.replay.poll(run.now), Err(failure));
}

#[test]
fn swinging_arm_is_no_end() {
    let mut run = Run::of(fast_at(100).unwrap(), "noise=5".parse().unwrap(), Rates::NONE);
    let failure = run.end().unwrap_err();
    assert!(matches!(failure, Failure::Moving(_)), "{failure:?}");
}

#[test]
fn speeds_without_a_time_are_refused() {
    for speed in [f64::INFINITY, f64::NAN, 0.0, -1.0, 1e9, 1e-300] {
        let range = Range {
            speed,
            ..Range::default()
        };
        let refused = Motion::new(recorded(), &range, Limits::REPLAY, Rate::MOVES).unwrap_err();
        let Refusal::Speed(got) = refused else {
            panic!("{refused:?}")
        };
        assert!(got == speed || got.is_nan() && speed.is_nan(), "{got}");
    }
}

#[test]
fn limits_without_a_motion_are_refused() {
    let stopped = Limits {
        speeds: [Speed::new(0).unwrap(); JOINTS],
        ..Limits::REPLAY
    };
    let without_step = Limits {
        step: 0,
        ..Limits::REPLAY
    };
    for (limits, text) in [
        (
            stopped,
            "joint speed (an arm may take less than 50 ticks/s for 0) is 0 ticks/s, must be 50..=5000",
        ),
        (without_step, "distance between two goals is 0 ticks, must be 1..=65535"),
    ] {
        let refused = Motion::new(recorded(), &Range::default(), limits, Rate::MOVES).unwrap_err();
        assert_eq!(refused.to_string(), text);
    }
}

#[test]
fn unsorted_poses_are_refused() {
    let mut points = fast();
    points.swap(41, 42);
    let refused = Motion::new(&points, &Range::default(), Limits::REPLAY, Rate::MOVES).unwrap_err();
    assert_eq!(refused, Refusal::Order { pose: 43, poses: 101 });
    assert_eq!(
        refused.to_string(),
        "the time of pose 43 of 101 is not after that of pose 42"
    );
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
fn arm_with_weight_replays_a_recording_late_by_its_lag() {
    let motion = Motion::new(recorded(), &Range::default(), Limits::REPLAY, Rate::MOVES).unwrap();
    let mut run = Run::of(motion, Plant::TYPICAL, NOISY);
    let (mut most, mut compared) = (0.0_f64, 0);
    while run.step().unwrap() {
        let Progress::Playing(at) = run.replay.progress(run.now) else {
            continue;
        };
        // A lag of 40 ms, and the delay of the readings.
        let late = at.as_micros().saturating_sub(40_000 - 1_000);
        // The motion begins at once, and the last readings may be lost.
        if !(200_000..19_900_000).contains(&late) {
            continue;
        }
        let path = by_hand(Duration::from_micros(late));
        for (joint, ticks) in run.arm.at(run.now).joints().into_iter().enumerate() {
            most = most.max((f64::from(ticks) - path[joint]).abs());
        }
        compared += 1;
    }
    assert!(
        most <= 2.0 * DEGREE && compared > 19_000,
        "{most} ticks, {compared} steps"
    );
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
    assert!(matches!(failure, Failure::Fault(Fault::Immovable(_))), "{failure:?}");
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
    assert!(matches!(failure, Failure::Fault(Fault::Silent(_))), "{failure:?}");
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
    assert!(
        matches!(failure, Failure::Fault(Fault::TrackingError(_))),
        "{failure:?}"
    );
    assert!(run.now < Instant::from_millis(6_000), "{:?}", run.now);
}

#[test]
fn endless_replay_goes_back_to_its_start() {
    let range = Range {
        to: Some(Duration::from_millis(1_000)),
        ..Range::default()
    };
    let motion = Motion::new(recorded(), &range, Limits::REPLAY, Rate::MOVES).unwrap();
    let mut run = Run::new(Range::default(), Limits::REPLAY, Rates::NONE);
    run.replay = Replay::new(motion, true);
    let (mut starts, mut was_playing) = (0, false);
    while starts < 3 {
        assert!(run.step().unwrap());
        let is_playing = matches!(run.replay.progress(run.now), Progress::Playing(_));
        starts += u32::from(is_playing && !was_playing);
        was_playing = is_playing;
    }
}

#[test]
fn stalled_line_causes_no_jump_and_no_motion_after_the_end() {
    let mut ended = [0, 0];
    for first in 0..6 {
        let mut run = Run::new(Range::default(), Limits::REPLAY, NOISY);
        run.stalls = Some(Stalls::from(first));
        let end = loop {
            let (before, at) = (run.goal, run.now);
            match run.step() {
                Ok(true) => {}
                Ok(false) => break true,
                Err(_) => break false,
            }
            if let (Some(goal), Some(before)) = (run.goal, before) {
                let farthest = goal
                    .into_iter()
                    .zip(before)
                    .map(|(goal, before)| goal.abs_diff(before))
                    .max();
                assert!(farthest <= Some(57), "{farthest:?} at {at:?}");
            }
        };
        ended[usize::from(end)] += 1;
        // A replay that fails is stopped by its program.
        run.now = run.arm.stop(run.now);
        let joints = run.arm.at(run.now).joints();
        let later = run.now + Duration::from_millis(10_000);
        assert_eq!(run.arm.at(later).joints(), joints);
    }
    assert!(ended[0] > 0, "{ended:?}");
}
