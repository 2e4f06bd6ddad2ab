//! Stopping a Ling arm.

use armwire::ling::arrival::Deviations;
use armwire::ling::stop::{Grip, Output, StopError, Stopped};
use armwire::ling::{
    GripperSpeed, JointState, Ling, MotionStatus, Move, Opening, Position, Request, Response, Rest, Speed, Stop, Torque,
};
use armwire::messages::Messages;
use armwire::time::{Duration, Instant};

/// An arm with one moving joint, in virtual time.
struct Arm {
    now: Instant,
    /// The joint's position and speed, in ticks and ticks per second.
    position: f32,
    speed: f32,
    gripper: u16,
    status: MotionStatus,
    /// Its answer instead of this state.
    answer: Option<JointState>,
    /// Number of moves that get lost.
    lost: usize,
    /// It does what another program wants.
    is_driven: bool,
    moves: Vec<Move>,
    torques: Vec<Torque>,
}

impl Arm {
    fn moving(speed: f32) -> Self {
        Self {
            now: Instant::from_millis(5_000),
            position: 1_000.0,
            speed,
            gripper: 300,
            status: MotionStatus::Locked,
            answer: None,
            lost: 0,
            is_driven: false,
            moves: Vec::new(),
            torques: Vec::new(),
        }
    }

    fn state(&self) -> JointState {
        let mut joints = [2048; 6];
        joints[2] = self.position as u16;
        JointState {
            joints,
            gripper: self.gripper,
            status: self.status,
        }
    }

    /// The number of different poses in the moves.
    fn setpoints(&self) -> usize {
        let mut poses: Vec<_> = self
            .moves
            .iter()
            .map(|target| target.joints.map(|(at, _)| at))
            .collect();
        poses.dedup();
        poses.len()
    }

    fn pass(&mut self, span: Duration) {
        self.position += self.speed * span.as_micros() as f32 / 1e6;
        self.now += span;
    }

    /// Runs a stop to its end.
    fn stop(&mut self, gripper: Option<Opening>) -> Result<Stopped, StopError> {
        self.run(Stop::new(gripper))
    }

    /// Runs a stop to its end. A call takes 5 ms.
    fn run(&mut self, mut stop: Stop) -> Result<Stopped, StopError> {
        loop {
            match stop.poll(self.now) {
                Output::Request(Request::ReadJoints) => {
                    let state = self.answer.unwrap_or(self.state());
                    self.pass(Duration::from_millis(5));
                    stop.on_joints(self.now, &state);
                }
                Output::Request(Request::Move(target)) => {
                    self.pass(Duration::from_millis(1));
                    self.moves.push(target);
                    if self.moves.len() > self.lost && !self.is_driven {
                        self.speed = 0.0;
                        self.position = f32::from(target.joints[2].0.ticks());
                    }
                }
                Output::Request(Request::SetTorque(torque)) => self.torques.push(torque),
                Output::Request(other) => panic!("{other:?}"),
                Output::Wait(until) => self.pass(until.since(self.now)),
                Output::Done(result) => {
                    assert_eq!(stop.poll(self.now), Output::Done(result));
                    return result;
                }
            }
        }
    }
}

#[test]
fn moving_arm_stops_at_its_reading() {
    let mut arm = Arm::moving(1_000.0);
    let began = arm.now;
    let goal = Opening::new(0).ok();
    let stopped = arm.stop(goal);
    let state = arm.state();
    let deviations = Deviations([0; 6]);
    let grip = Grip::Goal;
    assert_eq!(
        stopped,
        Ok(Stopped::AtRest {
            state,
            deviations,
            grip
        })
    );
    assert_eq!(arm.moves[0].deviations(&state), deviations);
    assert_eq!(arm.setpoints(), 1);
    assert_eq!(arm.moves[0].gripper.0, Opening::CLOSED);
    assert_eq!(arm.torques, [Torque::On]);
    assert!(arm.now.since(began) < Duration::from_millis(300));
}

