//! Behaviour of a virtual arm, observed through its registers.

use std::f32::consts::{FRAC_PI_2, PI};

use armwire::messages::Messages;
use armwire::time::Duration;
use armwire::xarm::{Frame, Joint, Key, MAX_FRAME, ModbusFunction, Register, XArm};
use proptest::prelude::*;

use super::*;

const MODELS: [Model; 3] = [Model::XArm5, Model::XArm6, Model::XArm7];
fn arm() -> VirtualXArm {
    VirtualXArm::new(Config::new(Model::XArm6))
}

fn seconds(seconds: f64) -> Instant {
    Instant::from_micros((seconds * 1e6) as u64)
}

/// Sends a request and expects an answer of the same register.
fn call<'a>(arm: &'a mut VirtualXArm, now: Instant, request: Request<'_>) -> (State, Reply<'a>) {
    match arm.answer(now, &request) {
        Some(Response::Reply { state, reply }) => {
            assert_eq!(Some(reply.register()), request.register());
            (state, reply)
        }
        other => panic!("{other:?}"),
    }
}

/// Encodes a frame.
fn bytes_of(frame: Frame<'_>) -> Vec<u8> {
    let numbers = [frame.transaction, frame.protocol, frame.body.len() as u16].map(u16::to_be_bytes);
    [numbers.as_flattened(), frame.body].concat()
}

/// Sends a request for a register that is not in the document.
fn raw(arm: &mut VirtualXArm, now: Instant, register: u8, params: &[u8]) -> (State, Vec<u8>) {
    match call(arm, now, Request::Raw(Raw::new(register, params).unwrap())) {
        (state, Reply::Raw(raw)) => (state, raw.params().to_vec()),
        other => panic!("{other:?}"),
    }
}

fn read(arm: &mut VirtualXArm, now: Instant, register: u8) -> Vec<u8> {
    let (state, params) = raw(arm, now, register, &[]);
    assert!(!state.contains(State::INVALID), "register {register}");
    params
}

fn values(params: &[u8]) -> Vec<f32> {
    let (values, rest) = params.as_chunks();
    assert!(rest.is_empty());
    values.iter().map(|&bytes| f32::from_le_bytes(bytes)).collect()
}

/// Encodes a move of every joint to the same angle.
fn move_to(angle: f32, speed: f32, acceleration: f32) -> Vec<u8> {
    let values = [[angle; 7].as_slice(), &[speed, acceleration, 0.0]].concat();
    values.into_iter().flat_map(f32::to_le_bytes).collect()
}

/// Switches the motors on, selects position mode and sets state 0.
fn get_ready(arm: &mut VirtualXArm, now: Instant) {
    for (register, params) in [(11, &[8, 1][..]), (19, &[0]), (12, &[0])] {
        assert!(!raw(arm, now, register, params).0.contains(State::INVALID));
    }
    assert_eq!(arm.state(), State::OK);
}

fn ready() -> VirtualXArm {
    let mut arm = arm();
    get_ready(&mut arm, Instant::ZERO);
    arm
}

#[test]
fn documented_registers_answer_as_in_examples() {
    // Requests and responses as printed, with two exceptions: the state, since this arm is not ready to move, and
    // register 10, whose printed response has two bytes beyond its length.
    let vectors: [(&[u8], &[u8]); 6] = [
        (&[1], b"\x01\x106,6,XI1202,AC1302,v1.12.10\0\0\0\0\0\0\0\0\0\0\0\0\0\0"),
        (&[2], b"\x02\x10XI120204201B02\0AC130202B02L02\n\0\0\0\0\0\0\0\0\0\0"),
        (&[4], b"\x04\x10"),
        (&[5], b"\x05\x10\x00"),
        (&[6, 6], b"\x06\x10\x00\x00\x00\x00"),
        (&[10, 1], b"\x0A\x10"),
    ];
    for protocol in [2, 3] {
        for (body, expected) in vectors {
            let mut arm = arm();
            let frame = Frame {
                transaction: 1,
                protocol,
                body,
            };
            let frame = bytes_of(frame);
            let request = XArm::PRIVATE.parse_request(&frame).unwrap();
            let response = arm.answer(Instant::ZERO, &request).unwrap();
            let key = Key {
                transaction: 1,
                protocol,
                register: body[0],
            };
            let mut out = [0; MAX_FRAME];
            let n = XArm::PRIVATE.encode_response(&response, Some(key), &mut out).unwrap();
            let header = [0, 1, 0, protocol as u8, 0, expected.len() as u8];
            // Joint 6 turns about the flange: the radius is 0 up to rounding.
            if body[0] == 6 {
                let radius = f32::from_le_bytes(out[8..12].try_into().unwrap());
                assert!(radius < 1e-3, "{radius}");
                out[8..12].fill(0);
            }
            assert_eq!(out[..n], [&header[..], expected].concat());
        }
    }
}

