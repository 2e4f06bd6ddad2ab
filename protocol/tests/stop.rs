//! Stopping a Ling arm.

use armwire::ling::stop::{Grip, Output, StopError, Stopped};
use armwire::ling::{GripperSpeed, JointState, MotionStatus, Move, Opening, Position, Request, Speed, Stop, Torque};
use armwire::time::{Duration, Instant};

/// An arm with one moving joint, in virtual time.
struct Arm {
    now: Instant,
    /// The joint's position and speed, in ticks and ticks per second.
    position: f32,
    speed: f32,
    gripper: u16,
    status: MotionStatus,
    /// Number of moves that get lost.
    lost: usize,
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
            lost: 0,
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

    fn pass(&mut self, span: Duration) {
        self.position += self.speed * span.as_micros() as f32 / 1e6;
        self.now += span;
    }

    /// Runs a stop to its end. A call takes 5 ms.
    fn stop(&mut self, gripper: Option<Opening>) -> Result<Stopped, StopError> {
        let mut stop = Stop::new(gripper);
        loop {
            match stop.poll(self.now) {
                Output::Request(Request::ReadJoints) => {
                    let state = self.state();
                    self.pass(Duration::from_millis(5));
                    stop.on_joints(self.now, &state);
                }
                Output::Request(Request::Move(target)) => {
                    self.pass(Duration::from_millis(1));
                    self.moves.push(target);
                    if self.moves.len() > self.lost {
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
    assert_eq!(
        stopped,
        Ok(Stopped::AtRest {
            state,
            grip: Grip::Goal
        })
    );
    assert_eq!(arm.moves.len(), 1);
    assert!(arm.moves[0].are_joints_reached_by(&state));
    assert_eq!(arm.moves[0].gripper.0, Opening::CLOSED);
    assert_eq!(arm.torques, [Torque::On]);
    assert!(arm.now.since(began) < Duration::from_millis(200));
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
fn lost_move_is_sent_again() {
    let mut arm = Arm::moving(1_000.0);
    arm.lost = 1;
    assert!(matches!(arm.stop(None), Ok(Stopped::AtRest { .. })));
    assert_eq!(arm.moves.len(), 2);
    assert!(arm.moves[1].joints[2].0 > arm.moves[0].joints[2].0);
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
    assert_eq!(stop.poll(arm.now), Output::Request(Request::Move(pose)));
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
    assert_eq!(requests, [Request::SetTorque(Torque::On)]);
}

#[test]
fn sagging_within_tolerance_sends_nothing_again() {
    let mut arm = Arm::moving(0.0);
    arm.lost = usize::MAX;
    arm.speed = 10.0;
    arm.stop(None).unwrap();
    assert_eq!(arm.moves.len(), 1);
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
    assert!(arm.moves.len() == 1 && arm.torques.is_empty());
}

#[test]
fn arm_that_moves_on_is_an_error() {
    let mut arm = Arm::moving(100.0);
    arm.lost = usize::MAX;
    assert_eq!(arm.stop(None), Err(StopError::Moving { joint: 3 }));
    assert!(arm.torques.is_empty());
}

#[test]
fn two_ticks_in_100_ms_are_motion() {
    for (speed, rests) in [(9.0, true), (25.0, false)] {
        let mut stop = Stop::new(None);
        let mut arm = Arm::moving(speed);
        let mut is_at_rest = false;
        let end = arm.now + Duration::from_millis(150);
        while arm.now < end && !is_at_rest {
            match stop.poll(arm.now) {
                Output::Request(Request::ReadJoints) => stop.on_joints(arm.now, &arm.state()),
                Output::Wait(until) => arm.pass(until.since(arm.now)),
                Output::Request(Request::Move(_)) => {}
                _ => is_at_rest = true,
            }
        }
        assert_eq!(is_at_rest, rests, "{speed}");
    }
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
