//! Behaviour of a virtual Alpha1 and its servos, observed on the line.

use std::num::NonZeroU32;
use std::time::Duration;

use armwire::Config;
use armwire::alpha1::{
    Action, Address, Alpha1, Angle, Expect, FirmwareVersion, Interval, Led, MAX_FRAME, MoveTime, OLDEST_FIRMWARE,
    Offset, OffsetTool, Outcome, Request, Response, ServoAnswer, ServoId, ServoRequest, ServoResponse, ServoStates,
    Text, UsbType,
};
use armwire::correlation::Correlation;
use armwire::decoder::{Decoder, Kind};
use armwire::messages::Messages;
use armwire::time;
use oorandom::Rand32;
use proptest::prelude::*;

use super::port::MAX_REPLIES;
use super::*;
use crate::faults::{Line, Rates, any_rates};
use crate::serial::SerialDevice;
use crate::wire::{LineEvent, NoAnswer, Wire};

type Host<D> = Wire<Alpha1, D, MAX_FRAME>;

/// The baud rate of the servo bus, also possible for a robot.
const LINE: Config = Config {
    baud: NonZeroU32::new(115_200),
    ..Config::DEFAULT
};

fn host<D: SerialDevice>(device: D) -> Host<D> {
    Wire::new(LINE, device)
}

fn robot() -> Alpha1Robot {
    Alpha1Robot::new(RobotConfig::default())
}

fn bus() -> ServoBus {
    ServoBus::new(BusConfig::default())
}

fn id(id: u8) -> ServoId {
    ServoId::new(id).unwrap()
}

fn one(servo: u8) -> Address {
    Address::One(id(servo))
}

fn angle(degrees: u8) -> Angle {
    Angle::new(degrees).unwrap()
}

fn name(name: &str) -> Text<'_> {
    Text::new(name.as_bytes()).unwrap()
}

fn millis(millis: u64) -> time::Duration {
    time::Duration::from_millis(millis)
}

/// Moves all 20 servos to one angle.
fn act(degrees: u8, time: u64, interval: u64) -> Request<'static> {
    Request::Act(Action {
        angles: [Some(angle(degrees)); 20],
        time: MoveTime::from_duration(Duration::from_millis(time)).unwrap(),
        interval: Interval::from_duration(Duration::from_millis(interval)).unwrap(),
    })
}

fn go(to: Address, degrees: u8, time: u64, lock: u64) -> Request<'static> {
    Request::Servo(ServoRequest::Move {
        to,
        angle: angle(degrees),
        time: MoveTime::from_duration(Duration::from_millis(time)).unwrap(),
        lock: Interval::from_duration(Duration::from_millis(lock)).unwrap(),
    })
}

fn acknowledged(servo: u8) -> Result<Option<Response<'static>>, NoAnswer> {
    Ok(Some(Response::Servo(ServoResponse::Acknowledged(id(servo)))))
}

fn acted(outcome: Outcome) -> Result<Option<Response<'static>>, NoAnswer> {
    Ok(Some(Response::Acted(outcome)))
}

fn played(outcome: Outcome) -> Result<Option<Response<'static>>, NoAnswer> {
    Ok(Some(Response::Playing(outcome)))
}

fn angles(servos: &[Servo], now: time::Instant) -> Vec<f64> {
    servos.iter().map(|servo| servo.angle(now)).collect()
}

fn send(device: &mut impl SerialDevice, now: &mut time::Instant, bytes: &[u8]) {
    for &byte in bytes {
        *now += time::Duration::from_micros(87);
        device.receive(*now, byte);
    }
}

/// Returns the device's remaining output, and advances `now` to its end.
fn read_all(device: &mut impl SerialDevice, now: &mut time::Instant) -> Vec<u8> {
    let mut output = Vec::new();
    loop {
        match (device.transmit(*now), device.poll_timeout()) {
            (Some(byte), _) => output.push(byte),
            (None, Some(due)) => *now = due.max(*now),
            (None, None) => return output,
        }
    }
}

fn call(device: &mut impl SerialDevice, now: &mut time::Instant, request: &[u8]) -> Vec<u8> {
    send(device, now, request);
    read_all(device, now)
}

fn bytes(request: &Request<'_>) -> Vec<u8> {
    let mut out = [0; MAX_FRAME];
    let n = Alpha1.encode_request(request, &mut out).unwrap();
    out[..n].to_vec()
}

/// Builds a frame with its CHECK.
fn frame(header: [u8; 2], data: &[u8]) -> Vec<u8> {
    let check = data.iter().fold(0_u8, |sum, byte| sum.wrapping_add(*byte));
    [&header[..], data, &[check, 0xED]].concat()
}

#[test]
fn every_row_of_the_document_gets_its_answer() {
    let (mut robot, mut now) = (robot(), time::Instant::ZERO);
    let action = [&[1, 0, 0, 0, 0, 0][..], &[90; 20], &[25, 0, 0]].concat();
    let rows = [
        (frame([0xF1, 0x1F], &[0; 6]), &b"\xF1\x1F\x0CAlpha1_V2.0\x68\xED"[..]),
        (
            frame([0xEF, 0xFE], &[0; 6]),
            &[0xEF, 0xFE, 0x00, 0x00, 0xFF, 0xFF, 0xFE, 0xED],
        ),
        (frame([0xF2, 0x2F], &[0; 6]), &[0xF2, 0x2F, 0xAA, 0xED]),
        (
            frame([0xF5, 0x5F], &[1, 0, 0, 0, 0, 0]),
            b"\xF5\x5F\xAA2015121519\xA5\xED",
        ),
        (
            frame([0xFB, 0xBF], &action),
            &[0xFB, 0xBF, 0x01, 0xAA, 0, 0, 0, 0, 0xAB, 0xED],
        ),
        (frame([0xF4, 0x4F], &[1, 1, 0, 0, 0, 0]), &[0xF4, 0x4F, 0xAA, 0xED]),
        (frame([0xF4, 0x4F], &[1, 0, 0, 0, 0, 0]), &[0xF4, 0x4F, 0xAA, 0xED]),
        (frame([0xF3, 0x3F], b"\x06dance"), &[0xF3, 0x3F, 0xAA, 0xED]),
        (frame([0xF3, 0x3F], b"\x06sleep"), &[0xF3, 0x3F, 0xEE, 0xED]),
        (frame([0xF3, 0x3F], b"\x01"), &[0xF3, 0x3F, 0xEE, 0xED]),
        // The last: the robot becomes a disk.
        (frame([0xF9, 0x9F], &[1, 0, 0, 0, 0, 0]), &[0xF9, 0x9F, 0xAA, 0xED]),
    ];
    for (request, answer) in rows {
        assert_eq!(call(&mut robot, &mut now, &request), answer, "{request:02X?}");
    }
    assert_eq!((robot.counters().answered, robot.counters().refused), (11, 2));
}