#[test]
fn heartbeat_is_not_answered() {
    assert_eq!(arm().answer(Instant::ZERO, &Request::Heartbeat), None);
}

#[test]
fn unknown_register_is_invalid_without_effect() {
    let mut arm = ready();
    let before = arm.report(Instant::ZERO);
    let nan = move_to(f32::NAN, 1.0, 1.0);
    let negative = [&move_to(0.1, 1.0, 1.0)[..36], &(-1.0_f32).to_le_bytes()].concat();
    let (fast, slow, still) = (move_to(0.1, 3.2, 1.0), move_to(0.1, -1.0, 1.0), move_to(0.1, 1.0, 0.0));
    let wrong: [(u8, &[u8]); 27] = [
        (0, &[]),
        (8, &[]),
        (255, &[1, 2, 3]),
        (3, &[0]),
        (11, &[]),
        (11, &[0, 1]),
        (11, &[7, 1]), // it has six joints
        (11, &[9, 1]),
        (11, &[1, 2]),
        (12, &[1]),
        (12, &[]),
        (13, &[0]),
        (19, &[2]),
        (19, &[8]),
        (19, &[0, 2]),
        (42, &[0]),
        (42, &[4]),
        (70, &[2]),
        (23, &nan),
        (23, &fast),
        (23, &slow),
        (23, &still),
        (23, &[0; 39]),
        (24, &negative),
        (24, &slow),
        (25, &[0; 12]),
        (29, &move_to(0.1, 1.0, 1.0)),
    ];
    for (register, params) in wrong {
        assert_eq!(
            raw(&mut arm, Instant::ZERO, register, params),
            (State::INVALID, vec![0; PADDING]),
            "{register}"
        );
    }
    let seventh = Request::ReadRotationRadius(Joint::new(7).unwrap());
    let refused = (
        State::INVALID,
        Reply::RotationRadius(RotationRadius { millimetres: 0.0 }),
    );
    assert_eq!(call(&mut arm, Instant::ZERO, seventh), refused);
    assert_eq!(arm.report(Instant::ZERO), before);
}

#[test]
fn invalid_parameters_are_reported_besides_other_errors() {
    let mut arm = arm();
    for (body, reply) in [
        (&[6, 8][..], Reply::RotationRadius(RotationRadius { millimetres: 0.0 })),
        (&[10, 3], Reply::Empty(Register::SystemControl)),
    ] {
        let frame = Frame {
            transaction: 0x1234,
            protocol: 2,
            body,
        };
        let error = XArm::PRIVATE.parse_request(&bytes_of(frame)).unwrap_err();
        let expected = Response::Reply {
            state: State::INVALID | State::NOT_READY,
            reply,
        };
        assert_eq!(arm.refuse(Instant::ZERO, &error), Some(expected));
    }
}

#[test]
fn standard_modbus_gets_a_modbus_exception() {
    let frame = Frame {
        transaction: 7,
        protocol: 0,
        body: &[1, 3, 0, 0, 0, 2],
    };
    let error = XArm::PRIVATE.parse_request(&bytes_of(frame)).unwrap_err();
    let expected = Response::ModbusRefused {
        unit: 1,
        function: ModbusFunction::new(3).unwrap(),
    };
    assert_eq!(arm().refuse(Instant::ZERO, &error), Some(expected));
}

#[test]
fn readiness_needs_motors_mode_and_state() {
    let mut arm = arm();
    let now = Instant::ZERO;
    assert_eq!((arm.state(), read(&mut arm, now, 13)), (State::NOT_READY, vec![4]));
    // Motors are switched on one by one: the last makes the arm ready.
    raw(&mut arm, now, 12, &[0]);
    for joint in 1..=6 {
        assert_eq!(arm.state(), State::NOT_READY);
        raw(&mut arm, now, 11, &[joint, 1]);
    }
    assert_eq!((arm.state(), read(&mut arm, now, 13)), (State::OK, vec![2]));
    // Another mode stops the arm.
    assert_eq!(raw(&mut arm, now, 19, &[1, 0]).0, State::NOT_READY);
    assert_eq!(read(&mut arm, now, 13), [5]);
    assert_eq!(raw(&mut arm, now, 12, &[0]).0, State::OK);
    // A motor that is switched off does the same.
    assert_eq!(raw(&mut arm, now, 11, &[3, 0]).0, State::NOT_READY);
    assert_eq!(read(&mut arm, now, 13), [4]);
}

