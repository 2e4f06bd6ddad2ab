//! A trajectory of a virtual arm.

use armwire::ling::{JOINTS, JointState, MotionStatus, Request, Speed};
use armwire::time::{Duration, Instant};
use armwire_host::engine::{Engine, Fault, Next, Output, Seen, Source};
use armwire_host::trajectory::{End, Knot, Tolerances, Trajectory};
use armwire_host::{AXES, Limits, Rate, SilenceLimit, Target, TrackingLimit, Way};
use armwire_sim::faults::Rates;
use armwire_sim::ling::Config;

use crate::world::{Arm, STEP};

const PERIOD: Duration = Duration::from_millis(10);

#[test]
fn gripper_opens_in_the_time_of_its_trajectory() {
    let mut arm = Arm::new(Config::follower(), Rates::NONE, 1);
    let mut closed = [2_048.0; AXES];
    closed[JOINTS] = 0.0;
    let mut open = closed;
    open[JOINTS] = 1_000.0;
    let knot = Knot {
        at: Duration::from_millis(500),
        axes: open,
    };
    let tolerances = Tolerances {
        path: [Some(100.0); AXES],
        goal: [Some(10.0); AXES],
        goal_time: Duration::from_millis(100),
    };
    let mut trajectory = Trajectory::new(closed, vec![knot], Some(tolerances), Instant::ZERO).unwrap();
    let mut engine = Engine::new(Rate::MOVES, SilenceLimit::FAIL.at(PERIOD), [None; AXES]);
    let mut now = Instant::ZERO;
    let end = loop {
        if let Some(end) = readings_end(&mut arm, &mut engine, &trajectory, now) {
            break end;
        }
        match engine.poll(now, &mut trajectory) {
            Output::Move(target) => arm.send(now, &Request::Move(target)),
            Output::Wait(_) => {}
            Output::End(end) => break end,
        }
        if now.as_micros().is_multiple_of(PERIOD.as_micros()) {
            arm.send(now, &Request::ReadJoints);
        }
        now += STEP;
    };
    assert_eq!(end, End::Arrived);
}

/// A source of one target.
struct Only(Target);

impl Source for Only {
    type End = Fault;

    fn next(&mut self, _: Instant, _: Duration, _: &Seen) -> Next<Fault> {
        Next::Go(self.0)
    }

    fn on_fault(&mut self, _: Instant, fault: Fault) -> Option<Fault> {
        Some(fault)
    }
}

#[test]
fn target_that_no_move_can_express_is_not_sent() {
    let centre = Target {
        joints: [2_048.0; JOINTS],
        gripper: None,
        way: Way::Within(Limits::FOLLOW),
        tracking: TrackingLimit::ANY,
    };
    let end = |target| {
        let mut engine = Engine::new(Rate::MOVES, SilenceLimit::FAIL.at(PERIOD), [None; AXES]);
        engine.on_joints(
            Instant::ZERO,
            &JointState {
                joints: [2_048; JOINTS],
                gripper: 0,
                status: MotionStatus::Locked,
            },
        );
        engine.poll(Instant::ZERO, &mut Only(target))
    };
    assert!(matches!(end(centre), Output::Move(_)));
    let mut without_number = centre;
    without_number.joints[2] = f64::NAN;
    let mut without_speed = centre;
    without_speed.way = Way::At([Speed::new(1).unwrap(); JOINTS]);
    for (target, text) in [
        (
            without_number,
            "a target cannot be sent: joint position is NaN ticks, must be 0..=4095",
        ),
        (
            without_speed,
            "a target cannot be sent: joint speed (an arm may take less than 50 ticks/s for 0) is 1 ticks/s, \
             must be 50..=5000",
        ),
    ] {
        let Output::End(fault) = end(target) else {
            panic!("it is sent")
        };
        assert_eq!(fault.to_string(), text);
    }
}

/// The end of a trajectory by the readings that have arrived.
fn readings_end(arm: &mut Arm, engine: &mut Engine, trajectory: &Trajectory, now: Instant) -> Option<End> {
    let readings = arm.readings(now);
    readings.iter().find_map(|reading| {
        engine.on_joints(now, reading);
        engine.seen().and_then(|seen| trajectory.on_pose(now, &seen.pose))
    })
}
