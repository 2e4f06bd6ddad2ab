//! The image starts: its clocks, and nothing that the chip does not allow.

use armwire_host_tests::image::{RawArm, on_board};
use armwire_virtual_board::Nanos;

#[test]
fn image_reaches_main_loop_without_violation() {
    on_board(RawArm::default(), |board| {
        board.run_for(Nanos::from_millis(200)).unwrap();
        assert!(board.uart().baud().is_some(), "the arm's UART runs");
    });
}
