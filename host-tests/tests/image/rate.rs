//! The firmware image and the line's rate: its changes, its return to the arm's rate, and reservations.

use armwire::framing::LONGEST_VOID;
use armwire::ling::{JOINTS, Request, Torque};
use armwire_bridge::Duration;
use armwire_bridge::can::Node;
use armwire_bridge::can::command::Command;
use armwire_bridge::config::{Can, Config, HostTimeout, Poll};
use armwire_bridge::control::{self, Failure, LineReservation, LineState, RESERVATION_MS, Reply};
use armwire_host_tests::image::requests::{frame, motion};
use armwire_host_tests::image::{
    Control, MEGABAUD, RawArm, byte_time, chip, counters, facts, for_chip, noise, on_board, plug_in, same_bytes,
};
use armwire_virtual_board::line::{Direction, LineByte, Outcome};
use armwire_virtual_board::usb::cdc::LineCoding;
use armwire_virtual_board::{Nanos, VirtualBoard};

type Board = VirtualBoard<RawArm>;

const READ_JOINTS: [u8; 7] = [0xAA, 0x06, 0x00, 0x01, 0xFE, 0x9A, 0xFF];

/// Bytes of an image for the arm's own firmware.
const IMAGE: usize = 300_000;

const fn millis(millis: u64) -> Nanos {
    Nanos::from_millis(millis)
}

/// Plugs the adapter in, and configures polls, commands on CAN and torque-off of silent hosts.
fn set_up(board: &mut Board, poll: Poll) -> Control {
    plug_in(board, MEGABAUD);
    let mut control = Control::open(board);
    let config = Config {
        poll,
        can: Can {
            commands: true,
            ..Can::default()
        },
        host_timeout: HostTimeout {
            after_ms: 300,
            torque_off: true,
        },
        ..Config::default()
    };
    control.order(board, control::Request::SetConfig(for_chip(board.chip(), config)));
    control
}

/// True if the UART runs at this rate, within the resolution of its divider.
fn runs_at(board: &mut Board, baud: u32) -> bool {
    let actual = board.uart().baud().unwrap();
    actual.abs_diff(baud.into()) * 100 < u64::from(baud)
}

fn line_state(board: &mut Board, control: &mut Control) -> LineState {
    match control.call(board, control::Request::GetLine) {
        Reply::Line(state) => state,
        reply => panic!("{reply:?}"),
    }
}

/// Number of polls since the last call.
fn polls(board: &mut Board) -> usize {
    let received = board.with_arm(RawArm::take_received);
    received.windows(7).filter(|bytes| *bytes == READ_JOINTS).count()
}

/// Bytes to the arm.
fn to_arm(board: &mut Board) -> Vec<LineByte> {
    let mut bytes = board.uart().bytes();
    bytes.retain(|byte| byte.direction == Direction::ToArm);
    bytes
}

#[test]
fn host_without_dtr_loses_rate_after_10s_quiet() {
    on_board(RawArm::default(), |board| {
        board.usb().attach();
        board.usb().open_without_dtr(0, LineCoding::new(9_600)).unwrap();
        board.run_for(millis(1_000)).unwrap();
        assert!(runs_at(board, MEGABAUD), "a silent host does not change the rate");
        board.usb().write(&[1]).unwrap();
        board.run_for(millis(9_900)).unwrap();
        assert!(runs_at(board, 9_600));
        board.run_for(millis(200)).unwrap();
        assert!(runs_at(board, MEGABAUD));
        assert_eq!(board.usb().line_coding().unwrap(), Some(LineCoding::new(9_600)));
    });
}

#[test]
fn line_returns_to_arm_at_close_or_suspend() {
    on_board(RawArm::default(), |board| {
        let mut control = set_up(board, Poll::Hertz(100));
        let close = |board: &mut Board| board.usb().set_control_lines(false, false).unwrap();
        let suspend = |board: &mut Board| {
            board.usb().suspend();
            board.run_for(millis(20)).unwrap();
        };
        for ends in [close as fn(&mut Board), suspend] {
            board.usb().set_control_lines(true, true).unwrap();
            board.usb().set_line_coding(LineCoding::new(9_600)).unwrap();
            board.run_for(millis(120)).unwrap();
            assert!(runs_at(board, 9_600));
            assert_eq!(line_state(board, &mut control).reservation, LineReservation::OtherRate);
            polls(board);
            board.run_for(millis(500)).unwrap();
            assert_eq!(polls(board), 0);
            ends(board);
            board.run_for(millis(500)).unwrap();
            assert!(runs_at(board, MEGABAUD) && polls(board) >= 3);
        }
    });
}