#[test]
fn every_mode_is_run_or_refused() {
    let home = [1.0_f32, 1.0, 0.0].map(f32::to_le_bytes).concat();
    let to = move_to(-0.5, 1.0, 1.0);
    // The angle at which each move ends.
    let moves = [(23, &to, -0.5), (24, &to, -0.5), (25, &home, 0.0), (29, &to, -0.5)];
    // The moves of each mode. Modes without a move are refused.
    let run = [(0, &[23, 24, 25][..]), (1, &[29])];
    for mode in 0..=u8::MAX {
        let runs = run
            .iter()
            .find(|(runs, _)| *runs == mode)
            .map_or(&[][..], |(_, moves)| moves);
        for (register, params, end) in moves {
            let mut arm = ready();
            // Away from zero, where a move to zero would not show.
            raw(&mut arm, Instant::ZERO, 23, &move_to(-0.25, 3.0, 20.0));
            let mut now = seconds(5.0);
            let is_refused = raw(&mut arm, now, 19, &[mode]).0.contains(State::INVALID);
            assert_eq!(is_refused, runs.is_empty(), "mode {mode}");
            if is_refused {
                continue;
            }
            assert_eq!(raw(&mut arm, now, 12, &[0]).0, State::OK, "mode {mode}");
            let state = raw(&mut arm, now, register, params).0;
            now = seconds(10.0);
            arm.advance(now);
            let expected = match runs.contains(&register) {
                true => (State::OK, end),
                false => (State::INVALID, -0.25),
            };
            assert_eq!(
                (state, arm.joints()[0] as f32),
                expected,
                "mode {mode}, register {register}"
            );
            assert_eq!(read(&mut arm, now, 13), [2]);
        }
    }
}

#[test]
fn servo_target_replaces_the_one_before() {
    let mut arm = ready();
    raw(&mut arm, Instant::ZERO, 19, &[1]);
    raw(&mut arm, Instant::ZERO, 12, &[0]);
    let to = |angle| move_to(angle, 0.0, 0.0);
    raw(&mut arm, Instant::ZERO, 29, &to(-1.0));
    arm.advance(seconds(0.1));
    assert!((arm.velocities()[0] + f64::from(body::MAX_SPEED)).abs() < 1e-6);
    // At a tenth of a second the joint turns back: it is at its target as long after.
    raw(&mut arm, seconds(0.1), 29, &to(0.0));
    assert_eq!(read(&mut arm, seconds(0.1), 14), [0, 1]);
    arm.advance(seconds(0.21));
    assert_eq!((arm.joints()[0], arm.velocities()[0]), (0.0, 0.0));
    // A pause keeps the last target, and a limit is an error.
    raw(&mut arm, seconds(1.0), 12, &[3]);
    raw(&mut arm, seconds(1.0), 29, &to(-1.0));
    raw(&mut arm, seconds(1.0), 29, &to(-0.5));
    raw(&mut arm, seconds(2.0), 12, &[0]);
    arm.advance(seconds(3.0));
    assert_eq!(arm.joints()[0], -0.5);
    raw(&mut arm, seconds(3.0), 29, &to(7.0));
    assert_eq!(read(&mut arm, seconds(3.0), 15), [23, 0]);
}

#[test]
fn move_keeps_limits_and_ends_at_target() {
    let mut arm = ready();
    // 1 s of acceleration, 1 s at speed, 1 s of deceleration.
    assert_eq!(
        raw(&mut arm, Instant::ZERO, 23, &move_to(-1.0, 0.5, 0.5)),
        (State::OK, vec![])
    );
    for (time, angle, velocity) in [
        (0.0, 0.0, 0.0),
        (0.5, -0.0625, -0.25),
        (1.0, -0.25, -0.5),
        (1.5, -0.5, -0.5),
        (2.5, -0.9375, -0.25),
    ] {
        let now = seconds(time);
        assert_eq!(
            (read(&mut arm, now, 13), read(&mut arm, now, 14)),
            (vec![1], vec![0, 1]),
            "{time}"
        );
        let (_, params) = raw(&mut arm, now, 42, &[3]);
        let joint = [angle, angle, angle, angle, angle, angle, 0.0];
        let turning = [velocity, velocity, velocity, velocity, velocity, velocity, 0.0];
        assert_eq!(values(&params), [joint, turning, [0.0; 7]].concat(), "{time}");
    }
    let now = seconds(3.0);
    assert_eq!(
        (read(&mut arm, now, 13), read(&mut arm, now, 14)),
        (vec![2], vec![0, 0])
    );
    assert_eq!(values(&read(&mut arm, now, 42))[..6], [-1.0; 6]);
}

