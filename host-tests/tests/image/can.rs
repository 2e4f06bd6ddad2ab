//! The firmware image on a CAN bus: an arm's frames by ISO-TP, cyclic telemetry, and bus faults.

use armwire::ling::{Request, Response};
use armwire_bridge::can::{Frame, Function, Id, Node};
use armwire_bridge::config::{self, Config, Poll};
use armwire_bridge::control::{self, Event};
use armwire_bridge::isotp::SeparationTime;
use armwire_host_tests::image::requests::frame;
use armwire_host_tests::image::{
    BIT_RATE, CanProgram, Control, MEGABAUD, Program, board_config, chip, counters, facts, on_board, on_board_with,
    plug_in, read_all,
};
use armwire_sim::ling::LingArm;
use armwire_virtual_board::{Nanos, VirtualBoard};

fn ling() -> LingArm {
    LingArm::new(armwire_sim::ling::Config::follower())
}

/// The state of the arm a hundred times a second.
fn telemetry() -> Config {
    Config {
        poll: Poll::Hertz(100),
        can: config::Can {
            telemetry_hz: 100,
            ..config::Can::default()
        },
        ..Config::default()
    }
}

/// Plugs the board in, attaches the bus, and configures telemetry.
fn start_telemetry(board: &mut VirtualBoard<LingArm>) -> Control {
    plug_in(board, MEGABAUD);
    board.can().attach(BIT_RATE);
    let mut control = Control::open(board);
    control.order(board, control::Request::SetConfig(telemetry()));
    board.run_for(Nanos::from_millis(100)).unwrap();
    control
}

/// Expects telemetry at its rate for a second.
fn expect_telemetry(board: &mut VirtualBoard<LingArm>) {
    let id = Function::JointsA.id(Node::default());
    board.can().read();
    board.run_for(Nanos::from_millis(1_000)).unwrap();
    let joints = board.can().read().iter().filter(|frame| frame.id() == id).count();
    assert!((99..=101).contains(&joints), "{joints} in a second");
}

#[test]
fn can_and_usb_hosts_get_their_own_answers() {
    on_board(ling(), |board| {
        plug_in(board, MEGABAUD);
        board.can().attach(BIT_RATE);
        let mut on_can = CanProgram::default();
        let mut on_usb = Program::default();
        let (joints, temperatures) = (frame(Request::ReadJoints), Request::ReadTemperatures);
        for _ in 0..200 {
            on_can.send(&joints);
            let Some(Response::Temperatures(_)) = on_usb.call(board, temperatures) else {
                panic!("the host on USB received another answer");
            };
            let limit = board.now() + Nanos::from_millis(20);
            let answer = loop {
                if let Some(answer) = on_can.poll(board) {
                    break answer;
                }
                assert!(board.now() < limit, "the host on CAN received no answer");
                board.run_for(Nanos(100_000)).unwrap();
            };
            assert_eq!(answer[..3], joints[..3], "the host on CAN received another answer");
        }
        assert_eq!(read_all(board), b"");
        let counters = counters(board);
        assert_eq!(counters.frames, 400);
        assert_eq!((counters.unanswered_requests, counters.unsolicited_frames), (0, 0));
        assert_eq!((counters.can_receive_overruns, counters.can_bus_errors), (0, 0));
    });
}

#[test]
fn telemetry_goes_out_at_its_rate() {
    on_board(ling(), |board| {
        start_telemetry(board);
        expect_telemetry(board);
        expect_telemetry(board);
    });
}

#[test]
fn lost_bus_is_counted_reported_and_recovered() {
    on_board(ling(), |board| {
        let mut control = start_telemetry(board);
        control.subscribe(board);

        board.can().short();
        board.run_for(Nanos::from_millis(100)).unwrap();
        let lost = counters(board);
        assert!(lost.can_bus_offs >= 1);
        assert!(lost.can_bus_errors > 0);

        board.can().release();
        board.run_for(Nanos::from_millis(100)).unwrap();
        expect_telemetry(board);
        let offs: Vec<_> = control
            .take_events(board)
            .into_iter()
            .filter_map(|(_, event)| match event {
                Event::BusOff { off } => Some(off),
                _ => None,
            })
            .collect();
        assert_eq!(offs.first(), Some(&true), "{offs:?}");
        assert_eq!(offs.last(), Some(&false), "{offs:?}");
        // Polls continued, and a host on the bus is served again.
        assert_eq!(counters(board).unanswered_requests, 0);
        expect_served(board);
    });
}

