//! Cycles by the Cortex-M4 Technical Reference Manual (ARM DDI 0439, 3.3).

use armwire_virtual_board::core::{FlashTiming, Timing};

use crate::board::{Board, CODE, RAM};

const NOP: u16 = 0xbf00;

const NO_WAIT: FlashTiming = FlashTiming {
    wait_states: 0,
    line_bytes: 16,
    code_lines: 64,
    data_lines: 8,
    prefetch: true,
};

/// Cycles of this many instructions from the start of a program.
fn cycles(timing: FlashTiming, code: &[u16], instructions: u64, registers: &[(u8, u32)]) -> u64 {
    let mut board = Board::new(code);
    board.core.set_timing(Timing::CortexM4(timing));
    for (number, value) in registers {
        board.set(*number, *value);
    }
    board.step(instructions);
    board.core.cycle()
}

#[test]
fn data_processing_takes_one_cycle() {
    // NOP; ADDS R0, #1; MLS R0, R1, R2, R3.
    assert_eq!(cycles(NO_WAIT, &[NOP, 0x3001, 0xfb01, 0x3012, NOP], 3, &[]), 3);
}

#[test]
fn loads_are_pipelined_with_loads_and_stores() {
    // LDR R0, [R1]; NOP, and LDR R0, [R1]; STR R0, [R1]; NOP.
    let at = [(1, RAM + 0x100)];
    assert_eq!(cycles(NO_WAIT, &[0x6808, NOP, NOP], 2, &at), 3);
    assert_eq!(cycles(NO_WAIT, &[0x6808, 0x6008, NOP, NOP], 3, &at), 3);
    // LDR R0, [R1]; LDR R0, [R0]: the second waits for its address.
    assert_eq!(
        cycles(NO_WAIT, &[0x6808, 0x6800, NOP], 2, &[(1, RAM + 0x100), (0, RAM)]),
        4
    );
}

#[test]
fn computed_address_costs_a_cycle() {
    // ADD.W R0, R0, #1; LDR R2, [R0]; NOP.
    assert_eq!(cycles(NO_WAIT, &[0xf100, 0x0004, 0x6802, NOP], 2, &[(0, RAM)]), 4);
}

#[test]
fn multiple_transfers_cost_one_each() {
    // LDMIA R3!, {R0, R1, R2}; PUSH {R0, R1, LR}; POP {R0, R1, PC}.
    assert_eq!(cycles(NO_WAIT, &[0xcb07, NOP], 1, &[(3, RAM)]), 4);
    assert_eq!(cycles(NO_WAIT, &[0xb503, NOP], 1, &[]), 4);
    assert_eq!(cycles(NO_WAIT, &[0xb503, 0xbd03], 2, &[(14, CODE | 1)]), 4 + 4 + 3);
}

#[test]
fn taken_branch_refills_the_pipeline() {
    // MOVS R0, #1; BNE .+8, and CBZ R0.
    assert_eq!(cycles(NO_WAIT, &[0x2001, 0xd102], 2, &[]), 1 + 2);
    assert_eq!(cycles(NO_WAIT, &[0x2000, 0xd102], 2, &[]), 1 + 1);
    assert_eq!(cycles(NO_WAIT, &[0xb110], 1, &[(0, 0)]), 2);
}

#[test]
fn division_ends_early() {
    let sdiv = [0xfb91, 0xf0f2, NOP];
    assert_eq!(cycles(NO_WAIT, &sdiv, 1, &[(1, 1), (2, 100)]), 2);
    assert_eq!(cycles(NO_WAIT, &sdiv, 1, &[(1, 0x7fff_ffff), (2, 1)]), 12);
    assert_eq!(cycles(NO_WAIT, &sdiv, 1, &[(1, 5), (2, 0)]), 2);
}

#[test]
fn exception_entry_takes_twelve_cycles() {
    let mut board = Board::new(&[NOP; 4]);
    board.core.set_timing(Timing::CortexM4(NO_WAIT));
    board.set_handler(2, &[0x4770]);
    board.core.pend_nmi();
    board.step(1);
    // BX LR returns in ten.
    assert_eq!(board.core.cycle(), 12 + 10);
    assert_eq!(board.core.pc(), CODE);
}

#[test]
fn prefetch_hides_wait_states_of_straight_code() {
    let slow = FlashTiming {
        wait_states: 5,
        ..NO_WAIT
    };
    let blind = FlashTiming {
        prefetch: false,
        ..slow
    };
    let code = [NOP; 33];
    // Five lines: the first waits in full. With prefetch, the next one has been under way for eight instructions.
    assert_eq!(cycles(slow, &code, 32, &[]), 32 + 5);
    assert_eq!(cycles(blind, &code, 32, &[]), 32 + 4 * 5);
}

#[test]
fn cache_keeps_a_loop() {
    let slow = FlashTiming {
        wait_states: 5,
        ..NO_WAIT
    };
    let buffer = FlashTiming {
        code_lines: 1,
        prefetch: false,
        ..slow
    };
    // 8 NOPs, and B back to the first: two lines.
    let mut code = vec![NOP; 8];
    code.push(0xe7f6);
    assert_eq!(
        cycles(
            FlashTiming {
                prefetch: false,
                ..slow
            },
            &code,
            90,
            &[]
        ),
        10 * 10 + 2 * 5
    );
    assert_eq!(cycles(buffer, &code, 90, &[]), 10 * 10 + 20 * 5);
}

#[test]
fn one_cycle_model_counts_instructions() {
    let mut board = Board::new(&[0xcb07, 0xb503, 0xfb91, 0xf0f2, NOP]);
    board.set(3, RAM);
    board.step(4);
    assert_eq!((board.core.cycle(), board.core.instructions()), (4, 4));
}