#[test]
fn next_program_may_set_rate_with_dtr_up() {
    on_board(RawArm::default(), |board| {
        let mut control = set_up(board, Poll::Hertz(100));
        board.usb().set_line_coding(LineCoding::new(9_600)).unwrap();
        board.run_for(millis(5_000)).unwrap();
        polls(board);
        board.run_for(millis(5_000)).unwrap();
        // The port was closed, but the adapter has no sign of it.
        assert_eq!((runs_at(board, 9_600), polls(board)), (true, 0));
        board.usb().open(0, LineCoding::new(MEGABAUD)).unwrap();
        board.run_for(millis(500)).unwrap();
        assert!(runs_at(board, MEGABAUD) && polls(board) >= 3);
        assert_eq!(line_state(board, &mut control), LineState::default());
    });
}

#[test]
fn port_at_9600_then_1m_spares_can_stream() {
    on_board(RawArm::default(), |board| {
        set_up(board, Poll::Off);
        board.can().attach(1_000_000);
        let mut sequence = 0;
        let mut moves = |board: &mut Board| {
            let command = Command {
                sequence,
                joints: [2048; JOINTS],
                speed: 10,
                gripper: 0,
            };
            for frame in command.to_frames(Node::default()) {
                board.can().send(&frame).unwrap();
            }
            sequence += 1;
            board.run_for(millis(20)).unwrap();
        };
        // The first one starts the stream, and moves nothing.
        (0..6).for_each(|_| moves(board));
        board.usb().open(0, LineCoding::new(9_600)).unwrap();
        (0..2).for_each(|_| moves(board));
        board.usb().set_line_coding(LineCoding::new(MEGABAUD)).unwrap();
        (0..10).for_each(|_| moves(board));
        let before = counters(board);
        assert_eq!((before.requests_command, before.line_codings), (17, 0));

        // A program that stays at 9600 does not obtain the line either.
        board.usb().open(0, LineCoding::new(9_600)).unwrap();
        (0..10).for_each(|_| moves(board));
        board.usb().write(&noise(1, 200)).unwrap();
        (0..10).for_each(|_| moves(board));
        assert_eq!(board.usb().line_coding().unwrap(), Some(LineCoding::new(9_600)));
        let after = counters(board);
        assert_eq!((after.requests_command, after.line_codings), (37, 0));
        assert_eq!(
            (
                after.refused_rate_bytes,
                after.refused_other_rate,
                after.refused_line_reserved
            ),
            (200, 1, 0)
        );
        let received = board.with_arm(RawArm::take_received);
        let one = received.len() / 37;
        same_bytes("the arm", &received, &received[..one].repeat(37));
        assert!(to_arm(board).iter().all(|byte| byte.outcome == Outcome::Arrived));
    });
}

/// A host on USB streams motion, sets another rate and sends on at that.
fn torque_off_at_the_arms_rate(baud: u32) {
    on_board(RawArm::default(), |board| {
        let mut control = set_up(board, Poll::Off);
        for _ in 0..5 {
            board.usb().write(&motion()).unwrap();
            board.run_for(millis(20)).unwrap();
        }
        let sent = to_arm(board).last().unwrap().at;
        board.usb().set_line_coding(LineCoding::new(baud)).unwrap();
        // More bytes than can be sent until the timeout.
        board.usb().write(&noise(1, baud as usize / 10)).unwrap();
        board.run_for(millis(700)).unwrap();

        let torque_off = frame(Request::SetTorque(Torque::Off));
        let expected = [&motion().repeat(5)[..], &[0; LONGEST_VOID], &torque_off].concat();
        let line = to_arm(board);
        let understood = line.iter().filter(|byte| byte.outcome == Outcome::Arrived);
        same_bytes(
            "the arm",
            &understood.map(|byte| byte.sent).collect::<Vec<_>>(),
            &expected,
        );
        let (last, before) = (
            line[line.len() - 1],
            line[line.len() - LONGEST_VOID - torque_off.len() - 1],
        );
        assert_eq!(last.outcome, Outcome::Arrived, "nothing is sent after it");
        // The bytes at the other rate were cut just before.
        assert_eq!(before.outcome, Outcome::Garbled);
        let cut = Nanos(facts(chip()).fifo * byte_time(baud).0) + millis(10);
        assert!(last.at.since(before.at) < cut, "{:?}", last.at.since(before.at));
        let after = last.at.since(sent).0;
        assert!(
            (300_000_000..450_000_000).contains(&after),
            "{after} ns after the last motion"
        );

        assert_eq!(board.usb().line_coding().unwrap(), Some(LineCoding::new(baud)));
        assert_eq!(line_state(board, &mut control).reservation, LineReservation::None);
        assert!(counters(board).refused_rate_bytes > 0);
        // The host's rate returns when the host sets it again.
        let before = line.len();
        board
            .run_until(millis(2_000), |board| board.usb().unsent() == 0)
            .unwrap();
        board.usb().set_line_coding(LineCoding::new(baud)).unwrap();
        board.run_for(millis(120)).unwrap();
        board.usb().write(&[0x5A]).unwrap();
        board.run_for(millis(20)).unwrap();
        let line = to_arm(board);
        assert_eq!(
            (line.len(), line[before].sent, line[before].outcome),
            (before + 1, 0x5A, Outcome::Garbled)
        );
    });
}

