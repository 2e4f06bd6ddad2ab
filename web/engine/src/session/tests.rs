use armwire::ling::{Frame, GripperSpeed, JOINTS, Move, Opening, Position};
use armwire::{Device, DeviceEvent};
use armwire_sim::faults::Rates;
use armwire_sim::ling::Plant;

use super::*;
use crate::log::Event as Logged;
use crate::virtual_arm::VirtualArm;

/// The largest distance of a joint at rest from its goal, in ticks: by its load, and by friction.
const SAG: u16 = 15;

/// A session and a virtual arm, in virtual time.
struct Bench {
    session: Session,
    arm: VirtualArm,
    now: Instant,
    /// All frames to the arm.
    sent: Vec<(Instant, Vec<u8>)>,
    /// True if bytes pass between host and arm.
    connected: bool,
}

impl Bench {
    fn new() -> Self {
        let mut session = Session::new(Instant::ZERO);
        session.set_speed(Speed::new(1_000).unwrap());
        Self {
            session,
            arm: VirtualArm::new(1, Plant::DEFAULT),
            now: Instant::ZERO,
            sent: Vec::new(),
            connected: true,
        }
    }

    /// A bench with an identified arm and with motion enabled.
    fn ready() -> Self {
        let mut bench = Self::new();
        bench.session.enable_motion(Instant::ZERO, true);
        bench.run(500);
        assert_eq!(bench.session.block(bench.now), None);
        bench
    }

    /// Asserts that the arm is held at this pose.
    fn assert_holds(&self, pose: [Position; JOINTS]) {
        let joints = self.arm.arm().joints();
        let mut pairs = pose.iter().zip(joints);
        assert!(
            pairs.all(|(goal, at)| goal.ticks().abs_diff(at) <= SAG),
            "{pose:?} {joints:?}"
        );
    }

    /// Advances the time, in milliseconds: the resolution of a page's timers.
    fn run(&mut self, millis: u64) {
        for _ in 0..millis {
            self.now += Duration::from_millis(1);
            self.step();
        }
    }

    fn step(&mut self) {
        let mut buffer = [0; 256];
        let len = self.arm.transmit(self.now, &mut buffer);
        if len > 0 && self.connected {
            self.session.receive(self.now, &buffer[..len]);
        }
        loop {
            let len = self.session.transmit(self.now, &mut buffer).unwrap();
            if len == 0 {
                break;
            }
            self.sent.push((self.now, buffer[..len].to_vec()));
            if self.connected {
                self.arm.receive(self.now, &buffer[..len]);
            }
        }
    }

    fn hold(&mut self, axis: usize, direction: Direction) {
        self.session.hold(self.now, axis, direction).unwrap();
        self.step();
    }

    fn release(&mut self) {
        self.session.release(self.now);
        self.step();
    }

    /// The requests since the given time with this command and function.
    fn count(&self, since: Instant, command: u8, function: u8) -> usize {
        let frames = self.sent.iter().filter(|(at, _)| *at >= since);
        frames
            .filter(|(_, frame)| Frame::parse(frame).is_some_and(|f| (f.command, f.function) == (command, function)))
            .count()
    }

    fn moves(&self, since: Instant) -> usize {
        self.count(since, 0x06, 0x03)
    }

    /// The poses of the moves since the given time, without repetitions.
    fn poses(&self, since: Instant) -> Vec<[Position; JOINTS]> {
        let frames = self.sent.iter().filter(|(at, _)| *at >= since);
        let mut poses: Vec<_> = frames
            .filter_map(|(_, frame)| match Ling.parse_request(frame) {
                Ok(Request::Move(target)) => Some(target.joints.map(|(position, _)| position)),
                _ => None,
            })
            .collect();
        poses.dedup();
        poses
    }

    fn joint(&self, joint: usize) -> u16 {
        self.arm.arm().joints()[joint]
    }
}

