//! Behaviour of a virtual arm, observed on the line.

mod plant;

use armwire::decoder::{self, Decoder};
use armwire::ling::{
    ControlMode, Frame, GripperSpeed, JointMask, ModeReply, ModeResult, Move, Speed, TemperatureLimit,
};
use armwire::messages::Messages;
use oorandom::Rand32;
use proptest::prelude::*;

use super::*;
use crate::faults::{Line, Rates, any_rates};
use crate::wire::{LineEvent, Wire};

type Host<D> = Wire<Ling, D, MAX_FRAME>;

fn host(config: Config) -> Host<LingArm> {
    Wire::new(armwire::Config::default(), LingArm::new(config))
}

/// A follower whose joints are exactly where their commands put them.
fn ideal() -> Config {
    Config {
        plant: Plant::IDEAL,
        ..Config::follower()
    }
}

fn joints<D: SerialDevice>(host: &mut Host<D>) -> JointState {
    match host.call(Request::ReadJoints) {
        Ok(Some(Response::Joints(state))) => state,
        other => panic!("{other:?}"),
    }
}

fn go(ticks: u16, speed: u16, per_mille: u16) -> Request {
    Request::Move(Move {
        joints: [(Position::new(ticks).unwrap(), Speed::new(speed).unwrap()); JOINTS],
        gripper: (Opening::new(per_mille).unwrap(), GripperSpeed(speed)),
    })
}

fn seconds(seconds: u64) -> Duration {
    Duration::from_millis(1_000 * seconds)
}

fn send(arm: &mut LingArm, now: &mut Instant, bytes: &[u8]) {
    for &byte in bytes {
        *now += Duration::from_micros(10);
        arm.receive(*now, byte);
    }
}

/// Returns the arm's remaining output, and advances `now` to its end.
fn read_all(arm: &mut LingArm, now: &mut Instant) -> Vec<u8> {
    let mut output = Vec::new();
    loop {
        match (arm.transmit(*now), arm.poll_timeout()) {
            (Some(byte), _) => output.push(byte),
            (None, Some(due)) => *now = due.max(*now),
            (None, None) => return output,
        }
    }
}

fn bytes(request: &Request) -> Vec<u8> {
    let mut out = [0; MAX_FRAME];
    let n = Ling.encode_request(request, &mut out).unwrap();
    out[..n].to_vec()
}

#[test]
fn motion_keeps_commanded_speed_until_target() {
    let mut host = host(ideal());
    host.call(go(3048, 1000, 600)).unwrap();
    let start = host.elapsed();

    host.device_mut().advance(start + Duration::from_millis(500));
    assert_eq!(host.device().joints(), [2548; JOINTS]);
    assert_eq!(host.device().gripper(), 500);
    assert_eq!(host.device().velocities(), PerServo::Follower([1000; 10]));

    host.device_mut().advance(start + Duration::from_millis(700));
    // The gripper, the last servo, is at its target.
    assert_eq!(host.device().velocities().as_slice()[8..], [1000, 0]);

    host.device_mut().advance(start + Duration::from_micros(999_499));
    assert_eq!(host.device().joints(), [3047; JOINTS]);
    host.device_mut().advance(start + seconds(1));
    assert_eq!(host.device().joints(), [3048; JOINTS]);
    assert!(!host.device().is_moving());
}

#[test]
fn arm_reports_its_state_over_the_line() {
    let mut host = host(ideal());
    host.call(go(1000, 100, 900)).unwrap();
    host.wait(seconds(2));
    let state = joints(&mut host);
    assert_eq!(state.joints, [1848; JOINTS]);
    assert_eq!((state.gripper, state.status), (200, MotionStatus::Locked));
    assert_eq!(
        host.call(Request::ReadVelocities),
        Ok(Some(Response::Velocities(PerServo::Follower([100; 10]))))
    );
}

#[test]
fn gripper_speed_beyond_joint_maximum_is_accepted() {
    let mut host = host(ideal());
    let Request::Move(mut target) = go(2048, 0, 1000) else {
        unreachable!()
    };
    target.gripper.1 = GripperSpeed(5500); // as the vendor's software sends it
    host.call(Request::Move(target)).unwrap();
    host.wait(Duration::from_millis(182));
    assert_eq!(host.device().gripper(), 1000);
}