#[test]
fn servos_answer_manual_frames_directly_and_through_robot() {
    fn check(mut device: impl SerialDevice) {
        let mut now = time::Instant::ZERO;
        let frames = [
            // Move to 90° in 1 s.
            (&[0xFA, 0xAF, 1, 1, 0x5A, 0x32, 0x00, 0x32, 0xC0, 0xED][..], &[0xAB][..]),
            (
                &[0xFA, 0xAF, 1, 2, 0, 0, 0, 0, 0x03, 0xED],
                &[0xFA, 0xAF, 1, 0xAA, 0x00, 0x5A, 0x00, 0x5A, 0x5F, 0xED],
            ),
            // Release, light.
            (&[0xFA, 0xAF, 16, 1, 0xFF, 0, 0, 0, 0x10, 0xED], &[0xBA]),
            (&[0xFA, 0xAF, 2, 4, 1, 0, 0, 0, 0x07, 0xED], &[0xAC]),
            // Offset: set -1°, read.
            (
                &[0xFA, 0xAF, 1, 0xD2, 0, 0, 0xFF, 0xFD, 0xCF, 0xED],
                &[0xFA, 0xAF, 1, 0xAA, 0, 0, 0, 0, 0xAB, 0xED],
            ),
            (
                &[0xFA, 0xAF, 1, 0xD4, 0, 0, 0, 0, 0xD5, 0xED],
                &[0xFA, 0xAF, 1, 0xAA, 0, 0, 0xFF, 0xFD, 0xA7, 0xED],
            ),
            // Version.
            (
                &[0xFC, 0xCF, 1, 1, 0, 0, 0, 0, 0x02, 0xED],
                &[0xFC, 0xCF, 1, 0xAA, 0x41, 0x16, 0x51, 0x01, 0x54, 0xED],
            ),
            // Id 1 becomes 200.
            (
                &[0xFA, 0xAF, 1, 0xCD, 0, 200, 0, 0, 0x96, 0xED],
                &[0xFA, 0xAF, 200, 0xAA, 0, 1, 0, 0, 0x73, 0xED],
            ),
            (&[0xFA, 0xAF, 200, 4, 0, 0, 0, 0, 0xCC, 0xED], &[0x72]),
            // No servo has id 1 now, and no servo answers a broadcast.
            (&[0xFA, 0xAF, 1, 4, 0, 0, 0, 0, 0x05, 0xED], &[]),
            (&[0xFA, 0xAF, 0, 4, 0, 0, 0, 0, 0x04, 0xED], &[]),
        ];
        for (request, answer) in frames {
            assert_eq!(call(&mut device, &mut now, request), answer, "{request:02X?}");
        }
    }
    check(bus());
    check(robot());
}

#[test]
fn versions_match_the_configuration() {
    let config = RobotConfig {
        hardware: b"x".to_vec(),
        firmware: *b"2016010100",
        ..RobotConfig::default()
    };
    let mut host = host(Alpha1Robot::new(config));
    assert_eq!(
        host.call(Request::ReadHardwareVersion),
        Ok(Some(Response::HardwareVersion(name("x"))))
    );
    let firmware = FirmwareVersion {
        outcome: Outcome::Success,
        text: *b"2016010100",
    };
    assert!(firmware.text >= OLDEST_FIRMWARE);
    assert_eq!(
        host.call(Request::ReadFirmwareVersion),
        Ok(Some(Response::FirmwareVersion(firmware)))
    );
}

#[test]
fn debug_action_moves_servos_evenly_in_given_time() {
    let (mut robot, mut start) = (robot(), time::Instant::ZERO);
    let Request::Act(mut action) = act(180, 2_000, 0) else {
        unreachable!()
    };
    action.angles[0] = None;
    action.angles[1] = Some(angle(0));
    send(&mut robot, &mut start, &bytes(&Request::Act(action)));

    for (after, degrees) in [
        (0, 0.0),
        (500, 22.5),
        (1_000, 45.0),
        (1_996, 89.82),
        (2_000, 90.0),
        (60_000, 90.0),
    ] {
        let angles = angles(robot.servos(), start + millis(after));
        assert_eq!(angles[0], 90.0);
        assert!((angles[1] - (90.0 - degrees)).abs() < 1e-6, "{angles:?}");
        assert!(
            angles[2..].iter().all(|angle| (angle - (90.0 + degrees)).abs() < 1e-6),
            "{angles:?}"
        );
    }
    assert!(robot.servos()[15].is_moving(start + time::Duration::from_micros(1_999_999)));
    assert!(!robot.servos()[15].is_moving(start + millis(2_000)));
    assert!(!robot.servos()[0].is_moving(start));
}