#[test]
fn arm_is_identified_and_read_at_50_hz() {
    let mut bench = Bench::new();
    bench.run(99);
    assert_eq!((bench.session.state(), bench.sent.len()), (State::Listening, 0));
    bench.run(1_001);
    let arm = bench.session.arm();
    assert_eq!(arm.info.unwrap().serial.as_str(), Some("ADFS251205123456"));
    assert_eq!(arm.stroke, Some(Stroke::Mm50));
    assert_eq!(arm.check, Some(SelfCheck(0x03FF)));
    assert_eq!(arm.temperatures.unwrap().as_slice(), [25; 10]);
    assert_eq!(bench.session.state(), State::Answering);
    assert!((45..=51).contains(&bench.count(Instant::ZERO, 0x06, 0x00)));
    let counters = bench.session.counters();
    assert_eq!((counters.answers, counters.unanswered), (counters.requests, 0));
}

#[test]
fn requests_continue_on_silent_line_which_is_reported() {
    let mut bench = Bench::new();
    bench.connected = false;
    bench.run(3_000);
    assert_eq!(bench.session.state(), State::Silent);
    assert!(bench.session.counters().unanswered > 5);
    let records = std::iter::from_fn(|| bench.session.take_record());
    let silences = records.filter(|record| record.event == Logged::Unanswered);
    assert_eq!(silences.count() as u64, bench.session.counters().unanswered);
    bench.connected = true;
    bench.run(500);
    assert_eq!(bench.session.state(), State::Answering);
}

#[test]
fn nothing_is_sent_to_the_older_generation() {
    let mut session = Session::new(Instant::ZERO);
    let joints = [
        0xAA, 0x14, 0x12, 0xA9, 0x07, 0xA9, 0x07, 0xE6, 0x0C, 0x19, 0x03, 0x6D, 0x06, 0x92, 0x09, 0x2F, 0x07, 0xED,
        0x04, 0x81, 0x08, 0x00, 0xFF,
    ];
    for millis in [20, 40] {
        session.receive(Instant::from_millis(millis), &joints);
    }
    assert_eq!(session.state(), State::OlderGeneration);
    assert_eq!(session.transmit(Instant::from_millis(2_000), &mut [0; 64]), Ok(0));
    assert_eq!(session.timeout(), None);
}

#[test]
fn held_axis_moves_and_released_one_stops() {
    let mut bench = Bench::ready();
    let start = bench.now;
    bench.hold(0, Direction::Up);
    bench.run(1_000);
    assert!((2980..=3080).contains(&bench.joint(0)), "{}", bench.joint(0));
    assert!((24..=27).contains(&bench.moves(start)), "{}", bench.moves(start));
    bench.release();
    let at_release = bench.joint(0);
    bench.run(1_000);
    let overshoot = bench.joint(0).abs_diff(at_release);
    assert!(overshoot <= 30, "{overshoot} ticks at 1000 ticks/s");
    let others = &bench.arm.arm().joints()[1..];
    assert!(others.iter().all(|at| at.abs_diff(2_048) <= SAG), "{others:?}");
}

#[test]
fn stop_is_one_target_and_torque_on() {
    let mut bench = Bench::ready();
    bench.hold(2, Direction::Down);
    bench.run(205);
    let released = bench.now;
    bench.release();
    bench.run(500);
    let poses = bench.poses(released);
    assert_eq!((poses.len(), bench.count(released, 0x05, 0x00)), (1, 1));
    bench.assert_holds(poses[0]);
    assert!(bench.arm.arm().is_holding());
}

#[test]
fn stop_ends_a_motion_that_no_axis_holds() {
    let mut bench = Bench::ready();
    let target = Move {
        joints: [(Position::MAX, Speed::new(1_000).unwrap()); JOINTS],
        gripper: (Opening::OPEN, GripperSpeed(100)),
    };
    let mut frame = [0; MAX_FRAME];
    let len = Ling.encode_request(&Request::Move(target), &mut frame).unwrap();
    bench.arm.receive(bench.now, &frame[..len]);
    bench.run(500);
    assert!(bench.arm.arm().is_moving());
    let begin = bench.now;
    bench.session.stop(begin);
    assert_eq!(bench.session.stop_state(), StopState::Stopping);
    bench.run(500);
    assert!(!bench.arm.arm().is_moving() && bench.arm.arm().is_holding());
    assert_eq!(bench.session.stop_state(), StopState::GripMayLoosen);
    let poses = bench.poses(begin);
    assert_eq!((poses.len(), bench.count(begin, 0x05, 0x00)), (1, 1));
    bench.assert_holds(poses[0]);
}

