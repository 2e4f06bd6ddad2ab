//! A run of the firmware image repeats to the nanosecond.

use armwire_host_tests::image::{MEGABAUD, RawArm, board_config, noise, on_board_with, plug_in, read_all};
use armwire_virtual_board::line::FaultRates;

/// The trace of a run with faults drawn from `seed`.
fn trace(seed: u64) -> u64 {
    let mut config = board_config(RawArm::default());
    config.seed = seed;
    on_board_with(config, |board| {
        plug_in(board, MEGABAUD);
        board.uart().set_fault_rates(FaultRates {
            framing: 2_000,
            noise: 2_000,
            line_break: 2_000,
            overrun: 2_000,
        });
        board.with_arm(|arm| arm.send(&noise(1, 5_000)));
        board.usb().write(&noise(2, 5_000)).unwrap();
        read_all(board);
        board.trace_hash()
    })
}

#[test]
fn seed_determines_the_trace() {
    let first = trace(1);
    assert_eq!(trace(1), first);
    assert_ne!(trace(2), first);
}