#[test]
fn without_torque_arm_ignores_motion_gives_way() {
    let mut host = host(ideal());
    assert!(!host.device_mut().push_joint(0, Position::MAX));
    assert!(!host.device_mut().push_gripper(Opening::OPEN));

    host.call(go(3000, 1000, 1000)).unwrap();
    host.wait(Duration::from_millis(100));
    host.call(Request::SetTorque(Torque::Off)).unwrap();
    let stopped = joints(&mut host);
    assert_eq!(stopped.status, MotionStatus::Idle);
    assert!((2148..2152).contains(&stopped.joints[0]));

    host.call(go(3000, 1000, 1000)).unwrap();
    host.wait(seconds(1));
    assert_eq!(joints(&mut host), stopped);
    assert_eq!(host.device().counters().refused, 1);

    assert!(host.device_mut().push_joint(5, Position::MAX));
    assert!(!host.device_mut().push_joint(6, Position::MAX));
    assert!(host.device_mut().push_gripper(Opening::OPEN));
    let pushed = joints(&mut host);
    assert_eq!((pushed.joints[5], pushed.gripper), (4095, 1000));

    host.call(Request::SetTorque(Torque::On)).unwrap();
    assert_eq!(joints(&mut host).joints, pushed.joints);
}

#[test]
fn zeroing_sets_origin_and_switches_torque_off() {
    let mut host = host(ideal());
    host.call(go(3000, 1000, 500)).unwrap();
    host.wait(Duration::from_millis(100));
    host.call(Request::SetZero).unwrap();
    let state = joints(&mut host);
    assert_eq!((state.joints, state.status), ([2048; JOINTS], MotionStatus::Idle));
    assert!(state.gripper > 0 && !host.device().is_holding());
}

#[test]
fn set_stroke_is_read_back() {
    let mut host = host(ideal());
    for stroke in [Stroke::Mm75, Stroke::Mm100, Stroke::Mm50] {
        host.call(Request::SetStroke(stroke)).unwrap();
        assert_eq!(host.call(Request::ReadStroke), Ok(Some(Response::Stroke(stroke))));
        assert_eq!(host.device().stroke(), stroke);
    }
}

#[test]
fn servos_warm_in_motion_and_cool_at_rest() {
    let mut host = host(ideal());
    assert_eq!(host.device().temperatures(), PerServo::Follower([25; 10]));
    host.device_mut().advance(Instant::ZERO + seconds(3_600));
    assert_eq!(host.device().temperatures(), PerServo::Follower([34; 10])); // just below 35

    host.wait(seconds(3_600));
    for _ in 0..30 {
        host.call(go(4095, 1000, 0)).unwrap();
        host.wait(seconds(2));
        host.call(go(48, 1000, 0)).unwrap();
        host.wait(seconds(2));
    }
    let moved = host.device().temperatures();
    assert!(moved.as_slice()[..9].iter().all(|&celsius| celsius > 42));
    assert_eq!(moved.as_slice()[9], 34); // the gripper rested

    host.call(Request::SetTorque(Torque::Off)).unwrap();
    host.wait(seconds(3_600));
    assert_eq!(host.device().temperatures(), PerServo::Follower([25; 10]));
}

#[test]
fn heat_is_reported_and_stops_arm_until_cooled() {
    let mut host = host(ideal());
    let limit = |celsius| Request::SetTemperatureLimit(TemperatureLimit::new(celsius).unwrap());
    host.wait(seconds(3_600)); // 34 °C
    host.call(go(2148, 1000, 0)).unwrap();

    host.call(limit(34)).unwrap();
    assert_eq!(host.device().status(), MotionStatus::Overheating);
    assert!(host.device().is_holding() && host.device().is_moving());

    host.call(limit(37)).unwrap();
    assert_eq!(
        host.device().status(),
        MotionStatus::Overheating,
        "within the margin it stays"
    );
    host.call(limit(40)).unwrap();
    assert_eq!(host.device().status(), MotionStatus::Locked);

    host.call(limit(29)).unwrap();
    assert_eq!(host.device().status(), MotionStatus::OverheatProtection);
    assert!(!host.device().is_holding() && !host.device().is_moving());
    host.call(Request::SetTorque(Torque::On)).unwrap();
    host.call(go(2148, 1000, 0)).unwrap();
    assert!(!host.device().is_holding());
    assert_eq!(host.device().counters().refused, 2);

    // Torque is off, so it cools to 25 °C, under 31 °C - 5 °C.
    host.call(limit(31)).unwrap();
    assert_eq!(host.device().status(), MotionStatus::OverheatProtection);
    host.wait(seconds(3_600));
    assert_eq!(host.device().status(), MotionStatus::Idle);
    host.call(Request::SetTorque(Torque::On)).unwrap();
    assert!(host.device().is_holding());
}