#[test]
fn debug_action_without_duration_arrives_at_once() {
    let mut host = host(robot());
    assert_eq!(host.call(act(0, 0, 0)), acted(Outcome::Success));
    assert_eq!(angles(host.device().servos(), host.elapsed()), [0.0; 16]);
}

#[test]
fn new_move_starts_where_the_servo_is() {
    let (mut robot, mut now) = (robot(), time::Instant::ZERO);
    send(&mut robot, &mut now, &bytes(&act(190, 1_000, 0)));
    let mut now = time::Instant::from_micros(now.as_micros() + 500_000 - 33 * 87); // the end of the second frame
    send(&mut robot, &mut now, &bytes(&act(40, 1_000, 0)));
    assert_eq!(robot.servos()[3].angle(now), 140.0);
    assert_eq!(robot.servos()[3].angle(now + millis(100)), 130.0);
    assert_eq!(robot.servos()[3].target(), 40.0);
}

#[test]
fn early_debug_action_is_refused_without_motion() {
    let (mut robot, mut now) = (robot(), time::Instant::ZERO);
    send(&mut robot, &mut now, &bytes(&act(100, 200, 1_000)));
    let end = now;
    let second = bytes(&act(50, 0, 0));

    let mut early = time::Instant::from_micros(end.as_micros() + 1_000_000 - 33 * 87 - 1);
    send(&mut robot, &mut early, &second);
    assert_eq!(read_all(&mut robot, &mut early)[10..14], [0xFB, 0xBF, 0x01, 0xEE]);
    assert_eq!(robot.servos()[0].angle(early), 100.0);
    assert_eq!(robot.counters().refused, 1);

    let answer = call(&mut robot, &mut early, &second);
    assert_eq!(answer[2..4], [0x01, 0xAA]);
    assert_eq!(robot.servos()[0].angle(early), 50.0);
}

#[test]
fn stop_ends_the_interval() {
    let mut host = host(robot());
    assert_eq!(host.call(act(100, 200, 60_000)), acted(Outcome::Success));
    assert_eq!(host.call(act(50, 200, 0)), acted(Outcome::Failure));
    host.call(Request::Stop).unwrap();
    assert_eq!(host.call(act(50, 200, 0)), acted(Outcome::Success));
}

#[test]
fn unreachable_angle_is_refused_for_existing_servo() {
    let (mut robot, mut now) = (robot(), time::Instant::ZERO);
    for (servo, raw, outcome) in [(16, 241, 0xEE), (1, 254, 0xEE), (17, 241, 0xAA), (16, 240, 0xAA)] {
        let mut angles = [100; 20];
        angles[servo - 1] = raw;
        let data = [&[1, 0, 0, 0, 0, 0][..], &angles, &[0, 0, 0]].concat();
        let before = robot.servos()[2].angle(now);
        assert_eq!(call(&mut robot, &mut now, &frame([0xFB, 0xBF], &data))[3], outcome);
        let moved = robot.servos()[2].angle(now) != before;
        assert_eq!(moved, outcome == 0xAA && servo == 17, "servo {servo} to {raw}");
    }
    assert_eq!(robot.servos()[15].angle(now), 240.0);
}

#[test]
fn action_plays_poses_on_time_and_ends() {
    let (mut robot, mut start) = (robot(), time::Instant::ZERO);
    send(&mut robot, &mut start, &bytes(&Request::Play(name("wave"))));

    assert_eq!(robot.servos()[0].angle(start + millis(300)), 135.0);
    robot.advance(start + millis(600));
    assert_eq!(robot.servos()[0].angle(start + millis(600)), 180.0);
    assert_eq!(robot.servos()[1].target(), 120.0, "the second pose has begun");
    assert_eq!(robot.servos()[1].angle(start + millis(750)), 105.0);

    robot.advance(start + time::Duration::from_micros(2_299_999));
    assert_eq!(robot.playing(), Some("wave"));
    robot.advance(start + millis(2_300));
    assert_eq!(robot.playing(), None);
    assert_eq!(angles(robot.servos(), start + millis(2_300)), [90.0; 16]);
}

#[test]
fn stop_halts_action_and_servos_hold() {
    let mut host = host(robot());
    host.call(Request::Play(name("wave"))).unwrap();
    host.wait(millis(300));
    assert_eq!(host.call(Request::Stop), Ok(Some(Response::Stopped(Outcome::Success))));
    let stopped = angles(host.device().servos(), host.elapsed());
    assert!(stopped[0] > 100.0 && stopped[0] < 180.0);
    host.wait(millis(10_000));
    assert_eq!(angles(host.device().servos(), host.elapsed()), stopped);
    assert!(host.device().playing().is_none());
    assert!(host.device().servos().iter().all(Servo::is_running));
}

#[test]
fn last_command_wins() {
    let mut host = host(robot());
    host.call(Request::Play(name("dance"))).unwrap();
    assert_eq!(host.call(Request::Play(name("sleep"))), played(Outcome::Failure));
    assert_eq!(host.device().playing(), Some("dance"), "an unknown action ends nothing");
    host.call(Request::Play(name("wave"))).unwrap();
    assert_eq!(host.device().playing(), Some("wave"));
    host.call(act(100, 0, 0)).unwrap();
    assert_eq!(host.device().playing(), None);
    host.wait(millis(10_000));
    assert_eq!(angles(host.device().servos(), host.elapsed()), [100.0; 16]);
}