#[test]
fn joints_with_different_ways_arrive_together() {
    let mut arm = ready();
    let values = [1.0, -0.5, 0.1, 0.0, 0.0, 0.0, 0.0, 1.0, 10.0, 0.0_f32];
    let params = values.into_iter().flat_map(f32::to_le_bytes).collect::<Vec<_>>();
    raw(&mut arm, Instant::ZERO, 23, &params);
    for time in [0.05, 0.4, 0.8, 1.05] {
        arm.advance(seconds(time));
        let [a, b, c, d, ..] = arm.joints();
        assert!(a > 0.0 && a < 1.0, "{a}");
        assert!((b + a / 2.0).abs() < 1e-9 && (c - a / 10.0).abs() < 1e-8 && d == 0.0);
    }
    arm.advance(seconds(1.1));
    assert_eq!(arm.joints().map(|angle| angle as f32), values[..7]);
}

#[test]
fn moves_queue_while_there_is_room() {
    let mut arm = ready();
    let full = body::MAX_MOVES as u16;
    for i in 0..full {
        let angle = if i % 2 == 0 { 0.1 } else { 0.0 };
        assert_eq!(
            raw(&mut arm, Instant::ZERO, 23, &move_to(angle, 1.0, 20.0)).0,
            State::OK
        );
    }
    assert_eq!(
        raw(&mut arm, Instant::ZERO, 23, &move_to(0.0, 1.0, 20.0)).0,
        State::INVALID
    );
    assert_eq!(read(&mut arm, Instant::ZERO, 14), full.to_be_bytes());
    // Each takes 0.15 s; at 10 s the 67th is in progress.
    assert_eq!(read(&mut arm, seconds(10.0), 14), (full - 66).to_be_bytes());
    assert_eq!(read(&mut arm, seconds(1e3), 14), [0, 0]);
    assert_eq!(arm.joints(), [0.0; 7]);
}

#[test]
fn pause_keeps_moves_and_stop_drops_them() {
    let mut arm = ready();
    raw(&mut arm, Instant::ZERO, 23, &move_to(-1.0, 0.5, 0.5));
    raw(&mut arm, Instant::ZERO, 23, &move_to(0.0, 0.5, 0.5));
    assert_eq!(raw(&mut arm, seconds(1.5), 12, &[3]).0, State::OK);
    assert_eq!(read(&mut arm, seconds(2.0), 13), [3]);
    assert_eq!(read(&mut arm, seconds(2.0), 14), [0, 2]);
    assert_eq!((arm.joints()[0], arm.velocities()), (-0.5, [0.0; 7]));
    // During a pause, further moves join the queue.
    raw(&mut arm, seconds(2.0), 23, &move_to(0.0, 0.5, 0.5));
    raw(&mut arm, seconds(2.0), 12, &[0]);
    // From rest: 0.5 rad take 2 s.
    assert_eq!(read(&mut arm, seconds(3.9), 14), [0, 3]);
    assert_eq!(read(&mut arm, seconds(4.0), 14), [0, 2]);
    assert_eq!(arm.joints()[0], -1.0);

    assert_eq!(raw(&mut arm, seconds(4.5), 12, &[4]).0, State::NOT_READY);
    let stopped = arm.joints();
    assert!(stopped[0] > -1.0);
    assert_eq!(
        (read(&mut arm, seconds(5.0), 13), read(&mut arm, seconds(5.0), 14)),
        (vec![4], vec![0, 0])
    );
    // A move while the arm is stopped is dropped.
    assert_eq!(
        raw(&mut arm, seconds(5.0), 23, &move_to(0.0, 1.0, 1.0)).0,
        State::NOT_READY
    );
    raw(&mut arm, seconds(5.0), 12, &[0]);
    arm.advance(seconds(10.0));
    assert_eq!(arm.joints(), stopped);
}