#[test]
fn permanently_lost_bus_blocks_neither_arm_nor_usb() {
    on_board(ling(), |board| {
        start_telemetry(board);
        // The recovery cannot start.
        board.can().keep_from_initialization(true);
        board.can().short();
        board.run_for(Nanos::from_millis(100)).unwrap();
        board.can().release();
        board.run_for(Nanos::from_millis(3_000)).unwrap();
        let seen = counters(board);
        assert_eq!((seen.can_bus_offs, seen.unanswered_requests), (1, 0));

        board.can().keep_from_initialization(false);
        board.run_for(Nanos::from_millis(100)).unwrap();
        expect_telemetry(board);
        expect_served(board);
    });
}

/// Checks that a host on the bus receives the answer to its request.
fn expect_served(board: &mut VirtualBoard<LingArm>) {
    let joints = frame(Request::ReadJoints);
    let answer = CanProgram::default().call(board, &joints);
    assert_eq!(answer[..3], joints[..3]);
}

#[test]
fn invalid_request_flood_blocks_neither_arm_nor_usb() {
    on_board(ling(), |board| {
        plug_in(board, MEGABAUD);
        board.can().attach(BIT_RATE);
        // A frame of minimum length, without an answer.
        let flood = Frame::new(Function::ArmRequest.id(Node::default()), &[]).unwrap();
        board.can().flood(Some(&flood)).unwrap();
        let mut program = Program::default();
        for _ in 0..50 {
            board.run_for(Nanos::from_millis(100)).unwrap();
            let answer = program.call(board, Request::ReadTemperatures);
            assert!(matches!(answer, Some(Response::Temperatures(_))), "{answer:?}");
        }
        let seen = counters(board);
        assert!(seen.can_frames_received > 90_000, "{}", seen.can_frames_received);
        assert_eq!((seen.can_receive_overruns, seen.watchdog_resets), (0, 0));
        board.can().flood(None).unwrap();
        board.run_for(Nanos::from_millis(10)).unwrap();
        expect_served(board);
    });
}

#[test]
fn bus_without_nodes_blocks_neither_arm_nor_usb() {
    on_board(ling(), |board| {
        plug_in(board, MEGABAUD);
        let mut control = Control::open(board);
        control.order(board, control::Request::SetConfig(telemetry()));
        let mut program = Program::default();
        for _ in 0..500 {
            let answer = program.call(board, Request::ReadTemperatures);
            assert!(matches!(answer, Some(Response::Temperatures(_))), "{answer:?}");
        }
    });
}

/// A frame with this identifier wins over all of the adapter's.
fn urgent() -> Frame {
    Frame::new(Id::new(1).unwrap(), &[0; 8]).unwrap()
}

/// Runs until the adapter has sent `count` answer frames since the records were last cleared.
fn run_until_sent(board: &mut VirtualBoard<LingArm>, count: usize) {
    let limit = board.now() + Nanos::from_millis(20);
    while answer_frames(board).len() < count {
        assert!(board.now() < limit, "it sends nothing");
        board.run_for(Nanos(10_000)).unwrap();
    }
}

/// Start and end of the adapter's answer frames.
fn answer_frames(board: &VirtualBoard<LingArm>) -> Vec<(Nanos, Nanos)> {
    let id = Function::ArmAnswer.id(Node::default());
    let frames = board.can().frames().into_iter();
    frames
        .filter(|sent| sent.frame.is_some_and(|frame| frame.id() == id))
        .map(|sent| (sent.start, sent.end))
        .collect()
}