#[test]
fn released_servo_gives_way_until_next_move() {
    let mut host = host(robot());
    let states = |bits| Ok(Some(Response::ServoStates(ServoStates::from_bits(bits))));
    assert!(!host.device_mut().servos_mut()[2].turn_by_hand(angle(10)));
    assert_eq!(host.call(Request::ReadServoStates), states(0xFFFF));

    host.call(Request::Servo(ServoRequest::ReadAngles(id(3)))).unwrap();
    host.call(Request::Servo(ServoRequest::Release(one(16)))).unwrap();
    assert_eq!(host.call(Request::ReadServoStates), states(0x7FFB));

    assert!(host.device_mut().servos_mut()[2].turn_by_hand(angle(10)));
    let read = host.call(Request::Servo(ServoRequest::ReadAngles(id(3))));
    let expected = ServoResponse::Angles {
        servo: id(3),
        outcome: Outcome::Success,
        target: 10,
        actual: 10,
    };
    assert_eq!(read, Ok(Some(Response::Servo(expected))));

    host.call(act(90, 500, 0)).unwrap();
    assert_eq!(host.call(Request::ReadServoStates), states(0xFFFF));
    host.call(Request::Servo(ServoRequest::Release(Address::All))).unwrap();
    assert_eq!(host.call(Request::ReadServoStates), states(0));
}

#[test]
fn angle_read_reports_target_and_stops_servo() {
    let mut host = host(bus());
    host.device_mut().servos_mut()[0].turn_by_hand(angle(0));
    assert_eq!(host.call(go(one(1), 240, 4_800, 0)), acknowledged(1));
    host.wait(millis(2_000));
    let read = host.call(Request::Servo(ServoRequest::ReadAngles(id(1))));
    let expected = ServoResponse::Angles {
        servo: id(1),
        outcome: Outcome::Success,
        target: 240,
        actual: 100, // 50° a second; a millisecond on the line is a twentieth of a degree
    };
    assert_eq!(read, Ok(Some(Response::Servo(expected))));
    host.wait(millis(5_000));
    let stopped = host.device().servos()[0].angle(host.elapsed());
    assert!((99.9..100.2).contains(&stopped), "{stopped}");
}

#[test]
fn servo_is_busy_until_lock_time_but_executes() {
    let mut host = host(bus());
    assert_eq!(host.call(go(one(5), 120, 200, 1_000)), acknowledged(5));
    let servo = |host: &Host<ServoBus>| {
        let servo = &host.device().servos()[4];
        (servo.is_moving(host.elapsed()), servo.is_busy(host.elapsed()))
    };
    assert_eq!(servo(&host), (true, true));
    host.wait(millis(500));
    assert_eq!(servo(&host), (false, true));
    assert_eq!(host.call(go(one(5), 60, 0, 0)), acknowledged(5));
    assert_eq!(servo(&host), (false, false));
    assert_eq!(host.device().servos()[4].angle(host.elapsed()), 60.0);
}

#[test]
fn all_servos_execute_broadcast_without_answer() {
    let mut host = host(bus());
    assert_eq!(host.call(go(Address::All, 30, 0, 0)), Ok(None));
    host.call(Request::Servo(ServoRequest::SetLed {
        to: Address::All,
        led: Led(1),
    }))
    .unwrap();
    host.wait(millis(100));
    assert_eq!(host.take_events(), []);
    let servos = host.device().servos();
    assert_eq!(angles(servos, host.elapsed()), [30.0; 16]);
    assert!(servos.iter().all(|servo| servo.led() == Led(1)));
    assert_eq!(
        (host.device().counters().answered, host.device().counters().refused),
        (0, 0)
    );
}

#[test]
fn offset_turns_horn_if_held_else_scale() {
    let mut host = host(bus());
    let set = |servo, thirds| Request::Servo(ServoRequest::SetOffset(id(servo), Offset::new(thirds).unwrap()));
    host.call(go(one(1), 100, 0, 0)).unwrap();
    host.call(set(1, -9)).unwrap();
    host.call(set(2, 30)).unwrap();
    let now = host.elapsed();
    let servos = host.device().servos();
    assert_eq!((servos[0].angle(now), servos[0].horn(now)), (100.0, 97.0));
    assert_eq!((servos[1].angle(now), servos[1].horn(now)), (80.0, 90.0));
    let read = host.call(Request::Servo(ServoRequest::ReadOffset(id(1))));
    let expected = ServoResponse::Offset {
        servo: id(1),
        outcome: Outcome::Success,
        thirds: -9,
    };
    assert_eq!(read, Ok(Some(Response::Servo(expected))));
    assert_eq!(host.device().servos()[0].offset(), Offset::new(-9).unwrap());
}

#[test]
fn servo_answers_only_to_its_assigned_id() {
    let mut host = host(bus());
    let change = |from, to| {
        Request::Servo(ServoRequest::ChangeId {
            from: id(from),
            to: id(to),
        })
    };
    for (from, to) in [(16, 240), (240, 82), (82, 80), (80, 86)] {
        let changed = ServoResponse::IdChanged {
            servo: id(to),
            outcome: Outcome::Success,
            was: from,
        };
        assert_eq!(host.call(change(from, to)), Ok(Some(Response::Servo(changed))));
        assert_eq!(
            host.call(go(one(to), 90, 0, 0)),
            acknowledged(to),
            "also where its byte is a header or zero"
        );
    }
    assert_eq!(host.device().servos()[15].id(), id(86));
    assert_eq!(host.call(go(one(16), 90, 0, 0)), Err(NoAnswer { sends: 1 }));
    assert_eq!(host.device().counters().refused, 1);
}