/// The vendor's two-armed robot answers the same request, with the joints of both arms.
#[test]
fn another_robot_is_sent_nothing() {
    let Ok(Response::Joints(state)) = Ling.parse_response(include_bytes!("bessica.bin"), ()) else {
        panic!("it is read");
    };
    let mut arm = Arm::moving(0.0);
    arm.answer = Some(state);
    let error = arm.stop(Some(Opening::OPEN)).unwrap_err();
    let text = "the pose cannot be held: not an Alicia-D but a Bessica-D: its answer is 33 data bytes, must be 15..=16";
    assert_eq!(error.to_string(), text);
    assert_eq!((arm.moves, arm.torques), (vec![], vec![]));
}

#[test]
fn undocumented_status_does_not_prevent_a_stop() {
    let mut arm = Arm::moving(1_000.0);
    arm.status = MotionStatus::Other(0x42);
    let stopped = arm.stop(None);
    assert!(matches!(stopped, Ok(Stopped::AtRest { .. })), "{stopped:?}");
    assert!(arm.moves[0].deviations(&arm.state()).are_small());
}

#[test]
fn unknown_gripper_goal_is_the_reading() {
    for (reading, sent) in [(300, 300), (2051, 1000)] {
        let mut arm = Arm::moving(0.0);
        arm.gripper = reading;
        let Ok(Stopped::AtRest { grip, .. }) = arm.stop(None) else {
            panic!("it did not stop");
        };
        assert_eq!((grip, arm.moves[0].gripper.0.per_mille()), (Grip::Reading, sent));
    }
}

#[test]
fn lost_setpoint_is_repeated_unchanged() {
    for lost in 0..8 {
        let mut arm = Arm::moving(200.0);
        arm.lost = lost;
        let stopped = arm.stop(None);
        assert!(matches!(stopped, Ok(Stopped::AtRest { .. })), "{lost}: {stopped:?}");
        assert_eq!(arm.setpoints(), 1);
        assert_eq!(arm.state().joints[2], arm.moves[0].joints[2].0.ticks());
    }
}

#[test]
fn way_back_is_no_faster_than_the_motion() {
    let mut arm = Arm::moving(1_000.0);
    arm.lost = 6;
    arm.stop(None).unwrap();
    let speeds = arm.moves.iter().map(|target| target.joints[2].1.ticks_per_second());
    // The sixth comes 0.5 s later, the seventh 1 s later.
    let speeds: Vec<_> = speeds.skip(5).collect();
    assert!(speeds.iter().all(|speed| (950..=1_050).contains(speed)), "{speeds:?}");
}

#[test]
fn standing_arm_is_held_at_its_known_goal() {
    for (way, is_held) in [(0, true), (40, true), (41, false)] {
        let mut arm = Arm::moving(0.0);
        let mut goal = Move {
            joints: [(Position::CENTRE, Speed::MAX); 6],
            gripper: (Opening::CLOSED, GripperSpeed(1000)),
        };
        goal.joints[2].0 = Position::new(1_000 + way).unwrap();
        // It rests where it is.
        arm.is_driven = true;
        let stopped = arm.run(Stop::after(&goal));
        let expected = if is_held { 1_000 + way } else { 1_000 };
        assert_eq!((arm.setpoints(), arm.moves[0].joints[2].0.ticks()), (1, expected));
        let Ok(Stopped::AtRest { deviations, .. }) = stopped else {
            panic!("{stopped:?}");
        };
        assert_eq!(deviations.0[2], 1_000 - i32::from(expected));
    }
}

#[test]
fn arm_that_passes_its_known_goal_is_held_at_a_reading() {
    let mut arm = Arm::moving(500.0);
    let mut goal = Move {
        joints: [(Position::CENTRE, Speed::MAX); 6],
        gripper: (Opening::CLOSED, GripperSpeed(1000)),
    };
    goal.joints[2].0 = Position::new(1_010).unwrap();
    assert!(matches!(arm.run(Stop::after(&goal)), Ok(Stopped::AtRest { .. })));
    let held = arm.moves[0].joints[2].0.ticks();
    assert!((1_051..1_070).contains(&held), "{held}");
}