#[test]
fn joint_beyond_limit_is_error_until_cleared() {
    for (model, angle) in [(Model::XArm5, -1.7), (Model::XArm6, 0.2), (Model::XArm7, -0.2)] {
        let mut arm = VirtualXArm::new(Config::new(model));
        get_ready(&mut arm, Instant::ZERO);
        let now = Instant::ZERO;
        let stuck = State::ERROR | State::NOT_READY;
        assert_eq!(raw(&mut arm, now, 23, &move_to(angle, 1.0, 1.0)).0, stuck);
        assert_eq!(
            (read(&mut arm, now, 15), read(&mut arm, now, 13)),
            (vec![23, 0], vec![4])
        );
        assert_eq!(raw(&mut arm, now, 12, &[0]).0, stuck);
        assert_eq!(raw(&mut arm, now, 23, &move_to(0.0, 1.0, 1.0)).0, stuck);
        assert_eq!(raw(&mut arm, now, 16, &[]).0, State::NOT_READY);
        assert_eq!(raw(&mut arm, now, 12, &[0]).0, State::OK);
        arm.advance(seconds(5.0));
        assert_eq!(arm.joints(), [0.0; 7]);
    }
}

#[test]
fn every_joint_moves_to_both_of_its_limits() {
    for model in MODELS {
        for (joint, &(min, max)) in model.limits().iter().enumerate() {
            for angle in [min, max] {
                let mut arm = VirtualXArm::new(Config::new(model));
                get_ready(&mut arm, Instant::ZERO);
                let mut values = [0.0; 10];
                values[joint] = angle;
                values[7..9].fill(3.0);
                let params = values.into_iter().flat_map(f32::to_le_bytes).collect::<Vec<_>>();
                assert_eq!(raw(&mut arm, Instant::ZERO, 23, &params).0, State::OK);
                arm.advance(seconds(10.0));
                assert_eq!(arm.joints()[joint] as f32, angle);
            }
        }
    }
}

#[test]
fn warning_is_reported_without_stopping() {
    let mut arm = ready();
    arm.set_warning(13);
    assert_eq!(
        raw(&mut arm, Instant::ZERO, 23, &move_to(0.1, 1.0, 1.0)).0,
        State::WARNING
    );
    assert_eq!(read(&mut arm, Instant::ZERO, 15), [0, 13]);
    assert_eq!(read(&mut arm, Instant::ZERO, 13), [1]);
    assert_eq!(raw(&mut arm, Instant::ZERO, 17, &[]).0, State::OK);
    assert_eq!(read(&mut arm, Instant::ZERO, 15), [0, 0]);
}

#[test]
fn torque_source_is_selectable() {
    let mut arm = arm();
    for source in [TorqueSource::Current, TorqueSource::Torque] {
        raw(&mut arm, Instant::ZERO, 70, &[source as u8]);
        let answer = call(&mut arm, Instant::ZERO, Request::ReadTorqueSource).1;
        assert_eq!(answer, Reply::TorqueSource(source));
        assert_eq!(arm.report(Instant::ZERO)[494], (source as u8) << 2);
    }
    assert_eq!(values(&read(&mut arm, Instant::ZERO, 55)), [0.0; 7]);
    assert_eq!(read(&mut arm, Instant::ZERO, 3), [0]);
}

#[test]
fn reboot_keeps_joint_angles_only() {
    for command in [Request::Reboot, Request::Shutdown] {
        let mut arm = ready();
        raw(&mut arm, Instant::ZERO, 23, &move_to(0.1, 1.0, 1.0));
        raw(&mut arm, seconds(5.0), 70, &[1]);
        raw(&mut arm, seconds(5.0), 23, &move_to(0.0, 1.0, 1.0));
        arm.set_warning(13);
        let done = (State::WARNING, Reply::Empty(Register::SystemControl));
        assert_eq!(call(&mut arm, seconds(5.0), command), done);

        let mut fresh = VirtualXArm::new(Config::new(Model::XArm6));
        assert_eq!(read(&mut arm, seconds(6.0), 13), read(&mut fresh, Instant::ZERO, 13));
        assert_eq!(read(&mut arm, seconds(6.0), 14), [0, 0]);
        let answer = call(&mut arm, seconds(6.0), Request::ReadTorqueSource);
        assert_eq!(answer, (State::NOT_READY, Reply::TorqueSource(TorqueSource::Torque)));
        assert!((arm.joints()[0] - 0.1).abs() < 1e-6);
    }
}