#[test]
fn consecutive_frames_keep_separation_on_busy_bus() {
    for st_min in [
        SeparationTime::from_hundreds_of_micros(2),
        SeparationTime::from_millis(1),
    ] {
        let st_min = st_min.unwrap();
        on_board(ling(), |board| {
            plug_in(board, MEGABAUD);
            board.can().attach(BIT_RATE);
            let request = Function::ArmRequest.id(Node::default());
            let joints = frame(Request::ReadJoints);
            let single = [&[joints.len() as u8], &joints[..]].concat();
            board.can().send(&Frame::new(request, &single).unwrap()).unwrap();
            run_until_sent(board, 1);
            let go_on = Frame::new(request, &[0x30, 0, st_min.to_byte()]).unwrap();
            board.can().send(&go_on).unwrap();
            run_until_sent(board, 2);
            for _ in 0..2 {
                // Other nodes occupy the bus until all due frames are in the mailboxes.
                board.can().flood(Some(&urgent())).unwrap();
                board.run_for(Nanos::from_millis(5)).unwrap();
                board.can().flood(None).unwrap();
                board.run_for(Nanos::from_millis(2)).unwrap();
            }
            let frames = answer_frames(board);
            assert_eq!(frames.len(), 4, "{frames:?}");
            for pair in frames[1..].windows(2) {
                let gap = pair[1].0.since(pair[0].1);
                assert!(gap >= st_min.duration().into(), "{gap:?} between {frames:?}");
            }
        });
    }
}

#[test]
fn saturating_flood_leaves_adapter_on_the_bus() {
    let mut config = board_config(ling());
    config.instruction_cost = config.instruction_cost.saturating_mul(facts(chip()).flooded);
    on_board_with(config, |board| {
        start_telemetry(board).subscribe(board);
        // Each is refused and reported on both interfaces.
        let flood = Frame::new(Function::ArmRequest.id(Node::default()), &[1, 0]).unwrap();
        board.can().flood(Some(&flood)).unwrap();
        board.run_for(Nanos::from_millis(100)).unwrap();
        expect_telemetry(board);
        board.can().flood(None).unwrap();
        board.run_for(Nanos::from_millis(10)).unwrap();
        assert_eq!(counters(board).can_receive_overruns, 0);
    });
}

#[test]
fn bus_loss_during_flash_erase_is_counted() {
    // Flash without room for a record: a save begins with an erase.
    let mut contents = vec![0xFF; chip().flash_size()];
    contents[facts(chip()).config_flash].fill(0x5A);
    let mut config = board_config(ling());
    config.flash = Some(contents);
    on_board_with(config, |board| {
        let mut control = start_telemetry(board);
        let before = board.flash_operations();
        // Other nodes occupy the bus, so frames wait in the mailboxes during the erase.
        board.can().flood(Some(&urgent())).unwrap();
        board.run_for(Nanos::from_millis(50)).unwrap();
        control.send(board, control::Request::SaveConfig);
        let mut operations = before;
        while operations == before || operations != board.flash_operations() {
            operations = board.flash_operations();
            board.run_for(Nanos::from_millis(1)).unwrap();
        }
        board.can().flood(None).unwrap();
        board.can().short();
        board.run_for(Nanos::from_millis(10)).unwrap();
        board.can().release();
        board.run_for(Nanos::from_millis(10)).unwrap();
        assert_eq!(board.flash_operations(), operations, "it is not being erased any more");
        board.run_for(Nanos::from_millis(1_000)).unwrap();
        let seen = counters(board);
        assert_eq!((seen.can_bus_offs, seen.config_saves), (1, 1));
        // The adapter is on the bus again.
        expect_served(board);
    });
}

#[test]
fn frames_waiting_at_bus_change_are_counted() {
    on_board(ling(), |board| {
        let mut control = start_telemetry(board);
        board.can().flood(Some(&urgent())).unwrap();
        board.run_for(Nanos::from_millis(100)).unwrap();
        let before = counters(board);
        let mut other = telemetry();
        other.can.bit_rate = 500_000;
        control.order(board, control::Request::SetConfig(other));
        board.run_for(Nanos::from_millis(100)).unwrap();
        let after = counters(board);
        assert_eq!((before.dropped_can_frames, after.dropped_can_frames), (0, 3));
    });
}
