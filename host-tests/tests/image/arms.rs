//! Each kind of arm on the UART of the firmware image, configured over the control interface before a power cycle.

use armwire::alpha1::{
    self, Address, Alpha1, Angle, Interval, Led, MoveTime, Outcome, Request, Response, ServoId, ServoRequest,
    ServoResponse, Text,
};
use armwire::messages::Messages;
use armwire::{Config as ClientConfig, ling};
use armwire_bridge::config::{ArmKind, Config, Poll};
use armwire_bridge::control::{self, Event, Initiator, Reply};
use armwire_host_tests::image::requests::encoded;
use armwire_host_tests::image::{
    BIT_RATE, CanProgram, Control, MEGABAUD, Program, ProgramOf, RawArm, board_config, byte_time, chip, counters,
    facts, noise, open, plug_in, same_bytes,
};
use armwire_sim::alpha1::{Alpha1Robot, BusConfig, RobotConfig, ServoBus};
use armwire_sim::ling::LingArm;
use armwire_virtual_board::line::{Arm, Outcome as ByteOutcome};
use armwire_virtual_board::report::Cause;
use armwire_virtual_board::usb::cdc::LineCoding;
use armwire_virtual_board::{Nanos, VirtualBoard};
use std::num::NonZeroU32;

/// The rate of Alpha1's lines, in bits per second.
const ALPHA1_BAUD: u32 = 115_200;

/// A program for an Alpha1 or its servos.
type Alpha1Program = ProgramOf<Alpha1, { alpha1::MAX_FRAME }>;

fn alpha1_program() -> Alpha1Program {
    Alpha1Program::new(ClientConfig {
        baud: NonZeroU32::new(ALPHA1_BAUD),
        ..ClientConfig::DEFAULT
    })
}

fn bytes_of<P: Messages + Default>(request: &P::Request<'_>) -> Vec<u8> {
    encoded(|bytes| P::default().encode_request(request, bytes))
}

/// Runs a test on a board that has saved this configuration and was power-cycled.
///
/// The serial port is not open yet.
fn saved<A: Arm>(arm: A, baud: u32, config: Config, test: impl FnOnce(&mut VirtualBoard<A>)) {
    let mut board_config = board_config(arm);
    board_config.arm_baud = baud;
    let mut board = VirtualBoard::start(board_config).unwrap();
    let board = &mut board;
    plug_in(board, MEGABAUD);
    let mut control = Control::open(board);
    control.order(board, control::Request::SetConfig(config));
    control.order(board, control::Request::SaveConfig);
    board.power_cycle().unwrap();
    board.run_for(Nanos::from_millis(50)).unwrap();
    let rate = board.uart().baud().unwrap();
    assert!(rate.abs_diff(baud.into()) * 100 < u64::from(baud), "{rate} baud");
    assert_eq!(board.uart().is_half_duplex(), config.arm == ArmKind::Alpha1Servo);
    board.can().attach(BIT_RATE);

    test(board);

    let mut control = Control::open(board);
    let reply = control.call(board, control::Request::GetConfig);
    assert_eq!(reply, Reply::Config(config));
    let report = board.report();
    report.check().unwrap();
    let restarts: Vec<_> = report.restarts.iter().map(|restart| restart.cause).collect();
    assert_eq!(restarts, [Cause::Power]);
}

fn kind(arm: ArmKind) -> Config {
    Config {
        arm,
        ..Config::default()
    }
}

/// Expects no lost or wrong byte and no missing answer.
fn expect_no_errors<A: Arm>(board: &mut VirtualBoard<A>) {
    let c = counters(board);
    let line = [
        c.framing_errors,
        c.parity_errors,
        c.noise_errors,
        c.overrun_errors,
        c.ring_overruns,
    ];
    assert_eq!(line, [0; 5]);
    let bytes = [c.noise_bytes, c.dropped_bytes, c.refused_bytes, c.undelivered_bytes];
    assert_eq!(bytes, [0; 4]);
    let requests = [c.unanswered_requests, c.late_answers, c.unsolicited_frames];
    assert_eq!(requests, [0; 3]);
    let can = [
        c.refused_can_frames,
        c.refused_can_requests,
        c.dropped_can_answers,
        c.isotp_failures,
    ];
    assert_eq!(can, [0; 4]);
    let line = board.uart().bytes();
    assert!(line.iter().all(|byte| byte.outcome == ByteOutcome::Arrived));
}