#[test]
fn servos_with_equal_ids_answer_in_collision() {
    let mut bus = ServoBus::new(BusConfig {
        ids: vec![id(1), id(1)],
        ..BusConfig::default()
    });
    assert!(bus.servos_mut()[0].turn_by_hand(angle(0x0F)));
    assert!(bus.servos_mut()[1].turn_by_hand(angle(0x3C)));
    let mut now = time::Instant::ZERO;
    let same = call(&mut bus, &mut now, &bytes(&go(one(1), 90, 0, 0)));
    assert_eq!(same, [0xAB], "both send the same byte");

    for (servo, degrees) in [(0, 0x0F), (1, 0x3C)] {
        bus.servos_mut()[servo].go(now, angle(degrees), time::Duration::ZERO, time::Duration::ZERO);
    }
    let mixed = call(
        &mut bus,
        &mut now,
        &bytes(&Request::Servo(ServoRequest::ReadAngles(id(1)))),
    );
    assert_eq!(mixed[..8], [0xFA, 0xAF, 0x01, 0xAA, 0x00, 0x0C, 0x00, 0x0C]);
    // C9 & 23: not the checksum of the received bytes.
    assert_eq!(mixed[8], 0xC9 & 0x23);
}

#[test]
fn faulty_servo_does_nothing_and_reports_the_fault() {
    let mut host = host(robot());
    host.device_mut().servos_mut()[6].set_faulty(true);
    let failed = |request| match host.call(Request::Servo(request)) {
        Ok(Some(Response::Servo(
            ServoResponse::Angles { outcome, .. }
            | ServoResponse::IdChanged { outcome, .. }
            | ServoResponse::OffsetSet { outcome, .. }
            | ServoResponse::Offset { outcome, .. }
            | ServoResponse::Version { outcome, .. },
        ))) => outcome == Outcome::Failure,
        other => panic!("{other:?}"),
    };
    let requests = [
        ServoRequest::ReadAngles(id(7)),
        ServoRequest::ChangeId { from: id(7), to: id(8) },
        ServoRequest::SetOffset(id(7), Offset::MAX),
        ServoRequest::ReadOffset(id(7)),
        ServoRequest::ReadVersion(id(7)),
    ];
    assert!(requests.into_iter().all(failed));
    assert_eq!(host.device().servos()[6].id(), id(7));
    assert_eq!(host.device().servos()[6].offset().thirds(), 0);
    for request in [
        ServoRequest::Release(one(7)),
        ServoRequest::SetLed {
            to: one(7),
            led: Led(1),
        },
    ] {
        assert_eq!(host.call(Request::Servo(request)), Err(NoAnswer { sends: 1 }));
    }
    assert!(host.device().servos()[6].is_running() && host.device().servos()[6].led() == Led(0));
    assert_eq!(host.call(go(one(7), 10, 0, 0)), Err(NoAnswer { sends: 1 }));
    assert_eq!(host.call(act(10, 0, 0)), acted(Outcome::Failure));
    host.wait(millis(200));
    assert_eq!(angles(host.device().servos(), host.elapsed()), [90.0; 16]);

    host.call(Request::Play(name("dance"))).unwrap();
    host.wait(millis(300));
    let servos = host.device().servos();
    assert!(!servos[6].is_moving(host.elapsed()) && servos[0].is_moving(host.elapsed()));
}

#[test]
fn usb_mode_and_offset_settings_are_kept() {
    let mut host = host(robot());
    assert_eq!(
        (host.device().usb(), host.device().offset_tool()),
        (UsbType::SerialPort, OffsetTool::Disconnect)
    );
    host.call(Request::SetUsbType(UsbType::Hid)).unwrap();
    host.call(Request::SetOffsetTool(OffsetTool::Connect)).unwrap();
    assert_eq!(
        (host.device().usb(), host.device().offset_tool()),
        (UsbType::Hid, OffsetTool::Connect)
    );
}

#[test]
fn disk_answers_and_leaves_the_line() {
    let mut host = host(robot());
    let become_type = Request::SetUsbType;
    let done = Ok(Some(Response::UsbType(Outcome::Success)));
    assert_eq!(host.call(become_type(UsbType::Disk)), done);
    assert!(!host.device().is_gone(), "its answer can be read");
    assert_eq!(host.call(become_type(UsbType::SerialPort)), done);
    host.wait(millis(10_000));
    assert!(!host.device().is_gone(), "the last type counts");

    assert_eq!(host.call(become_type(UsbType::Disk)), done);
    host.wait(millis(500));
    assert!(host.device().is_gone());
    assert_eq!(host.device().poll_timeout(), None);
    assert_eq!(host.call(become_type(UsbType::SerialPort)), Err(NoAnswer { sends: 1 }));
    assert_eq!(host.device().usb(), UsbType::Disk);
}

#[test]
fn bus_answers_servo_frames_within_400_us() {
    let (mut bus, mut now) = (bus(), time::Instant::ZERO);
    send(&mut bus, &mut now, &bytes(&go(one(1), 90, 0, 0)));
    assert_eq!(bus.transmit(now + time::Duration::from_micros(199)), None);
    assert_eq!(bus.transmit(now + time::Duration::from_micros(400)), Some(0xAB));
    now += millis(10);

    for request in [
        Request::ReadHardwareVersion,
        Request::ReadServoStates,
        Request::Stop,
        Request::ReadFirmwareVersion,
        act(10, 0, 0),
        Request::SetOffsetTool(OffsetTool::Connect),
        Request::SetUsbType(UsbType::Hid),
        Request::Play(name("wave")),
    ] {
        assert_eq!(call(&mut bus, &mut now, &bytes(&request)), [], "{request:?}");
    }
    assert_eq!((bus.counters().answered, bus.counters().refused), (1, 8));
    assert_eq!(angles(bus.servos(), now), [90.0; 16]);
}

#[test]
fn host_with_echo_still_completes_calls() {
    let mut host = host(ServoBus::new(BusConfig {
        echo: true,
        ..BusConfig::default()
    }));
    let release = Request::Servo(ServoRequest::Release(one(1)));
    let read = Request::Servo(ServoRequest::ReadVersion(id(2)));
    assert_eq!(host.call(release), acknowledged(1));
    assert!(matches!(
        host.call(read),
        Ok(Some(Response::Servo(ServoResponse::Version { .. })))
    ));
    assert_eq!(host.call(go(Address::All, 1, 0, 0)), Ok(None));
    host.wait(millis(10));
    assert_eq!(host.take_events(), [LineEvent::Echo, LineEvent::Echo, LineEvent::Echo]);
}

