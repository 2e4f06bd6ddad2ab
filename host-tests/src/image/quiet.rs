//! Delays that the adapter adds to a call without other load.

use armwire::ling::Request;
use armwire_virtual_board::latency::bursts;
use armwire_virtual_board::line::{Arm, Direction};
use armwire_virtual_board::{Nanos, VirtualBoard, usb};

use super::{MEGABAUD, Program, Spread, byte_time};

/// A pause that shifts the next measurement to another phase of the USB frame, the byte, and the firmware's periodic
/// tasks.
pub fn pause(nth: u64) -> Nanos {
    Nanos((nth * 618_034) % 1_000_000 + (nth * 977) % 10_000)
}

/// Discards the records of the line and of USB.
///
/// # Panics
///
/// If the board has ended.
pub fn forget<A: Arm>(board: &mut VirtualBoard<A>) {
    board.uart().forget_bytes();
    board.usb().forget_packets();
}

/// Time from the arm's last stop bit until the packet with that byte was ready.
///
/// # Panics
///
/// If the arm sent nothing, or the answer was not forwarded.
pub fn until_armed<A: Arm>(board: &mut VirtualBoard<A>) -> Nanos {
    let (line, packets) = (board.uart().bytes(), board.usb().packets());
    let bursts = bursts(&line, &packets, byte_time(MEGABAUD)).unwrap();
    bursts.last().unwrap().to_armed()
}

/// Time from the end of the request's packet to the first start bit at the arm.
fn until_start_bit<A: Arm>(board: &mut VirtualBoard<A>) -> Nanos {
    let line = board.uart().bytes();
    let first = line.iter().find(|byte| byte.direction == Direction::ToArm).unwrap();
    let packets = board.usb().packets();
    let request = packets
        .iter()
        .find(|packet| packet.direction == usb::Direction::Out)
        .unwrap();
    first.at.since(request.end + byte_time(MEGABAUD))
}

/// Delays added to calls.
#[derive(Clone, Debug, Default)]
pub struct Added {
    /// From the packet from the host to the first start bit.
    pub to_uart: Spread,
    /// From the last stop bit to the packet for the host.
    pub to_usb: Spread,
}

/// Calls a Ling arm `times` times over USB.
///
/// # Panics
///
/// If a call fails.
pub fn call<A: Arm>(board: &mut VirtualBoard<A>, times: u64) -> Added {
    let mut program = Program::default();
    let mut added = Added::default();
    for nth in 0..times {
        board.run_for(pause(nth)).unwrap();
        forget(board);
        program.call(board, Request::ReadJoints).unwrap();
        added.to_usb.add(until_armed(board));
        added.to_uart.add(until_start_bit(board));
    }
    added
}