#[test]
fn hard_work_overheats_arm_at_factory_limit() {
    let mut host = host(ideal());
    let mut seen = Vec::new();
    for leg in 0..1_000 {
        host.call(go(if leg % 2 == 0 { 4095 } else { 0 }, 5000, 0)).unwrap();
        host.wait(Duration::from_millis(800));
        seen.push(host.device().status());
    }
    seen.dedup();
    assert_eq!(
        seen,
        [
            MotionStatus::Locked,
            MotionStatus::Overheating,
            MotionStatus::OverheatProtection,
            MotionStatus::Idle
        ]
    );
}

#[test]
fn self_check_names_the_faulty_servos() {
    let mut host = host(ideal());
    for id in [0, 3, 10, 11] {
        host.device_mut().set_faulty(id, true);
    }
    let check = |host: &mut Host<LingArm>| match host.call(Request::SelfCheck) {
        Ok(Some(Response::SelfCheck(check))) => check,
        other => panic!("{other:?}"),
    };
    assert!(check(&mut host).faulty(Kind::Follower).eq([3, 10]));
    host.device_mut().set_faulty(3, false);
    host.device_mut().set_faulty(10, false);
    assert_eq!(check(&mut host), SelfCheck(0x3FF));
}

#[test]
fn leader_has_six_servos_and_no_own_motion() {
    let mut host = host(Config {
        plant: Plant::IDEAL,
        ..Config::leader()
    });
    let Ok(Some(Response::Info(info))) = host.call(Request::ReadInfo) else {
        panic!()
    };
    assert_eq!(info.serial.to_string(), "ADLS251205123456");
    assert_eq!((info.hardware, info.firmware), (Version(110), Version(610)));
    assert_eq!(
        host.call(Request::SelfCheck),
        Ok(Some(Response::SelfCheck(SelfCheck(0x3F))))
    );
    assert_eq!(
        host.call(Request::ReadTemperatures),
        Ok(Some(Response::Temperatures(PerServo::Leader([25; 6]))))
    );
    assert!(host.device_mut().push_joint(2, Position::MAX));

    host.call(Request::SetTorque(Torque::On)).unwrap();
    host.call(go(0, 5000, 0)).unwrap();
    host.wait(seconds(1));
    assert_eq!(joints(&mut host).joints, [2048, 2048, 4095, 2048, 2048, 2048]);
    assert!(
        !host.device_mut().push_joint(2, Position::CENTRE),
        "the torque holds it"
    );
    assert!(host.device_mut().push_gripper(Opening::OPEN));
}

#[test]
fn unanswered_and_invalid_requests_get_no_answer() {
    let (mut arm, mut now) = (LingArm::new(Config::follower()), Instant::ZERO);
    for request in [go(2048, 100, 0), Request::SetZero, Request::SetStroke(Stroke::Mm75)] {
        send(&mut arm, &mut now, &bytes(&request));
    }
    let mut too_fast = bytes(&go(2048, 5000, 0));
    too_fast[6..8].copy_from_slice(&5001_u16.to_le_bytes());
    let data = too_fast[4..32].to_vec();
    let frames = [(0x06, 0x03, &data[..]), (0x42, 0x00, &[1]), (0x06, 0x00, &[0xFE, 0xFE])];
    for (command, function, data) in frames {
        let mut out = [0; MAX_FRAME];
        let n = Frame {
            command,
            function,
            data,
        }
        .encode(&mut out)
        .unwrap();
        send(&mut arm, &mut now, &out[..n]);
    }
    send(&mut arm, &mut now, &[0xAA, 0x06, 0x00, 0x01, 0xFE, 0x9B, 0xFF]);

    assert_eq!(read_all(&mut arm, &mut now), []);
    let counters = arm.counters();
    assert_eq!((counters.requests, counters.unknown, counters.noise_bytes), (3, 3, 7));
    assert_eq!((counters.answered, counters.refused), (0, 0));
}