#[test]
fn bytes_during_an_answer_are_lost() {
    let (mut bus, mut now) = (bus(), time::Instant::ZERO);
    send(
        &mut bus,
        &mut now,
        &bytes(&Request::Servo(ServoRequest::ReadVersion(id(1)))),
    );
    now += time::Duration::from_micros(200);
    assert_eq!(bus.transmit(now), Some(0xFC));
    send(&mut bus, &mut now, &bytes(&go(one(2), 10, 0, 0)));
    let rest = read_all(&mut bus, &mut now);
    assert_eq!((rest.len(), rest[0]), (9, 0xCF));
    assert_eq!((bus.counters().collided, bus.counters().requests), (10, 1));
}

#[test]
fn requests_and_answers_may_be_padded_to_reports() {
    for hid in [false, true] {
        let (mut robot, mut now) = (
            Alpha1Robot::new(RobotConfig {
                hid,
                ..RobotConfig::default()
            }),
            time::Instant::ZERO,
        );
        for (request, answer) in [
            (Request::Stop, 4),
            (Request::ReadHardwareVersion, 16),
            (go(one(1), 10, 0, 0), 1),
        ] {
            let mut report = bytes(&request);
            report.resize(64, 0);
            let output = call(&mut robot, &mut now, &report);
            assert_eq!(output.len(), if hid { 64 } else { answer });
            assert!(output[answer - 1] != 0 && output[answer..].iter().all(|&byte| byte == 0));
        }
        assert_eq!((robot.counters().noise_bytes, robot.counters().unknown), (0, 0));
    }
}

#[test]
fn report_padding_is_ignored_by_client() {
    let mut host = host(Alpha1Robot::new(RobotConfig {
        hid: true,
        ..RobotConfig::default()
    }));
    assert_eq!(host.device().usb(), UsbType::Hid);
    for _ in 0..3 {
        assert!(host.call(Request::ReadHardwareVersion).is_ok());
        assert_eq!(host.call(act(100, 100, 0)), acted(Outcome::Success));
        assert_eq!(host.call(go(one(9), 10, 0, 0)), acknowledged(9));
        host.wait(millis(10));
    }
    assert_eq!(host.take_events(), []);
}

#[test]
fn invalid_request_is_counted_without_answer() {
    let (mut robot, mut now) = (robot(), time::Instant::ZERO);
    let wrong_values = [
        frame([0xF9, 0x9F], &[4, 0, 0, 0, 0, 0]),     // no such USB type
        frame([0xF4, 0x4F], &[1, 2, 0, 0, 0, 0]),     // neither connected nor not
        frame([0xFA, 0xAF], &[241, 1, 90, 0, 0, 0]),  // no such id
        frame([0xFA, 0xAF], &[1, 0xD2, 0, 0, 0, 91]), // offset out of range
        frame([0xFC, 0xCF], &[1, 2, 0, 0, 0, 0]),     // the boot loader
        frame([0xFB, 0xBF], &[0x06, 0x18, 0x00]),     // the Bluetooth protocol
    ];
    for (i, frame) in wrong_values.iter().enumerate() {
        assert_eq!(call(&mut robot, &mut now, frame), [], "{frame:02X?}");
        assert_eq!(robot.counters().unknown, i as u64 + 1);
    }

    let mut damaged = frame([0xF2, 0x2F], &[0; 6]);
    damaged[9] = 0xEE;
    for frame in [damaged, vec![0x55; 3]] {
        let before = robot.counters().noise_bytes;
        assert_eq!(call(&mut robot, &mut now, &frame), [], "{frame:02X?}");
        assert!(robot.counters().noise_bytes > before);
    }
    assert_eq!((robot.counters().requests, robot.counters().answered), (0, 0));
    assert_eq!(angles(robot.servos(), now), [90.0; 16]);
}

#[test]
fn idle_line_frees_request_behind_false_header() {
    let (mut robot, mut now) = (robot(), time::Instant::ZERO);
    send(&mut robot, &mut now, &[0xF3, 0x3F, 60]);
    send(&mut robot, &mut now, &bytes(&Request::Stop));
    assert_eq!(robot.transmit(now + time::Duration::from_micros(100_999)), None);
    assert_eq!(robot.transmit(now + time::Duration::from_micros(101_000)), Some(0xF2)); // idle 100 ms, turnaround 1 ms
}

#[test]
fn pause_ends_requests_on_servo_bus_only() {
    fn answer_after(mut device: impl SerialDevice, pause: time::Duration) -> Vec<u8> {
        let mut now = time::Instant::ZERO;
        let request = bytes(&go(one(1), 10, 0, 0));
        let (first, second) = request.split_at(5);
        send(&mut device, &mut now, first);
        // The next byte comes 87 µs later.
        now += pause;
        call(&mut device, &mut now, second)
    }
    assert_eq!(answer_after(robot(), millis(99)), [0xAB]);
    assert_eq!(answer_after(robot(), millis(100)), []);
    assert_eq!(answer_after(bus(), millis(4)), [0xAB]);
    assert_eq!(answer_after(bus(), millis(5)), []);
}

#[test]
fn due_pose_precedes_request_freed_by_idle() {
    let (mut robot, mut start) = (robot(), time::Instant::ZERO);
    send(&mut robot, &mut start, &bytes(&Request::Play(name("wave"))));
    let mut now = start + millis(550);
    send(&mut robot, &mut now, &[0xF3, 0x3F, 60]);
    send(&mut robot, &mut now, &bytes(&go(one(2), 10, 0, 0)));
    // The second pose, at 600 ms, sends servo 2 to 120°; the line is idle at 651 ms.
    robot.advance(start + millis(700));
    assert_eq!(robot.servos()[1].target(), 10.0);
}

