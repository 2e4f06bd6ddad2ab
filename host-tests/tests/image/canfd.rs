//! The image of a chip with CAN FD on a CAN FD bus. On a chip without, there is nothing to test.

use armwire::ling::Request;
use armwire_bridge::config::{self, Config, Poll};
use armwire_bridge::control;
use armwire_bridge::isotp::Link;
use armwire_host_tests::image::requests::frame;
use armwire_host_tests::image::{CanProgram, Control, MEGABAUD, chip, counters, facts, on_board, plug_in};
use armwire_sim::ling::{Config as ArmConfig, LingArm};
use armwire_virtual_board::can::{NodeConfig, Outcome, Sender};
use armwire_virtual_board::{Nanos, VirtualBoard};

/// Bits per second in the arbitration phase.
const RATE: u32 = 1_000_000;

/// Runs a test on a board with `data_rate` bits per second in the data phase, and nodes with `nodes_rate`. The board
/// sends telemetry at 100 Hz.
fn on_fd_bus(data_rate: u32, nodes_rate: u32, test: impl FnOnce(&mut VirtualBoard<LingArm>)) {
    if !facts(chip()).can_fd {
        return;
    }
    on_board(LingArm::new(ArmConfig::follower()), |board| {
        plug_in(board, MEGABAUD);
        board.can().attach_as(NodeConfig::fd(RATE, nodes_rate));
        let config = Config {
            poll: Poll::Hertz(100),
            can: config::Can {
                data_bit_rate: Some(data_rate),
                telemetry_hz: 100,
                ..config::Can::default()
            },
            ..Config::default()
        };
        Control::open(board).order(board, control::Request::SetConfig(config));
        // The board joins the bus.
        board.run_for(Nanos::from_millis(5)).unwrap();
        test(board);
    });
}

#[test]
fn calls_pass_by_fd_at_every_rate() {
    const CALLS: usize = 50;
    for rate in config::CAN_DATA_BIT_RATES {
        on_fd_bus(rate, rate, |board| {
            let mut program = CanProgram::new(Link::Fd);
            for nth in 0..CALLS {
                program.send(&frame(Request::ReadJoints));
                let limit = board.now() + Nanos::from_millis(20);
                while program.poll(board).is_none() {
                    assert!(board.now() < limit, "no answer to call {nth} at {rate} bit/s");
                    board.run_for(Nanos(50_000)).unwrap();
                }
            }
            // A frame is listed after its end, at which the program has it.
            board.run_for(Nanos(10_000)).unwrap();
            let frames = board.can().frames();
            assert!(frames.iter().all(|frame| frame.outcome == Outcome::Sent));
            let answers = frames
                .iter()
                .filter(|frame| frame.sender == Sender::Board && frame.on_the_wire.switches_bit_rate());
            assert!(answers.count() >= CALLS);
            let counted = counters(board);
            assert_eq!((counted.can_bus_errors, counted.can_receive_overruns), (0, 0));
        });
    }
}

#[test]
fn wrong_fd_data_rate_errors_until_corrected() {
    const RIGHT: u32 = 2_000_000;
    on_fd_bus(RIGHT, 5_000_000, |board| {
        let mut program = CanProgram::new(Link::Fd);
        program.send(&frame(Request::ReadJoints));
        for _ in 0..20 {
            program.poll(board);
            board.run_for(Nanos::from_millis(1)).unwrap();
        }
        assert!(counters(board).can_bus_errors > 0);
        board.can().detach();
        board.run_for(Nanos::from_millis(100)).unwrap();

        board.can().attach_as(NodeConfig::fd(RATE, RIGHT));
        board.run_for(Nanos::from_millis(500)).unwrap();
        board.can().read();
        let mut program = CanProgram::new(Link::Fd);
        program.send(&frame(Request::ReadJoints));
        let limit = board.now() + Nanos::from_millis(50);
        while program.poll(board).is_none() {
            assert!(board.now() < limit, "no answer");
            board.run_for(Nanos(50_000)).unwrap();
        }
    });
}

#[test]
fn classic_node_destroys_fd_frames() {
    on_fd_bus(2_000_000, 2_000_000, |board| {
        board.can().join(9, NodeConfig::classic(RATE));
        let mut program = CanProgram::new(Link::Fd);
        program.send(&frame(Request::ReadJoints));
        program.poll(board);
        board.run_for(Nanos::from_millis(10)).unwrap();
        assert!(counters(board).can_bus_errors > 0);
        assert!(
            board
                .can()
                .frames()
                .iter()
                .any(|frame| frame.outcome == Outcome::Garbled)
        );
    });
}