#[test]
fn stop_keeps_the_last_goal_of_the_gripper() {
    let mut bench = Bench::ready();
    bench.hold(JOINTS, Direction::Up);
    bench.run(300);
    bench.release();
    bench.run(500);
    assert_eq!(bench.session.stop_state(), StopState::Stopped);
    bench.session.stop(bench.now);
    bench.run(500);
    assert_eq!(bench.session.stop_state(), StopState::Stopped);
}

#[test]
fn gripper_without_torque_forgets_its_goal() {
    let mut bench = Bench::ready();
    bench.hold(JOINTS, Direction::Up);
    bench.run(300);
    bench.release();
    for torque in [Torque::Off, Torque::On] {
        bench.session.set_torque(bench.now, torque);
        bench.run(300);
    }
    bench.session.stop(bench.now);
    bench.run(500);
    assert_eq!(bench.session.stop_state(), StopState::GripMayLoosen);
}

#[test]
fn stop_of_an_arm_without_torque_sends_nothing() {
    let mut bench = Bench::ready();
    bench.session.set_torque(bench.now, Torque::Off);
    bench.run(200);
    let begin = bench.now;
    bench.session.stop(begin);
    bench.run(500);
    assert_eq!(bench.session.stop_state(), StopState::WithoutTorque);
    assert_eq!((bench.moves(begin), bench.count(begin, 0x05, 0x00)), (0, 0));
}

#[test]
fn stop_of_a_silent_arm_fails() {
    let mut bench = Bench::ready();
    bench.connected = false;
    bench.session.stop(bench.now);
    bench.run(2_300);
    assert_eq!(bench.session.stop_state(), StopState::Failed);
}

#[test]
fn arm_stops_within_one_lookahead_of_lost_host() {
    let mut bench = Bench::ready();
    bench.hold(0, Direction::Up);
    bench.run(500);
    bench.connected = false;
    let at_end = bench.joint(0);
    bench.now += Duration::from_millis(5_000);
    bench.arm.transmit(bench.now, &mut [0; 64]);
    // The arm lags by 40 ticks.
    assert!(bench.joint(0) - at_end <= 100 + 41, "{}", bench.joint(0) - at_end);
    assert!(!bench.arm.arm().is_moving());
}

#[test]
fn nothing_moves_before_motion_is_enabled() {
    let mut bench = Bench::new();
    bench.run(500);
    bench.hold(0, Direction::Up);
    bench.run(500);
    assert_eq!(bench.session.block(bench.now), Some(Block::Disabled));
    assert_eq!(bench.moves(Instant::ZERO), 0);
}

#[test]
fn nothing_moves_while_the_torque_is_off() {
    let mut bench = Bench::ready();
    bench.session.set_torque(bench.now, Torque::Off);
    bench.run(200);
    let start = bench.now;
    bench.hold(0, Direction::Up);
    bench.run(500);
    bench.release();
    bench.run(100);
    assert_eq!(bench.session.block(bench.now), Some(Block::TorqueOff));
    assert_eq!((bench.moves(start), bench.count(start, 0x05, 0x00)), (0, 0));
}