#[test]
fn every_spelling_of_the_self_check_is_answered() {
    for request in [
        &[0xAA, 0xFE, 0x00, 0x00, 0xFE, 0x93, 0xFF][..],
        &[0xAA, 0xFE, 0x00, 0x00, 0xC8, 0xFF],
        &[0xAA, 0xFE, 0x00, 0x01, 0xFE, 0xD2, 0xFF],
    ] {
        let (mut arm, mut now) = (LingArm::new(Config::follower()), Instant::ZERO);
        send(&mut arm, &mut now, request);
        assert_eq!(
            read_all(&mut arm, &mut now),
            [0xAA, 0xFE, 0x00, 0x02, 0xFF, 0x03, 0x87, 0xFF]
        );
    }
}

#[test]
fn idle_line_frees_request_behind_false_header() {
    let (mut arm, mut now) = (LingArm::new(Config::follower()), Instant::ZERO);
    send(&mut arm, &mut now, &[0xAA, 0x06, 0x00, 64]);
    send(&mut arm, &mut now, &bytes(&Request::ReadStroke));
    let received = now;
    assert_eq!(arm.transmit(received + Duration::from_micros(2_199)), None);
    assert_eq!(arm.transmit(received + Duration::from_micros(2_200)), Some(0xAA)); // idle 2 ms, turnaround 200 µs
}

#[test]
fn calls_work_with_echo_of_every_byte() {
    let mut host = host(Config {
        echo: true,
        ..Config::follower()
    });
    host.call(Request::SetTorque(Torque::Off)).unwrap();
    assert_eq!(joints(&mut host).status, MotionStatus::Idle);
    assert_eq!(host.take_events(), [LineEvent::Echo, LineEvent::Echo]);
}

#[test]
fn answers_queue_and_excess_ones_are_counted() {
    let (mut arm, mut now) = (LingArm::new(Config::follower()), Instant::ZERO);
    for _ in 0..MAX_REPLIES + 2 {
        send(&mut arm, &mut now, &bytes(&Request::ReadStroke));
    }
    assert_eq!(arm.counters().overrun, 2);
    assert!(
        std::iter::from_fn(|| arm.transmit(now)).count() == 7,
        "one answer at a time"
    );
    assert_eq!(read_all(&mut arm, &mut now).len(), 7 * (MAX_REPLIES - 1));
}

#[test]
fn every_intact_request_is_answered_after_noise() {
    let mut random = Rand32::new(7);
    let (mut arm, mut now) = (LingArm::new(Config::follower()), Instant::ZERO);
    let request = bytes(&Request::ReadStroke);
    let mut swallowed = 0;
    for _ in 0..20_000 {
        let len = random.rand_range(0..80);
        // Half of the bytes are header-like, so false headers are common.
        let noise: Vec<u8> = (0..len)
            .map(|_| match random.rand_range(0..4) {
                0 => 0xAA,
                1 => random.rand_range(0..80) as u8,
                _ => random.rand_u32() as u8,
            })
            .collect();
        let before = arm.counters().unknown;
        send(&mut arm, &mut now, &noise);
        send(&mut arm, &mut now, &request);
        let output = read_all(&mut arm, &mut now);
        // The checksum is one byte: noise and the request sometimes form another valid frame.
        if output.is_empty() && arm.counters().unknown > before {
            swallowed += 1;
            continue;
        }
        assert_eq!(output, [0xAA, 0x04, 0x0E, 0x01, 0x00, 0x00, 0xFF], "after {noise:02X?}");
    }
    assert_eq!(arm.counters().answered + swallowed, 20_000);
    assert!(swallowed < 20_000 / 256, "{swallowed}");
}

fn any_request() -> impl Strategy<Value = Request> {
    prop_oneof![
        Just(Request::ReadInfo),
        Just(Request::SetZero),
        Just(Request::SetStroke(Stroke::Mm75)),
        Just(Request::ReadStroke),
        Just(Request::SetTorque(Torque::Off)),
        Just(Request::SetTorque(Torque::On)),
        Just(Request::ReadJoints),
        Just(Request::ReadTemperatures),
        (0..=253_u8).prop_map(|celsius| Request::SetTemperatureLimit(TemperatureLimit::new(celsius).unwrap())),
        Just(Request::ReadVelocities),
        (0..4096_u16, 0..=5000_u16, 0..=1000_u16).prop_map(|(ticks, speed, opening)| go(ticks, speed, opening)),
        Just(Request::SelfCheck),
    ]
}