/// Checks the arm's identity, as reported to any host of the adapter.
fn expect_identity<A: Arm>(board: &mut VirtualBoard<A>, kind: ArmKind, answer: Option<Vec<u8>>) {
    let reply = Control::open(board).call(board, control::Request::IdentifyArm);
    let Reply::Arm(identity) = reply else {
        panic!("{reply:?}")
    };
    assert_eq!(identity.kind, kind);
    assert_eq!(identity.answer.map(|bytes| bytes.to_vec()), answer);
}

#[test]
fn ling_arm_works_over_usb_can_and_polls() {
    let config = Config {
        poll: Poll::Hertz(100),
        ..kind(ArmKind::Ling)
    };
    let arm = LingArm::new(armwire_sim::ling::Config::follower());
    saved(arm, MEGABAUD, config, |board| {
        open(board, MEGABAUD);
        let mut program = Program::default();
        let Some(ling::Response::Info(info)) = program.call(board, ling::Request::ReadInfo) else {
            panic!("no info");
        };
        let answer = encoded(|bytes| ling::Ling.encode_response(&ling::Response::Info(info), None, bytes));
        expect_identity(board, ArmKind::Ling, Some(answer.clone()));
        let question = bytes_of::<ling::Ling>(&ling::Request::ReadInfo);
        if facts(chip()).can {
            assert_eq!(CanProgram::default().call(board, &question), answer);
        }
        expect_no_errors(board);
    });
}

#[test]
fn alpha1_works_over_usb_can_and_polls() {
    let config = Config {
        poll: Poll::Hertz(20),
        ..kind(ArmKind::Alpha1)
    };
    saved(Alpha1Robot::new(RobotConfig::default()), ALPHA1_BAUD, config, |board| {
        open(board, ALPHA1_BAUD);
        let mut control = Control::open(board);
        control.subscribe(board);
        let polls_before = counters(board).requests_poll;
        let mut program = alpha1_program();
        let answer = program.call(board, Request::ReadHardwareVersion);
        let hardware = RobotConfig::default().hardware;
        let version = Text::new(&hardware).unwrap();
        assert_eq!(answer, Some(Response::HardwareVersion(version)));
        // The first servo moves on a command through the robot.
        let servo = ServoId::new(1).unwrap();
        let turn = ServoRequest::Move {
            to: Address::One(servo),
            angle: Angle::new(30).unwrap(),
            time: MoveTime::new(5),
            lock: Interval::new(0),
        };
        let acknowledged = Some(Response::Servo(ServoResponse::Acknowledged(servo)));
        assert_eq!(program.call(board, Request::Servo(turn)), acknowledged);
        board.run_for(Nanos::from_millis(200)).unwrap();
        let now = board.now().instant();
        assert_eq!(board.with_arm(|robot| robot.servos()[0].angle(now)), 30.0);
        assert_eq!(
            program.call(board, Request::Stop),
            Some(Response::Stopped(Outcome::Success))
        );

        let question = bytes_of::<Alpha1>(&Request::ReadFirmwareVersion);
        let answer = CanProgram::default().call(board, &question);
        assert_eq!(answer[..2], question[..2]);
        board.run_for(Nanos::from_millis(1_000)).unwrap();
        let reported = control.take_events(board);
        let for_polls = reported.iter().filter(|(_, event)| {
            matches!(
                event,
                Event::Frame {
                    initiator: Some(Initiator::Poll),
                    ..
                }
            )
        });
        let for_polls = for_polls.count() as u32;
        assert!((24..=30).contains(&for_polls), "{for_polls} polls");
        let polls = counters(board).requests_poll - polls_before;
        assert!(polls.abs_diff(for_polls) <= 1, "{polls}, {for_polls} reported");
        expect_identity(board, ArmKind::Alpha1, Some(answer));
        let received = board.with_arm(|robot| robot.counters());
        assert_eq!((received.unknown, received.noise_bytes, received.overrun), (0, 0, 0));
        expect_no_errors(board);
    });
}

