//! The latency of the firmware image, with one cycle per instruction. `cargo xtask performance` also measures the core's
//! own timing.

use armwire::ling::{JointState, Ling, MotionStatus, Response, Stroke};
use armwire::messages::Messages;
use armwire_bridge::Duration;
use armwire_host_tests::image::quiet::{Added, call, forget, pause, until_armed};
use armwire_host_tests::image::requests::encoded;
use armwire_host_tests::image::{MEGABAUD, RawArm, Spread, chip, counters, facts, on_board, plug_in, read_all};
use armwire_sim::ling::LingArm;
use armwire_virtual_board::line::Arm;
use armwire_virtual_board::{Nanos, VirtualBoard};

/// Number of measurements.
const TIMES: u64 = 1_000;

/// Maximum time that the adapter may add to an answer with joint positions.
fn limit() -> Nanos {
    Nanos(facts(chip()).latency)
}

/// Time to detect an idle line, at 1 Mbaud.
const IDLE_WAIT: Nanos = Nanos(10_000);

/// Latency that the firmware achieves during continuous transmission to the arm. The goal is not reached yet.
const BUSY: Nanos = Nanos(42_000);

fn on_open_board<A: Arm>(arm: A, test: impl FnOnce(&mut VirtualBoard<A>)) {
    on_board(arm, |board| {
        plug_in(board, MEGABAUD);
        test(board);
    });
}

#[test]
fn call_latency_is_within_tenth_of_answer_time() {
    on_open_board(LingArm::new(armwire_sim::ling::Config::follower()), |board| {
        let Added { to_usb, to_uart } = call(board, TIMES);
        println!("an answer's last stop bit -> USB packet armed: {to_usb}");
        println!("USB packet from the host -> first start bit: {to_uart}");
        assert!(to_usb.worst() <= limit(), "{to_usb}");
        assert!(to_uart.worst() <= limit(), "{to_uart}");
    });
}

#[test]
fn bytes_inside_frame_cost_few_instructions() {
    on_open_board(RawArm::default(), |board| {
        let joints = JointState {
            joints: [2048; 6],
            gripper: 500,
            status: MotionStatus::Idle,
        };
        let frame = encoded(|bytes| Ling.encode_response(&Response::Joints(joints), None, bytes));
        let inside = frame.len() as u64 - 1;
        let mut least = u64::MAX;
        for nth in 0..20 {
            board.run_for(pause(nth)).unwrap();
            read_all(board);
            let before = board.instructions();
            board.with_arm(|arm| arm.send(&frame));
            // Up to the middle of the last byte.
            board.run_for(Nanos(10_000 * inside + 5_000)).unwrap();
            least = least.min(board.instructions() - before);
            board.run_for(Duration::from_micros(500)).unwrap();
            assert_eq!(board.usb().read(), frame);
        }
        println!("{least} instructions for {inside} bytes inside a frame");
        assert!(least <= 45 * inside, "{least}");
    });
}

#[test]
fn stray_bytes_are_ready_on_idle_line() {
    on_open_board(RawArm::default(), |board| {
        let mut armed = Spread::default();
        for nth in 0..TIMES {
            board.run_for(pause(nth)).unwrap();
            forget(board);
            let length = 1 + nth as usize % 40;
            board.with_arm(|arm| arm.send(&vec![0x55; length]));
            assert_eq!(read_all(board).len(), length);
            armed.add(until_armed(board));
        }
        println!("last stop bit of noise -> USB packet armed: {armed}");
        assert!(armed.worst().since(IDLE_WAIT) <= limit(), "{armed}");
    });
}

#[test]
fn answer_is_timely_during_continuous_host_transmission() {
    on_open_board(RawArm::default(), |board| {
        let frame = encoded(|bytes| Ling.encode_response(&Response::Stroke(Stroke::Mm50), None, bytes));
        board.usb().write(&vec![0x55; 60_000]).unwrap();
        let mut armed = Spread::default();
        while board.usb().unsent() > 1_000 {
            board.run_for(pause(armed.count() as u64)).unwrap();
            forget(board);
            board.with_arm(|arm| arm.send(&frame));
            board.run_for(Duration::from_micros(500)).unwrap();
            assert_eq!(board.usb().read(), frame);
            armed.add(until_armed(board));
        }
        println!("the host sends without a pause, an answer's last stop bit -> USB packet armed: {armed}");
        assert!(armed.count() > 300);
        assert!(armed.worst() <= BUSY, "{armed}");
        assert_eq!(counters(board).frames as usize, armed.count());
    });
}
