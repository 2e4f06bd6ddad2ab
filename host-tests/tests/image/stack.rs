//! A stack that overflows: a fault that is counted, and no changed data.

use armwire_bridge::control::{Reply, Request};
use armwire_host_tests::image::{Control, MEGABAUD, RawArm, board_config, chip, counters, exchange, plug_in};
use armwire_virtual_board::{Chip, Error, Nanos, VirtualBoard};

type Board = VirtualBoard<RawArm>;

/// Overflows the stack, which has this number of bytes left while no task runs, and runs the next start.
fn overflow(board: &mut Board, left: u32) {
    let end = board.symbol("_stack_end").expect("the image has a stack");
    let before = board.report().restarts.len();
    board.move_stack(end as u32 + left);
    let limit = board.now() + Nanos::from_millis(3_000);
    while board.now() < limit {
        match board.run_for(limit.since(board.now())) {
            Ok(()) | Err(Error::Crashed { .. }) => {}
            Err(error) => panic!("{error}"),
        }
    }
    assert_eq!(board.report().restarts.len(), before + 1, "{left} bytes left");
}

/// Returns true if the adapter is in recovery, and serves its host.
fn is_in_recovery(board: &mut Board) -> bool {
    plug_in(board, MEGABAUD);
    let reply = Control::open(board).call(board, Request::GetRecovery);
    let Reply::Recovery { active } = reply else {
        panic!("{reply:?}")
    };
    active
}

#[test]
fn three_stack_overflows_lead_to_recovery() {
    // In the entry of an interrupt, in its handler, and in a task.
    for left in [16, 48, 256] {
        let mut board = VirtualBoard::start(board_config(RawArm::default())).unwrap();
        board.run_for(Nanos::from_millis(50)).unwrap();
        for _ in 0..3 {
            assert!(!is_in_recovery(&mut board));
            exchange(&mut board, &[1, 2, 3, 4], &[5, 6, 7, 8]);
            overflow(&mut board, left);
        }
        assert!(is_in_recovery(&mut board));
        let counted = counters(&mut board);
        let overflows = match chip() {
            // The core locks up if its handler cannot be entered, and waits for the watchdog.
            Chip::Rp2040 => counted.hard_faults + counted.watchdog_resets,
            _ => counted.hard_faults,
        };
        assert_eq!(
            (overflows, counted.panics, counted.recovery_starts),
            (3, 0, 1),
            "{left} bytes left"
        );
    }
}