#[test]
fn servo_bus_works_on_single_wire() {
    let bus = ServoBus::new(BusConfig::default());
    saved(bus, ALPHA1_BAUD, kind(ArmKind::Alpha1Servo), |board| {
        open(board, ALPHA1_BAUD);
        let mut program = alpha1_program();
        let servos: Vec<_> = (1..=16).map(|id| ServoId::new(id).unwrap()).collect();
        for (nth, &servo) in servos.iter().enumerate() {
            let turn = ServoRequest::Move {
                to: Address::One(servo),
                angle: Angle::new(100 + nth as u8).unwrap(),
                time: MoveTime::new(5),
                lock: Interval::new(0),
            };
            let acknowledged = Some(Response::Servo(ServoResponse::Acknowledged(servo)));
            assert_eq!(program.call(board, Request::Servo(turn)), acknowledged);
        }
        // A broadcast has no answer.
        let light = ServoRequest::SetLed {
            to: Address::All,
            led: Led(1),
        };
        assert_eq!(program.call(board, Request::Servo(light)), None);
        assert!(board.with_arm(|bus| bus.servos().iter().all(|servo| servo.led() == Led(1))));
        board.run_for(Nanos::from_millis(300)).unwrap();

        for (nth, &servo) in servos.iter().enumerate() {
            let angle = 100 + nth as u16;
            let angles = ServoResponse::Angles {
                servo,
                outcome: Outcome::Success,
                target: angle,
                actual: angle,
            };
            let question = Request::Servo(ServoRequest::ReadAngles(servo));
            if nth % 2 == 0 || !facts(chip()).can {
                assert_eq!(program.call(board, question), Some(Response::Servo(angles)));
            } else {
                let answer = CanProgram::default().call(board, &bytes_of::<Alpha1>(&question));
                let expected = encoded(|bytes| Alpha1.encode_response(&Response::Servo(angles), None, bytes));
                assert_eq!(answer, expected);
            }
        }
        // There were no collisions, and the servos did not take the adapter's requests for answers.
        let received = board.with_arm(|bus| bus.counters());
        assert_eq!((received.requests, received.answered), (33, 32));
        assert_eq!((received.collided, received.unknown, received.noise_bytes), (0, 0, 0));
        let c = counters(board);
        let on_can = if facts(chip()).can { 8 } else { 0 };
        assert_eq!((c.frames, c.requests_usb, c.requests_can), (32, 33 - on_can, on_can));
        assert_eq!(c.arm_to_host_bytes, 16 + 16 * 10);
        expect_no_errors(board);
        expect_identity(board, ArmKind::Alpha1Servo, None);
    });
}

#[test]
fn arbitrary_bytes_pass_both_ways_at_any_rate() {
    saved(RawArm::default(), MEGABAUD, kind(ArmKind::Raw), |board| {
        let mut exchanged = 0;
        open(board, MEGABAUD);
        for (nth, baud) in [MEGABAUD, 9_600, 57_600, 115_200, 230_400, 2_000_000]
            .into_iter()
            .enumerate()
        {
            board.usb().set_line_coding(LineCoding::new(baud)).unwrap();
            board.uart().set_arm_baud(baud);
            board.run_for(Nanos::from_millis(10)).unwrap();
            let len = 200 + baud as usize / 1_000;
            let (down, up) = (noise(nth as u64, len), noise(100 + nth as u64, len));
            board.with_arm(|arm| arm.send(&up));
            board.usb().write(&down).unwrap();
            board
                .run_for(Nanos(byte_time(baud).0 * len as u64 + 20_000_000))
                .unwrap();
            same_bytes("the host", &board.usb().read(), &up);
            same_bytes("the arm", &board.with_arm(RawArm::take_received), &down);
            exchanged += len as u32;
        }
        // A host on the bus may send arbitrary bytes, too.
        let on_bus: &[u8] = if facts(chip()).can { b"anything at all" } else { b"" };
        if !on_bus.is_empty() {
            let mut on_can = CanProgram::default();
            on_can.send(on_bus);
            for _ in 0..50 {
                assert_eq!(on_can.poll(board), None);
                board.run_for(Nanos(100_000)).unwrap();
            }
            assert_eq!(board.with_arm(RawArm::take_received), on_bus);
        }
        let c = counters(board);
        assert_eq!(
            (c.arm_to_host_bytes, c.host_to_arm_bytes),
            (exchanged, exchanged + on_bus.len() as u32)
        );
        assert_eq!(
            (c.frames, c.requests_usb, c.requests_can),
            (0, 0, u32::from(facts(chip()).can))
        );
        assert_eq!((c.dropped_bytes, c.refused_bytes, c.framing_errors), (0, 0, 0));
        expect_identity(board, ArmKind::Raw, None);
    });
}
