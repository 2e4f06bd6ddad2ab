//! How many instructions the firmware image that `ARMWIRE_IMAGE` names takes for a call while nothing else is to be done.
//!
//! From when the last byte of an answer is in until the packet for the host is ready, and from when the packet of a request
//! is in until its first byte goes out. In between the core does not sleep, and the virtual board takes a cycle for each
//! instruction: the time says how many there were.

use armwire_host_tests::image::{MEGABAUD, chip, facts, on_board, plug_in, quiet};
use armwire_sim::ling::{Config, LingArm};
use armwire_virtual_board::Nanos;

/// So many calls, of which the one in the middle counts.
const TIMES: u64 = 101;

fn main() {
    let added = on_board(LingArm::new(Config::follower()), |board| {
        plug_in(board, MEGABAUD);
        quiet::call(board, TIMES)
    });
    println!("request_from_usb {}", instructions(added.to_uart.median()));
    println!("answer_to_usb {}", instructions(added.to_usb.median()));
}

/// How many the core executes in this time.
fn instructions(time: Nanos) -> u64 {
    time.0 * (facts(chip()).core_hz / 1_000_000) / 1_000
}