/// Checks that an arm does the same after these requests, each with the pause behind it in microseconds, whether it is
/// polled at these times in microseconds or not.
pub(super) fn check_polling(
    config: &Config,
    script: Vec<(Request, u64)>,
    mut polls: Vec<u64>,
) -> Result<(), TestCaseError> {
    let (mut rarely, mut often) = (LingArm::new(config.clone()), LingArm::new(config.clone()));
    polls.sort_unstable();
    let mut polls = polls.into_iter().map(Instant::from_micros).peekable();
    let mut now = Instant::ZERO;
    for (request, pause) in script {
        send(&mut rarely, &mut now.clone(), &bytes(&request));
        send(&mut often, &mut now, &bytes(&request));
        now += Duration::from_micros(pause);
        while let Some(poll) = polls.next_if(|&poll| poll <= now) {
            // Polls before this byte are moved: time never runs backwards.
            often.advance(poll.max(often.body.now()));
        }
        rarely.advance(now);
        often.advance(now);
        prop_assert_eq!(&rarely.body, &often.body);
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn arm_recovers_after_any_faults(
        requests in proptest::collection::vec(any_request(), 0..20),
        to_arm in any_rates(),
        from_arm in any_rates(),
        seed: u64,
    ) {
        let line = Line::new(LingArm::new(Config::follower()), to_arm, from_arm, seed);
        let mut host = Host::new(armwire::Config::default(), line);
        for request in requests {
            let _ = host.call(request);
        }
        host.device_mut().set_rates(Rates::NONE, Rates::NONE);
        host.wait(Duration::from_millis(500)); // delayed bytes and late answers
        // The host may have to learn which answers are lost.
        let mut answers = (0..5).map(|_| host.call(Request::ReadJoints));
        prop_assert!(answers.any(|answer| matches!(answer, Ok(Some(Response::Joints(_))))));
        prop_assert!(matches!(host.call(Request::ReadInfo), Ok(Some(Response::Info(_)))));
    }

    #[test]
    fn arm_behaviour_is_independent_of_polling(
        script in proptest::collection::vec((any_request(), 0..20_000_000_u64), 1..12),
        polls in proptest::collection::vec(0..200_000_000_u64, 0..200),
    ) {
        check_polling(&Config::follower(), script, polls)?;
    }

    #[test]
    fn arm_sends_nothing_but_answers(
        noise in proptest::collection::vec(
            prop_oneof![20 => any::<u8>().prop_map(|byte| vec![byte]), 1 => any_request().prop_map(|request| bytes(&request))],
            0..300,
        ),
    ) {
        let noise = noise.concat();
        let (mut arm, mut now) = (LingArm::new(Config::follower()), Instant::ZERO);
        send(&mut arm, &mut now, &noise);
        let output = read_all(&mut arm, &mut now);
        let mut decoder = Decoder::<_, MAX_FRAME>::new();
        let (mut rest, mut answers) = (&output[..], 0);
        while !rest.is_empty() {
            rest = decoder.push(rest);
            while let Some(item) = decoder.next(&Ling, ()) {
                prop_assert_eq!(item.kind, decoder::Kind::Frame, "{:02X?}", output);
                prop_assert!(Ling.parse_response(item.bytes, ()).is_ok(), "{:02X?}", output);
                answers += 1;
            }
        }
        prop_assert_eq!(decoder.pending(), 0);
        prop_assert_eq!(arm.counters().answered, answers);
        prop_assert_eq!(arm.counters().bytes, noise.len() as u64);
    }
}

#[test]
fn late_or_endless_clock_is_handled() {
    let mut arm = LingArm::new(ideal());
    arm.advance(Instant::from_micros(1_700_000_000_000_000));
    assert_eq!(arm.joints(), [2048; JOINTS]);
    arm.advance(Instant::from_micros(u64::MAX));
    assert!(arm.is_holding());
}

/// A force-feedback leader.
fn leader(words: &str) -> Host<LingArm> {
    host(Config {
        force_feedback: Some(words.parse().unwrap()),
        plant: Plant::IDEAL,
        ..Config::leader()
    })
}

fn mode(host: &mut Host<LingArm>) -> ControlMode {
    match host.call(Request::ReadMode) {
        Ok(Some(Response::Mode(state))) => state.mode,
        other => panic!("{other:?}"),
    }
}

fn wait(host: &mut Host<LingArm>, millis: u64) {
    let later = host.elapsed() + Duration::from_millis(millis);
    host.device_mut().advance(later);
}

#[test]
fn plain_arm_does_not_answer_for_a_mode() {
    let mut host = host(Config::leader());
    for request in [
        Request::ReadMode,
        Request::SetMode(ControlMode::Current),
        Request::SetForceFeedback(true),
        Request::ReadForceFeedback,
    ] {
        assert!(host.call(request).is_err(), "{request}");
    }
}

#[test]
fn accepted_mode_is_applied_later() {
    let mut host = leader("apply=200ms");
    let reply = ModeReply {
        requested: 1,
        result: ModeResult::Accepted,
    };
    let answer = host.call(Request::SetMode(ControlMode::Current));
    assert_eq!(answer, Ok(Some(Response::ModeReply(reply))));
    assert_eq!(mode(&mut host), ControlMode::Position);
    wait(&mut host, 250);
    assert_eq!(mode(&mut host), ControlMode::Current);
}

#[test]
fn torque_is_off_after_a_return_to_position_mode() {
    let mut host = leader("apply=10ms");
    for control in [ControlMode::Current, ControlMode::Position] {
        host.call(Request::SetTorque(Torque::On)).unwrap();
        host.call(Request::SetMode(control)).unwrap();
        wait(&mut host, 20);
        assert_eq!(mode(&mut host), control);
        assert_eq!(host.device().is_holding(), control == ControlMode::Current);
    }
    // It moves again with torque, at any speed.
    host.call(Request::SetTorque(Torque::On)).unwrap();
    host.call(go(2058, 1, 0)).unwrap();
    wait(&mut host, 10_000);
    assert_eq!(host.device().joints(), [2058; JOINTS]);
}

#[test]
fn current_mode_moves_and_holds_nothing() {
    let mut host = leader("apply=0ms");
    host.call(Request::SetTorque(Torque::On)).unwrap();
    host.call(Request::SetMode(ControlMode::Current)).unwrap();
    host.call(go(3000, 1000, 0)).unwrap();
    wait(&mut host, 2_000);
    assert_eq!(host.device().joints(), [2048; JOINTS]);
    assert!(host.device_mut().push_joint(0, Position::new(2100).unwrap()));
}

#[test]
fn mode_may_be_refused_or_never_applied() {
    let mut refusing = leader("refuse");
    let answer = refusing.call(Request::SetMode(ControlMode::Current));
    let Ok(Some(Response::ModeReply(reply))) = answer else {
        panic!("{answer:?}");
    };
    assert_eq!(reply.result, ModeResult::Unsupported);
    let mut host = leader("never");
    host.call(Request::SetMode(ControlMode::Current)).unwrap();
    wait(&mut host, 60_000);
    assert_eq!(mode(&mut host), ControlMode::Position);
}

#[test]
fn requested_force_feedback_acts_only_without_inhibition() {
    let feedback = |words| {
        let mut host = leader(words);
        match host.call(Request::SetForceFeedback(true)) {
            Ok(Some(Response::ForceFeedback(state))) => (state.is_requested, state.is_effective, state.inhibit.0),
            other => panic!("{other:?}"),
        }
    };
    assert_eq!(feedback(""), (true, false, 0x01));
    assert_eq!(feedback("teleoperation"), (true, true, 0));
    assert_eq!(feedback("teleoperation,stale,fault,unsupported"), (true, false, 0x1C));
}

#[test]
fn words_of_a_leader_are_checked() {
    for word in ["apply", "apply=60001ms", "blocked=1", "never=1", ",", "ideal"] {
        assert!(word.parse::<Leader>().is_err(), "{word}");
    }
    let mut host = leader("blocked=2+3");
    let answer = host.call(Request::ReadMode);
    let Ok(Some(Response::Mode(state))) = answer else {
        panic!("{answer:?}");
    };
    assert_eq!(state.blocked, JointMask(0b110));
}