#[test]
fn arm_that_falls_silent_near_its_known_goal_is_held() {
    let goal = Move {
        joints: [(Position::CENTRE, Speed::MAX); 6],
        gripper: (Opening::CLOSED, GripperSpeed(1000)),
    };
    let mut arm = Arm::moving(0.0);
    arm.position = 2_030.0;
    let mut stop = Stop::after(&goal);
    let mut readings = [arm.state()].into_iter();
    let (begun, mut held) = (arm.now, None);
    let error = loop {
        match stop.poll(arm.now) {
            Output::Request(Request::ReadJoints) => {
                if let Some(state) = readings.next() {
                    stop.on_joints(arm.now, &state);
                }
            }
            Output::Request(Request::Move(target)) => held = held.or(Some((arm.now.since(begun), target))),
            Output::Request(other) => panic!("{other:?}"),
            Output::Wait(until) => arm.pass(until.since(arm.now)),
            Output::Done(result) => break result.unwrap_err(),
        }
    };
    let (after, target) = held.expect("a hold");
    assert_eq!((after, target.joints[2].0.ticks()), (Duration::from_millis(300), 2_030));
    assert_eq!(error, StopError::Unconfirmed { readings: 1 });
}

#[test]
fn joint_that_obeyed_and_leaves_is_moved_by_another() {
    let mut arm = Arm::moving(0.0);
    let mut stop = Stop::new(None);
    let (mut moves, mut at) = (0, arm.now);
    let error = loop {
        match stop.poll(arm.now) {
            Output::Request(Request::ReadJoints) => {
                stop.on_joints(arm.now, &arm.state());
                // It has stood for 160 ms.
                if arm.now.since(at) > Duration::from_millis(160) {
                    arm.speed = 500.0;
                }
            }
            Output::Request(Request::Move(_)) => {
                moves += 1;
                at = if moves == 1 { arm.now } else { at };
            }
            Output::Request(other) => panic!("{other:?}"),
            Output::Wait(until) => arm.pass(until.since(arm.now)),
            Output::Done(result) => break result.unwrap_err(),
        }
    };
    assert_eq!(error, StopError::MovedByAnother { joint: 3 });
    // Readings do not tell a program from a hand that pushes.
    assert_eq!(
        error.to_string(),
        "joint 3 left the hold: another program or a force moves it"
    );
    assert_eq!(moves, 5, "it is not fought");
}

#[test]
fn returning_joint_does_not_leave_the_pose() {
    let mut arm = Arm::moving(0.0);
    arm.lost = usize::MAX;
    let pose = Move {
        joints: [(Position::CENTRE, Speed::MAX); 6],
        gripper: (Opening::CLOSED, GripperSpeed(1000)),
    };
    // 48 ticks to the pose, in 240 ms.
    (arm.position, arm.speed) = (2_000.0, 200.0);
    let mut stop = Stop::at(pose);
    let mut requests = Vec::new();
    while !matches!(requests.last(), Some(Request::SetTorque(_))) {
        match stop.poll(arm.now) {
            Output::Request(Request::ReadJoints) => stop.on_joints(arm.now, &arm.state()),
            Output::Request(request) => requests.push(request),
            Output::Wait(until) => arm.pass(until.since(arm.now)),
            Output::Done(result) => panic!("{result:?}"),
        }
        if arm.position >= 2048.0 {
            arm.speed = 0.0;
        }
    }
    requests.dedup();
    let expected = [Request::Move(pose), Request::SetTorque(Torque::On)];
    assert_eq!(requests, expected);
    assert_eq!(arm.state().joints[2], 2048);
}

#[test]
fn sinking_arm_gets_no_other_setpoint() {
    let mut arm = Arm::moving(0.0);
    arm.is_driven = true;
    arm.speed = 10.0;
    assert!(matches!(arm.stop(None), Ok(Stopped::AtRest { .. })));
    assert_eq!(arm.setpoints(), 1);
}

#[test]
fn nothing_is_sent_without_torque() {
    for status in [MotionStatus::Idle, MotionStatus::OverheatProtection] {
        let mut arm = Arm::moving(100.0);
        arm.status = status;
        let state = arm.state();
        assert_eq!(arm.stop(None), Ok(Stopped::WithoutTorque(state)));
        assert!(arm.moves.is_empty() && arm.torques.is_empty());
    }
}