#[test]
fn torque_off_cuts_a_burst_at_9600_baud() {
    torque_off_at_the_arms_rate(9_600);
}

#[test]
fn torque_off_cuts_a_burst_at_115200_baud() {
    torque_off_at_the_arms_rate(115_200);
}

#[test]
fn reserved_line_passes_upload_byte_for_byte() {
    on_board(RawArm::default(), |board| {
        let mut control = set_up(board, Poll::Hertz(100));
        board.run_for(millis(200)).unwrap();
        assert!(polls(board) > 1);
        control.order(board, control::Request::ReserveLine);
        board.run_for(millis(100)).unwrap();
        polls(board);
        let image = noise(1, IMAGE);
        board.usb().write(&image).unwrap();
        while board.usb().unsent() > 0 {
            board.run_for(millis(1_000)).unwrap();
            control.order(board, control::Request::ReserveLine);
        }
        board.run_for(millis(1_000)).unwrap();
        same_bytes("the arm", &board.with_arm(RawArm::take_received), &image);
        assert_eq!(line_state(board, &mut control).reservation, LineReservation::Requested);
        control.order(board, control::Request::ReleaseLine);
        board.run_for(millis(500)).unwrap();
        assert!(polls(board) >= 3);
    });
}

#[test]
fn polls_interleave_upload_without_reservation() {
    on_board(RawArm::default(), |board| {
        set_up(board, Poll::Hertz(100));
        // No zeros, to identify those of the adapter.
        let image: Vec<u8> = noise(1, IMAGE).iter().map(|byte| byte | 1).collect();
        board.usb().write(&image).unwrap();
        while board.usb().unsent() > 0 {
            board.run_for(millis(1_000)).unwrap();
        }
        board.run_for(millis(1_000)).unwrap();
        let mut received = board.with_arm(RawArm::take_received);
        received.retain(|&byte| byte != 0);
        // All bytes in order, between the adapter's own frames.
        let mut rest = &received[..];
        let (mut uploaded, mut polls) = (Vec::with_capacity(IMAGE), 0);
        while let Some((&byte, behind)) = rest.split_first() {
            let poll: Vec<u8> = READ_JOINTS.iter().copied().filter(|&byte| byte != 0).collect();
            match rest.strip_prefix(&poll[..]) {
                Some(behind) => (rest, polls) = (behind, polls + 1),
                None => {
                    uploaded.push(byte);
                    rest = behind;
                }
            }
        }
        same_bytes("the arm", &uploaded, &image);
        assert!((10..100).contains(&polls), "{polls} polls");
    });
}

#[test]
fn reservation_of_killed_program_ends_by_itself() {
    on_board(RawArm::default(), |board| {
        let mut control = set_up(board, Poll::Hertz(100));
        control.order(board, control::Request::ReserveLine);
        board.run_for(millis(u64::from(RESERVATION_MS) - 100)).unwrap();
        assert_eq!(line_state(board, &mut control).reservation, LineReservation::Requested);
        polls(board);
        board.run_for(millis(600)).unwrap();
        assert_eq!(line_state(board, &mut control), LineState::default());
        assert!(polls(board) >= 3);
    });
}

#[test]
fn reservation_is_refused_during_motion_stream() {
    on_board(RawArm::default(), |board| {
        let mut control = set_up(board, Poll::Off);
        for _ in 0..3 {
            board.usb().write(&motion()).unwrap();
            board.run_for(millis(20)).unwrap();
        }
        let refused = Reply::Failed(Failure::StreamArmed);
        assert_eq!(control.call(board, control::Request::ReserveLine), refused);
        control.order(board, control::Request::EndStream);
        control.order(board, control::Request::ReserveLine);
        board.run_for(Duration::from_millis(1_000)).unwrap();
        assert_eq!(board.with_arm(RawArm::take_received), motion().repeat(3));
    });
}