#[test]
fn flange_pose_is_reported() {
    let mut arm = ready();
    let values_to = [FRAC_PI_2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 3.0, 3.0, 0.0];
    let params = values_to.into_iter().flat_map(f32::to_le_bytes).collect::<Vec<_>>();
    raw(&mut arm, Instant::ZERO, 23, &params);
    let pose = values(&read(&mut arm, seconds(9.0), 41));
    let expected = [0.0, 207.0, 112.0, PI, 0.0, FRAC_PI_2];
    assert!(pose.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-3), "{pose:?}");
    // Looking down, half a turn about the axis between x and y.
    let pose = values(&read(&mut arm, seconds(9.0), 91));
    let half = PI * 0.5_f32.sqrt();
    let expected = [0.0, 207.0, 112.0, half, half, 0.0];
    assert!(pose.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-3), "{pose:?}");
}

#[test]
fn report_matches_the_registers() {
    for model in MODELS {
        let mut arm = VirtualXArm::new(Config::new(model));
        let joints = model.joints();
        get_ready(&mut arm, Instant::ZERO);
        arm.set_warning(13);
        raw(&mut arm, Instant::ZERO, 66, &[1]);
        raw(&mut arm, Instant::ZERO, 23, &move_to(0.15, 0.5, 0.5));
        raw(&mut arm, Instant::ZERO, 23, &move_to(0.0, 0.5, 0.5));
        let now = seconds(0.5);
        let report = arm.report(now);
        assert_eq!(report.len(), REPORT);
        assert_eq!(report[..4], 495_u32.to_be_bytes());
        assert_eq!(report[4], 1);
        assert_eq!(report[5..7], read(&mut arm, now, 14));
        assert_eq!(report[7..35], read(&mut arm, now, 42));
        assert_eq!(report[35..59], read(&mut arm, now, 41));
        assert_eq!(report[59..87], read(&mut arm, now, 55));
        let all = (1 << joints) - 1;
        assert_eq!(report[87..91], [all, all, 0, 13]);
        assert_eq!(values(&report[133..145]), [0.0, 0.0, -1.0]);
        assert_eq!(report[145..147], [joints as u8; 2]);
        let text = VersionText(&arm.config.version).as_str().unwrap().as_bytes().to_vec();
        assert_eq!(report[151..151 + text.len()], text);
        assert_eq!(report[151 + text.len()], 0);
        let (_, all_joints) = raw(&mut arm, now, 42, &[2]);
        assert_eq!(report[256..284], all_joints[28..]);
        assert!(values(&report[252..256])[0] > 0.0);
        assert_eq!(report[482..494], read(&mut arm, now, 91)[12..]);
        assert_eq!(report[494], 1 << 3);
    }
}

#[test]
fn versions_agree_with_the_model() {
    for model in MODELS {
        let config = Config::new(model);
        let version = VersionText(&config.version).version().unwrap();
        assert_eq!(usize::from(version.axes), model.joints());
        assert_eq!(usize::from(version.kind), model.joints());
        assert_eq!(version.firmware_numbers(), Some([1, 12, 10]));
        assert!(SerialsText(&config.serials).arm().unwrap().starts_with(version.arm));
    }
}

proptest! {
    #[test]
    fn behaviour_is_independent_of_polling(
        angles in prop::collection::vec(-0.5_f32..0.1, 1..5),
        speed in 0.1_f32..3.0,
        acceleration in 0.1_f32..20.0,
        times in prop::collection::vec(0..20_000_000_u64, 0..20),
    ) {
        let mut often = ready();
        for &angle in &angles {
            raw(&mut often, Instant::ZERO, 23, &move_to(angle, speed, acceleration));
        }
        let mut once = often.clone();
        let mut times = times;
        times.sort_unstable();
        for time in times {
            often.advance(Instant::from_micros(time));
        }
        for end in [20_000_000, 1_000_000_000] {
            prop_assert_eq!(often.report(Instant::from_micros(end)), once.report(Instant::from_micros(end)));
        }
    }

    #[test]
    fn no_request_makes_it_panic(
        requests in prop::collection::vec(
            (any::<u8>(), prop::collection::vec(any::<u8>(), 0..45), 0..1_000_000_u64),
            0..30,
        ),
    ) {
        let mut arm = ready();
        let mut now = Instant::ZERO;
        for (register, params, wait) in requests {
            now += Duration::from_micros(wait);
            let body = [&[register], &params[..]].concat();
            let frame = bytes_of(Frame { transaction: 1, protocol: 3, body: &body });
            match XArm::PRIVATE.parse_request(&frame) {
                Ok(request) => { arm.answer(now, &request); }
                Err(error) => { arm.refuse(now, &error); }
            }
            prop_assert_eq!(arm.report(now).len(), REPORT);
        }
    }
}