#[test]
fn overheating_arm_is_held_without_torque_on() {
    let mut arm = Arm::moving(100.0);
    arm.status = MotionStatus::Overheating;
    assert!(matches!(arm.stop(None), Ok(Stopped::AtRest { .. })));
    assert!(arm.setpoints() == 1 && arm.torques.is_empty());
}

#[test]
fn arm_that_moves_on_is_an_error() {
    let mut arm = Arm::moving(100.0);
    arm.lost = usize::MAX;
    assert_eq!(arm.stop(None), Err(StopError::Moving { joint: 3 }));
    assert!(arm.torques.is_empty());
}

/// How long an arm has been at rest by readings of joint 3 at these times.
fn rest(readings: &[(u64, u16)]) -> Result<Duration, u8> {
    let mut rest = Rest::new();
    let readings = readings.iter().map(|(millis, ticks)| {
        let joints = [0, 0, *ticks, 0, 0, 0];
        rest.on_joints(Instant::from_millis(*millis), &joints)
    });
    readings.last().unwrap()
}

#[test]
fn rest_is_readings_within_three_ticks_without_a_gap() {
    let millis = |millis| Ok(Duration::from_millis(millis));
    assert_eq!(rest(&[(0, 500), (100, 503), (200, 500)]), millis(200));
    assert_eq!(rest(&[(0, 500), (100, 502), (200, 504)]), Err(3));
    assert_eq!(rest(&[(0, 500), (100, 504), (200, 504)]), millis(100));
    assert_eq!(rest(&[(0, 500), (150, 500), (300, 500)]), millis(300));
    // It may have left and returned.
    assert_eq!(rest(&[(0, 500), (151, 500), (200, 500)]), millis(49));
}

#[test]
fn silent_arm_is_an_error_after_the_limit() {
    let mut stop = Stop::new(None);
    let mut now = Instant::from_millis(7);
    let mut reads = 0;
    loop {
        match stop.poll(now) {
            Output::Request(request) => {
                assert_eq!(request, Request::ReadJoints);
                reads += 1;
            }
            Output::Wait(until) => now = until,
            Output::Done(result) => {
                assert_eq!(result, Err(StopError::NoReading));
                break;
            }
        }
    }
    assert_eq!((now, reads), (Instant::from_millis(7) + Stop::LIMIT, 100));
}

#[test]
fn single_reading_out_of_range_is_repeated() {
    let mut stop = Stop::new(None);
    let mut arm = Arm::moving(0.0);
    let mut wrong = arm.state();
    wrong.joints[0] = 4096;
    let mut readings = [wrong].into_iter();
    loop {
        match stop.poll(arm.now) {
            Output::Request(Request::ReadJoints) => {
                stop.on_joints(arm.now, &readings.next().unwrap_or(arm.state()));
            }
            Output::Request(_) => {}
            Output::Wait(until) => arm.pass(until.since(arm.now)),
            Output::Done(result) => {
                assert!(matches!(result, Ok(Stopped::AtRest { .. })), "{result:?}");
                break;
            }
        }
    }
}

#[test]
fn arm_that_falls_silent_is_unconfirmed() {
    let mut stop = Stop::new(None);
    let mut arm = Arm::moving(0.0);
    stop.poll(arm.now);
    stop.on_joints(arm.now, &arm.state());
    loop {
        match stop.poll(arm.now) {
            Output::Request(_) => {}
            Output::Wait(until) => arm.pass(until.since(arm.now)),
            Output::Done(result) => {
                assert_eq!(result, Err(StopError::Unconfirmed { readings: 1 }));
                break;
            }
        }
    }
}

#[test]
fn pose_beyond_a_turn_cannot_be_held() {
    let mut arm = Arm::moving(0.0);
    arm.position = 5_000.0;
    let Err(StopError::Position(error)) = arm.stop(None) else {
        panic!("it was held");
    };
    assert_eq!(error.got, 5_000);
}