#[test]
fn burst_of_two_hosts_gets_all_answers() {
    let requests = [
        Request::ReadHardwareVersion,
        Request::Servo(ServoRequest::ReadVersion(id(1))),
        Request::Stop,
        Request::ReadFirmwareVersion,
    ];
    let burst = requests.map(|request| bytes(&request)).concat();
    let (mut robot, mut now) = (robot(), time::Instant::ZERO);
    let whole = call(&mut robot, &mut now, &burst);
    assert_eq!(whole.len(), 16 + 10 + 4 + 15);
    for cut in 0..burst.len() {
        let (first, second) = burst.split_at(cut);
        send(&mut robot, &mut now, first);
        now += millis(99); // less than the line's idle time
        let mut output: Vec<_> = std::iter::from_fn(|| robot.transmit(now)).collect();
        send(&mut robot, &mut now, second);
        output.extend(read_all(&mut robot, &mut now));
        assert_eq!(output, whole, "cut at {cut}");
    }
    assert_eq!((robot.counters().noise_bytes, robot.counters().unknown), (0, 0));
}

#[test]
fn answers_queue_and_excess_ones_are_counted() {
    let (mut robot, mut now) = (robot(), time::Instant::ZERO);
    for _ in 0..MAX_REPLIES + 2 {
        for byte in bytes(&Request::Stop) {
            robot.receive(now, byte);
        }
    }
    assert_eq!(robot.counters().overrun, 2);
    now += millis(1);
    let first: Vec<_> = std::iter::from_fn(|| robot.transmit(now)).collect();
    assert_eq!(first.len(), 4, "one answer at a time");
    assert_eq!(read_all(&mut robot, &mut now).len(), 4 * (MAX_REPLIES - 1));
}

#[test]
fn every_intact_request_is_answered_after_noise() {
    let mut random = Rand32::new(7);
    let (mut robot, mut now) = (robot(), time::Instant::ZERO);
    let request = bytes(&Request::ReadFirmwareVersion);
    let mut swallowed = 0;
    for _ in 0..20_000 {
        let len = random.rand_range(0..80);
        // Many bytes are header-like, so false headers are common.
        let noise: Vec<u8> = (0..len)
            .flat_map(|_| match random.rand_range(0..4) {
                0 => {
                    let headers = [0xF1, 0xEF, 0xF2, 0xF5, 0xFB, 0xF4, 0xF9, 0xF3, 0xFA, 0xFC_u8];
                    let header = headers[random.rand_range(0..10) as usize];
                    vec![header, header.rotate_left(4)]
                }
                1 => vec![random.rand_range(0..64) as u8],
                _ => vec![random.rand_u32() as u8],
            })
            .collect();
        let before = robot.counters();
        send(&mut robot, &mut now, &noise);
        send(&mut robot, &mut now, &request);
        let output = read_all(&mut robot, &mut now);
        let answers = robot.counters().answered - before.answered;
        // CHECK is one byte: noise and the request sometimes form another valid frame.
        if !output.ends_with(b"\xF5\x5F\xAA2015121519\xA5\xED") {
            let counters = robot.counters();
            assert!(answers > 0 || counters.unknown > before.unknown, "after {noise:02X?}");
            swallowed += 1;
        }
    }
    assert!(swallowed < 20_000 / 256, "{swallowed}");
}

fn any_angle() -> impl Strategy<Value = Angle> {
    (0..=240_u8).prop_map(angle)
}

fn any_id() -> impl Strategy<Value = ServoId> {
    // Mostly an existing servo.
    prop_oneof![4 => 1..=16_u8, 1 => 1..=240_u8].prop_map(id)
}

fn any_address() -> impl Strategy<Value = Address> {
    prop_oneof![4 => any_id().prop_map(Address::One), 1 => Just(Address::All)]
}

fn any_servo_request() -> impl Strategy<Value = ServoRequest> {
    prop_oneof![
        (any_address(), any_angle(), any::<u8>(), any::<u16>()).prop_map(|(to, angle, time, lock)| {
            ServoRequest::Move {
                to,
                angle,
                time: MoveTime::new(time),
                lock: Interval::new(lock),
            }
        }),
        any_address().prop_map(ServoRequest::Release),
        (any_address(), any::<u8>()).prop_map(|(to, led)| ServoRequest::SetLed { to, led: Led(led) }),
        any_id().prop_map(ServoRequest::ReadAngles),
        (any_id(), any_id()).prop_map(|(from, to)| ServoRequest::ChangeId { from, to }),
        (any_id(), -90..=90_i16)
            .prop_map(|(servo, thirds)| { ServoRequest::SetOffset(servo, Offset::new(thirds).unwrap()) }),
        any_id().prop_map(ServoRequest::ReadOffset),
        any_id().prop_map(ServoRequest::ReadVersion),
    ]
}

fn any_request() -> impl Strategy<Value = Request<'static>> {
    prop_oneof![
        Just(Request::ReadHardwareVersion),
        Just(Request::ReadServoStates),
        Just(Request::Stop),
        Just(Request::ReadFirmwareVersion),
        (
            proptest::array::uniform20(proptest::option::of(any_angle())),
            any::<u8>(),
            0..100_u16
        )
            .prop_map(|(angles, time, interval)| Request::Act(Action {
                angles,
                time: MoveTime::new(time),
                interval: Interval::new(interval),
            })),
        Just(Request::SetOffsetTool(OffsetTool::Connect)),
        Just(Request::SetUsbType(UsbType::Hid)),
        Just(Request::Play(name("wave"))),
        Just(Request::Play(name("dance"))),
        Just(Request::Play(name("sleep"))),
        any_servo_request().prop_map(Request::Servo),
    ]
}

