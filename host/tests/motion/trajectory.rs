//! A trajectory of a virtual arm.

use armwire::ling::{JOINTS, Request};
use armwire::time::{Duration, Instant};
use armwire_host::engine::{Engine, Output};
use armwire_host::trajectory::{End, Knot, Tolerances, Trajectory};
use armwire_host::{AXES, Rate, SilenceLimit};
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
    let mut trajectory = Trajectory::new(closed, vec![knot], Some(tolerances), Instant::ZERO);
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

/// The end of a trajectory by the readings that have arrived.
fn readings_end(arm: &mut Arm, engine: &mut Engine, trajectory: &Trajectory, now: Instant) -> Option<End> {
    let readings = arm.readings(now);
    readings.iter().find_map(|reading| {
        engine.on_joints(now, reading);
        engine.seen().and_then(|seen| trajectory.on_pose(now, &seen.pose))
    })
}