/// Runs a session whose user holds an axis, stops and switches the torque on, with an arm that answers a request for joints
/// with this frame. Returns the reason against motion, and the different moves and torque-on that were sent.
fn used(joints: &[u8]) -> (Option<Block>, usize, usize) {
    let mut session = Session::new(Instant::ZERO);
    session.enable_motion(Instant::ZERO, true);
    let (mut moves, mut torques, mut block) = (Vec::new(), 0, None);
    for millis in 0..5_000 {
        let now = Instant::from_millis(millis);
        match millis {
            500 => session.hold(now, 0, Direction::Up).unwrap(),
            1_000 => block = session.block(now),
            1_500 => session.release(now),
            2_000 => session.stop(now),
            4_500 => session.set_torque(now, Torque::On),
            _ => {}
        }
        let mut frame = [0; MAX_FRAME];
        let len = session.transmit(now, &mut frame).unwrap();
        let Some(request) = Frame::parse(&frame[..len]) else {
            continue;
        };
        match (request.command, request.function) {
            (0x06, 0x00) => session.receive(now, joints),
            (0x06, 0x03) => moves.push(request.data.to_vec()),
            (0x05, 0x00) => torques += 1,
            _ => {}
        }
    }
    moves.dedup();
    (block, moves.len(), torques)
}

#[test]
fn another_robot_is_neither_moved_nor_held() {
    let bessica = include_bytes!("../../../../protocol/tests/bessica.bin");
    assert_eq!(used(bessica), (Some(Block::Foreign), 0, 0));
}

#[test]
fn arm_of_unknown_status_is_only_stopped() {
    let state = JointState {
        joints: [2_000; JOINTS],
        gripper: 500,
        status: MotionStatus::Other(0x42),
    };
    let mut frame = [0; MAX_FRAME];
    let len = Ling
        .encode_response(&Response::Joints(state), None, &mut frame)
        .unwrap();
    assert_eq!(used(&frame[..len]), (Some(Block::UnknownStatus), 1, 1));
}

#[test]
fn rows_of_readings_have_their_verdicts() {
    const EFFECTS: &str = include_str!("../../../../protocol/tests/effects.txt");
    let rows = EFFECTS.lines().filter(|row| !row.starts_with('#'));
    for row in rows {
        let columns: Vec<_> = row.split_whitespace().collect();
        let [effect, status, ticks, change, later_status, later_ticks, verdict] = columns[..] else {
            panic!("{row}");
        };
        let torque = match effect {
            "torque-on" => Torque::On,
            "torque-off" => Torque::Off,
            // The page sets no zero.
            _ => continue,
        };
        let state = |status: &str, ticks: &str| JointState {
            joints: [ticks.parse().unwrap(); JOINTS],
            gripper: 500,
            status: u8::from_str_radix(status, 16).unwrap().into(),
        };
        let (before, after) = (state(status, ticks), state(later_status, later_ticks));
        let change = Duration::from_millis(change.parse().unwrap());
        let (mut session, mut arm) = (Session::new(Instant::ZERO), Device::<Ling, MAX_FRAME>::new(Ling));
        let (mut requested, mut ended) = (None, None);
        for millis in 0..1_200 {
            let now = Instant::from_millis(millis);
            if millis == 500 {
                session.set_torque(now, torque);
            }
            let mut frame = [0; MAX_FRAME];
            let len = session.transmit(now, &mut frame).unwrap();
            assert!(arm.receive(&frame[..len]).is_empty());
            while let Some(event) = arm.poll() {
                match event {
                    DeviceEvent::Request {
                        request: Request::ReadJoints,
                        ..
                    } => {
                        let has_changed = requested.is_some_and(|at| now.since(at) >= change);
                        let response = Response::Joints(if has_changed { after } else { before });
                        let mut answer = [0; MAX_FRAME];
                        let len = Ling.encode_response(&response, None, &mut answer).unwrap();
                        session.receive(now, &answer[..len]);
                    }
                    DeviceEvent::Request {
                        request: Request::SetTorque(got),
                        ..
                    } => {
                        assert_eq!((got, requested), (torque, None), "{row}");
                        requested = Some(now);
                    }
                    _ => {}
                }
            }
            let is_over = !matches!(session.torque_state(), TorqueState::None | TorqueState::Switching);
            ended = ended.or(is_over.then_some(now));
        }
        let (expected, time) = match verdict {
            "confirmed" => (TorqueState::Confirmed, change),
            "not-shown" => (TorqueState::NotShown, ReadBack::LIMIT),
            _ => (TorqueState::Contradicted, ReadBack::LIMIT),
        };
        assert_eq!(session.torque_state(), expected, "{row}");
        // Other reads, which have no answers here, take their turns.
        let late = ended.unwrap().since(requested.unwrap()).as_micros() - time.as_micros();
        assert!(late < 200_000, "{row}: {late} us");
    }
}