/// Any request, of which some make the robot a disk: it then leaves the line.
fn any_request_or_disk() -> impl Strategy<Value = Request<'static>> {
    prop_oneof![
        9 => any_request(),
        1 => Just(Request::SetUsbType(UsbType::Disk)),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn robot_recovers_after_any_faults(
        requests in proptest::collection::vec(any_request(), 0..20),
        hid: bool,
        to_robot in any_rates(),
        from_robot in any_rates(),
        seed: u64,
    ) {
        let robot = Alpha1Robot::new(RobotConfig { hid, ..RobotConfig::default() });
        let mut host = host(Line::new(robot, to_robot, from_robot, seed));
        for request in requests {
            let _ = host.call(request);
        }
        host.device_mut().set_rates(Rates::NONE, Rates::NONE);
        host.wait(millis(1_000)); // delayed bytes and late answers
        prop_assert!(matches!(host.call(Request::ReadServoStates), Ok(Some(Response::ServoStates(_)))));
        prop_assert!(matches!(host.call(Request::ReadFirmwareVersion), Ok(Some(Response::FirmwareVersion(_)))));
    }

    #[test]
    fn requests_to_existing_servos_get_their_answers(
        requests in proptest::collection::vec(any_request().prop_filter("ids stay apart", keeps_ids), 1..20),
        hid: bool,
    ) {
        let mut host = host(Alpha1Robot::new(RobotConfig { hid, ..RobotConfig::default() }));
        for request in requests {
            let info = Alpha1.request(&bytes(&request)).unwrap();
            let is_broadcast = info.response.is_none();
            match host.call(request) {
                Ok(Some(response)) => {
                    let mut out = [0; MAX_FRAME];
                    let n = Alpha1.encode_response(&response, None, &mut out).unwrap();
                    prop_assert!(Alpha1.is_response_to(info.key, &out[..n]));
                }
                Ok(None) => prop_assert!(is_broadcast),
                Err(_) => prop_assert!(addresses_missing_servo(&request), "{:?}", request),
            }
        }
    }

    #[test]
    fn robot_behaviour_is_independent_of_polling(
        script in proptest::collection::vec((any_request_or_disk(), 0..5_000_000_u64), 1..12),
        mut polls in proptest::collection::vec(0..50_000_000_u64, 0..200),
    ) {
        let (mut rarely, mut often) = (robot(), robot());
        polls.sort_unstable();
        let mut polls = polls.into_iter().map(time::Instant::from_micros).peekable();
        let mut now = time::Instant::ZERO;
        for (request, pause) in script {
            send(&mut rarely, &mut now.clone(), &bytes(&request));
            send(&mut often, &mut now, &bytes(&request));
            let begin = now;
            now += time::Duration::from_micros(pause);
            while let Some(poll) = polls.next_if(|&poll| poll <= now) {
                // Polls in the past are moved: time never runs backwards.
                often.advance(poll.max(begin));
            }
            rarely.advance(now);
            often.advance(now);
            prop_assert_eq!(rarely.servos(), often.servos());
            prop_assert_eq!(rarely.playing(), often.playing());
            prop_assert_eq!(rarely.is_gone(), often.is_gone());
        }
    }

    #[test]
    fn robot_sends_nothing_but_answers(
        noise in proptest::collection::vec(
            prop_oneof![
                20 => any::<u8>().prop_map(|byte| vec![byte]),
                1 => any_request().prop_filter("ids stay apart", keeps_ids).prop_map(|request| bytes(&request)),
            ],
            0..300,
        ),
    ) {
        let noise = noise.concat();
        let (mut robot, mut now) = (robot(), time::Instant::ZERO);
        send(&mut robot, &mut now, &noise);
        let output = read_all(&mut robot, &mut now);
        // Contents of servo frames do not matter here. Bytes outside of frames are acknowledgements.
        let expect = Expect::Responses(Some(ServoAnswer::Angles));
        let mut decoder = Decoder::<_, MAX_FRAME>::new();
        let (mut rest, mut frames, mut frame_bytes) = (&output[..], 0, 0);
        while !rest.is_empty() {
            rest = decoder.push(rest);
            while let Some(item) = decoder.next(&Alpha1, expect) {
                if item.kind == Kind::Frame {
                    prop_assert!(Alpha1.parse_response(item.bytes, expect).is_ok());
                    frames += 1;
                    frame_bytes += item.bytes.len();
                }
            }
        }
        prop_assert_eq!(robot.counters().answered, (frames + output.len() - frame_bytes) as u64, "{:02X?}", output);
        prop_assert_eq!(robot.counters().bytes, noise.len() as u64);
    }
}

/// Returns true if the request addresses a servo that the robot does not have.
fn addresses_missing_servo(request: &Request<'_>) -> bool {
    // The id is the first byte of the data.
    matches!(request, Request::Servo(_)) && bytes(request)[2] > 16
}

fn keeps_ids(request: &Request<'_>) -> bool {
    !matches!(request, Request::Servo(ServoRequest::ChangeId { .. }))
}

#[test]
fn late_or_endless_clock_is_handled() {
    let mut robot = robot();
    let mut now = time::Instant::from_micros(1_700_000_000_000_000);
    send(&mut robot, &mut now, &bytes(&Request::Play(name("dance"))));
    robot.advance(now + millis(60_000));
    assert_eq!(angles(robot.servos(), now + millis(60_000)), [90.0; 16]);
    robot.advance(time::Instant::from_micros(u64::MAX));
    send(
        &mut robot,
        &mut time::Instant::from_micros(u64::MAX),
        &bytes(&act(100, 5_000, 5_000)),
    );
    assert_eq!(robot.servos()[0].angle(time::Instant::from_micros(u64::MAX)), 90.0);
}