#[test]
fn result_of_the_torque_ends_with_the_next_motion() {
    let mut bench = Bench::ready();
    bench.session.set_torque(bench.now, Torque::On);
    assert_eq!(bench.session.torque_state(), TorqueState::Switching);
    bench.run(200);
    assert_eq!(bench.session.torque_state(), TorqueState::Confirmed);
    bench.hold(0, Direction::Up);
    assert_eq!(bench.session.torque_state(), TorqueState::None);
    bench.release();
    bench.run(200);
    bench.connected = false;
    bench.session.set_torque(bench.now, Torque::Off);
    bench.run(700);
    assert_eq!(bench.session.torque_state(), TorqueState::NoReading);
    bench.session.stop(bench.now);
    assert_eq!(bench.session.torque_state(), TorqueState::None);
}

#[test]
fn nothing_moves_without_a_fresh_reading() {
    let mut bench = Bench::ready();
    bench.hold(0, Direction::Up);
    bench.run(200);
    bench.connected = false;
    bench.run(400);
    let blind = bench.now;
    bench.run(2_000);
    assert_eq!(bench.session.block(bench.now), Some(Block::NoReading));
    assert_eq!(bench.moves(blind), 0);
}

#[test]
fn disabling_motion_stops_the_arm() {
    let mut bench = Bench::ready();
    bench.hold(0, Direction::Up);
    bench.run(205);
    let disabled = bench.now;
    bench.session.enable_motion(bench.now, false);
    bench.run(500);
    let poses = bench.poses(disabled);
    assert_eq!(poses.len(), 1);
    bench.assert_holds(poses[0]);
    assert!(!bench.arm.arm().is_moving());
}

#[test]
fn stop_does_not_wait_for_lost_answer() {
    let mut bench = Bench::ready();
    bench.hold(0, Direction::Up);
    bench.run(100);
    bench.connected = false;
    while bench.session.in_flight.is_none() {
        bench.run(1);
    }
    let released = bench.now;
    bench.release();
    bench.run(11);
    assert_eq!(bench.poses(released).len(), 1);
}

#[test]
fn targets_continue_while_answers_are_missing() {
    let mut bench = Bench::ready();
    bench.hold(0, Direction::Up);
    bench.run(100);
    let start = bench.now;
    bench.connected = false;
    bench.run(200);
    assert!(bench.moves(start) >= 4, "{}", bench.moves(start));
}

#[test]
fn arm_moves_on_noisy_line_with_counted_noise() {
    let mut bench = Bench::ready();
    bench.arm.set_faults(Rates::each(1_000));
    bench.hold(0, Direction::Up);
    bench.run(1_000);
    bench.release();
    bench.run(4_000);
    let counters = bench.session.counters();
    assert!(bench.joint(0) > 2_300, "{}", bench.joint(0));
    assert!(
        counters.unanswered > 0 && counters.noise_bytes > 0 && counters.bad_checksums > 0,
        "{counters:?}"
    );
    assert!(counters.answers > 20 * counters.unanswered.min(5), "{counters:?}");
    let mut records = std::iter::from_fn(|| bench.session.take_record());
    assert!(records.any(|record| record.event == Logged::Noise));
}

#[test]
fn buffer_shorter_than_a_frame_is_an_error() {
    let mut session = Session::new(Instant::ZERO);
    let error = session.transmit(Instant::from_millis(200), &mut [0; 6]).unwrap_err();
    assert_eq!(error.to_string(), "frame is 7 bytes, must be 0..=6");
    assert_eq!(session.transmit(Instant::from_millis(200), &mut [0; 7]), Ok(7));
}

#[test]
fn timeout_is_the_time_of_the_next_transmission() {
    let bench = Bench::ready();
    let timeout = bench.session.timeout().unwrap();
    assert!(timeout > bench.now && timeout.since(bench.now) <= Duration::from_millis(60));
}
