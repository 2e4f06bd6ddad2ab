//! Instructions by the manual's pseudo-code, at the edges. Literals follow from ARM DDI 0403E, A7.7.

use armwire_virtual_board::core::{Refusal, Register, Stop};

use crate::board::{Board, CODE, RAM, STACK};

/// Executes one instruction with R0 to R3 and flags set. Returns R0 and the flags.
fn execute(code: &[u16], registers: [u32; 4], nzcv: u32) -> (u32, u32) {
    let mut board = Board::new(code);
    for (number, value) in (0..).zip(registers) {
        board.set(number, value);
    }
    board.set_nzcv(nzcv);
    assert_eq!(board.step(1), Stop::Deadline);
    assert_eq!(board.core.pc(), CODE + 2 * code.len() as u32);
    (board.r(0), board.nzcv())
}

/// APSR.Q after one instruction.
fn saturates(code: &[u16], registers: [u32; 4]) -> (u32, bool) {
    let mut board = Board::new(code);
    for (number, value) in (0..).zip(registers) {
        board.set(number, value);
    }
    board.step(1);
    (board.r(0), board.core.register(Register::Xpsr) >> 27 & 1 != 0)
}

#[test]
fn additions_set_carry_and_overflow() {
    let [adds, adcs] = [0x1840, 0x4148];
    assert_eq!(execute(&[adds], [0x7fff_ffff, 1, 0, 0], 0), (0x8000_0000, 0b1001));
    assert_eq!(execute(&[adds], [0xffff_ffff, 1, 0, 0], 0), (0, 0b0110));
    assert_eq!(execute(&[adds], [0x8000_0000, 0x8000_0000, 0, 0], 0), (0, 0b0111));
    assert_eq!(execute(&[adcs], [0xffff_ffff, 0, 0, 0], 0b0010), (0, 0b0110));
    assert_eq!(
        execute(&[adcs], [0x7fff_ffff, 0xffff_ffff, 0, 0], 0b0010),
        (0x7fff_ffff, 0b0010)
    );
}

#[test]
fn subtractions_carry_the_inverse_borrow() {
    let [subs, sbcs, negs] = [0x1a40, 0x4188, 0x4240];
    assert_eq!(execute(&[subs], [0, 0, 0, 0], 0), (0, 0b0110));
    assert_eq!(execute(&[subs], [0, 1, 0, 0], 0), (0xffff_ffff, 0b1000));
    assert_eq!(execute(&[subs], [0x8000_0000, 1, 0, 0], 0), (0x7fff_ffff, 0b0011));
    assert_eq!(execute(&[sbcs], [5, 5, 0, 0], 0), (0xffff_ffff, 0b1000));
    assert_eq!(execute(&[sbcs], [5, 5, 0, 0], 0b0010), (0, 0b0110));
    assert_eq!(execute(&[negs], [0x8000_0000, 0, 0, 0], 0), (0x8000_0000, 0b1001));
}

#[test]
fn register_shifts_use_the_lowest_byte() {
    let [lsls, lsrs, asrs, rors] = [0x4088, 0x40c8, 0x4108, 0x41c8];
    assert_eq!(execute(&[lsls], [1, 0x100, 0, 0], 0b0010), (1, 0b0010));
    assert_eq!(execute(&[lsls], [1, 32, 0, 0], 0), (0, 0b0110));
    assert_eq!(execute(&[lsls], [1, 33, 0, 0], 0b0010), (0, 0b0100));
    assert_eq!(execute(&[lsrs], [0x8000_0000, 32, 0, 0], 0), (0, 0b0110));
    assert_eq!(execute(&[asrs], [0x8000_0000, 255, 0, 0], 0), (0xffff_ffff, 0b1010));
    assert_eq!(execute(&[rors], [0x8000_0001, 32, 0, 0], 0), (0x8000_0001, 0b1010));
}

#[test]
fn immediate_shifts_of_zero_mean_thirty_two() {
    assert_eq!(execute(&[0x0800], [0x8000_0000, 0, 0, 0], 0), (0, 0b0110));
    assert_eq!(execute(&[0x1000], [0x8000_0000, 0, 0, 0], 0), (0xffff_ffff, 0b1010));
    // LSL of zero is MOVS, which leaves the carry. RRX takes it.
    assert_eq!(
        execute(&[0x0000], [0x8000_0000, 0, 0, 0], 0b0010),
        (0x8000_0000, 0b1010)
    );
    assert_eq!(execute(&[0xea4f, 0x0030], [1, 0, 0, 0], 0b0010), (0x8000_0000, 0b0010));
}

#[test]
fn rotated_constants_set_the_carry() {
    let [movs, ands, ands_byte] = [[0xf05f, 0x4000], [0xf010, 0x407f], [0xf010, 0x00ff]];
    assert_eq!(execute(&movs, [0; 4], 0), (0x8000_0000, 0b1010));
    assert_eq!(execute(&ands, [0x1234_5678, 0, 0, 0], 0), (0x1200_0000, 0b0010));
    assert_eq!(execute(&ands_byte, [0x1234_5600, 0, 0, 0], 0b0011), (0, 0b0111));
}

#[test]
fn bit_fields_move_whole_fields() {
    assert_eq!(execute(&[0xf361, 0x200b], [0xffff_ffff, 0x2, 0, 0], 0).0, 0xffff_f2ff);
    assert_eq!(execute(&[0xf36f, 0x100b], [0xffff_ffff, 0, 0, 0], 0).0, 0xffff_f00f);
    assert_eq!(execute(&[0xf3c1, 0x1007], [0, 0xabcd_ef98, 0, 0], 0).0, 0xf9);
    assert_eq!(execute(&[0xf341, 0x1007], [0, 0xabcd_ef98, 0, 0], 0).0, 0xffff_fff9);
    assert_eq!(execute(&[0xf341, 0x001f], [0, 0x8000_0001, 0, 0], 0).0, 0x8000_0001);
}

#[test]
fn saturation_sets_the_sticky_flag() {
    let [ssat, usat, ssat_shifted, qadd] = [[0xf301, 0x0007], [0xf381, 0x0008], [0xf301, 0x100f], [0xfa82, 0xf081]];
    assert_eq!(saturates(&ssat, [0, 127, 0, 0]), (127, false));
    assert_eq!(saturates(&ssat, [0, 128, 0, 0]), (127, true));
    assert_eq!(saturates(&ssat, [0, 0xffff_ff7f, 0, 0]), (0xffff_ff80, true));
    assert_eq!(saturates(&usat, [0, 0xffff_ffff, 0, 0]), (0, true));
    assert_eq!(saturates(&usat, [0, 256, 0, 0]), (255, true));
    assert_eq!(saturates(&ssat_shifted, [0, 0x800, 0, 0]), (0x7fff, true));
    assert_eq!(saturates(&qadd, [0, 0x7fff_ffff, 1, 0]), (0x7fff_ffff, true));
    assert_eq!(saturates(&qadd, [0, 0x8000_0000, 0xffff_ffff, 0]), (0x8000_0000, true));
}

#[test]
fn divisions_truncate_and_wrap() {
    let [sdiv, udiv] = [[0xfb91, 0xf0f2], [0xfbb1, 0xf0f2]];
    assert_eq!(execute(&sdiv, [0, 0xffff_fff9, 2, 0], 0).0, 0xffff_fffd);
    assert_eq!(execute(&sdiv, [0, 0x8000_0000, 0xffff_ffff, 0], 0).0, 0x8000_0000);
    assert_eq!(execute(&sdiv, [7, 5, 0, 0], 0).0, 0);
    assert_eq!(execute(&udiv, [0, 0x8000_0000, 0xffff_ffff, 0], 0).0, 0);
    assert_eq!(execute(&udiv, [0, 0xffff_ffff, 0x10, 0], 0).0, 0x0fff_ffff);
}

#[test]
fn long_multiplications_fill_two_registers() {
    let mut board = Board::new(&[0xfba2, 0x0103, 0xfbc2, 0x0103]);
    board.set(2, 0xffff_ffff);
    board.set(3, 0xffff_ffff);
    // UMULL, then SMLAL adds 1 to it.
    board.step(1);
    assert_eq!((board.r(0), board.r(1)), (1, 0xffff_fffe));
    board.step(1);
    assert_eq!((board.r(0), board.r(1)), (2, 0xffff_fffe));
    assert_eq!(execute(&[0xfb01, 0x3012], [0, 3, 5, 7], 0).0, 0xffff_fff8);
}

#[test]
fn bytes_and_bits_are_reversed() {
    assert_eq!(execute(&[0xfab1, 0xf081], [0, 0, 0, 0], 0).0, 32);
    assert_eq!(execute(&[0xfa91, 0xf0a1], [0, 0x0000_0001, 0, 0], 0).0, 0x8000_0000);
    assert_eq!(execute(&[0xbac8], [0, 0x1234_5680, 0, 0], 0).0, 0xffff_8056);
}

#[test]
fn parallel_addition_selects_by_its_carries() {
    let mut board = Board::new(&[0xfa81, 0xf042, 0xfaa1, 0xf082]);
    board.set(1, 0xff01_80ff);
    board.set(2, 0x0101_8001);
    board.step(1);
    // UADD8: carries out of bytes 0, 1 and 3.
    assert_eq!(board.r(0), 0x0002_0000);
    assert_eq!(board.core.register(Register::Xpsr) >> 16 & 15, 0b1011);
    board.step(1);
    assert_eq!(board.r(0), 0xff01_80ff);
}

#[test]
fn it_blocks_execute_by_their_conditions() {
    // ITE EQ: MOVEQ R0, #1; MOVNE R0, #2.
    for (nzcv, expected) in [(0b0100, 1), (0b0000, 2)] {
        let mut board = Board::new(&[0xbf0c, 0x2001, 0x2002]);
        board.set_nzcv(nzcv);
        board.step(3);
        // In the block, MOV leaves the flags.
        assert_eq!((board.r(0), board.nzcv()), (expected, nzcv));
    }
}

#[test]
fn it_block_follows_flags_that_it_changes() {
    // ITTTT EQ: MOVEQ R0, #1; ADDEQ R1, #1; CMPEQ R1, #9; MOVEQ R2, #3.
    let mut board = Board::new(&[0xbf01, 0x2001, 0x3101, 0x2909, 0x2203]);
    board.set_nzcv(0b0100);
    board.set(1, 0);
    board.step(5);
    assert_eq!((board.r(0), board.r(1), board.r(2)), (1, 1, 0));
    assert_eq!(board.core.register(Register::Xpsr) & 0x0600_fc00, 0);
}

#[test]
fn instruction_is_decoded_for_its_it_block() {
    // MOVS R0, #0 outside a block; then a jump over an IT instruction into the same place within one.
    let mut board = Board::new(&[0xbf18, 0x2000]);
    board.set(15, CODE + 2);
    board.step(1);
    assert_eq!(board.nzcv(), 0b0100);
    board.set_nzcv(0);
    board.set(0, 7);
    board.set(15, CODE);
    board.step(2);
    assert_eq!((board.r(0), board.nzcv()), (0, 0));
}

#[test]
fn dual_accesses_index_their_base() {
    let mut board = Board::new(&[0xe9d2, 0x0102, 0xe8f2, 0x0102, 0xe962, 0x0102]);
    for at in 0..4 {
        board.set_word(RAM + 0x100 + 4 * at, 0x11 * (at + 1));
    }
    board.set(2, RAM + 0x100);
    board.step(1);
    assert_eq!((board.r(0), board.r(1), board.r(2)), (0x33, 0x44, RAM + 0x100));
    board.step(1);
    assert_eq!((board.r(0), board.r(1), board.r(2)), (0x11, 0x22, RAM + 0x108));
    board.set(2, RAM + 0x110);
    board.step(1);
    assert_eq!(
        (board.word(RAM + 0x108), board.word(RAM + 0x10c), board.r(2)),
        (0x11, 0x22, RAM + 0x108)
    );
}

#[test]
fn loads_index_and_extend() {
    let mut board = Board::new(&[0xf851, 0x0f04, 0xf851, 0x0904, 0xf991, 0x0000, 0xf9b1, 0x0000]);
    board.set_word(RAM + 0x104, 0x1234_8081);
    board.set(1, RAM + 0x100);
    board.step(1);
    assert_eq!((board.r(0), board.r(1)), (0x1234_8081, RAM + 0x104));
    board.step(1);
    assert_eq!((board.r(0), board.r(1)), (0x1234_8081, RAM + 0x100));
    board.set(1, RAM + 0x104);
    board.step(1);
    assert_eq!(board.r(0), 0xffff_ff81);
    board.step(1);
    assert_eq!(board.r(0), 0xffff_8081);
}

#[test]
fn stack_grows_down_and_returns() {
    // PUSH {R0, R1, LR}; POP {R0, R1, PC}.
    let mut board = Board::new(&[0xb503, 0xbd03]);
    board.set(0, 10);
    board.set(1, 11);
    board.set(14, (CODE + 0x20) | 1);
    board.step(1);
    assert_eq!(board.r(13), STACK - 12);
    let pushed = [0, 4, 8].map(|at| board.word(STACK - 12 + at));
    assert_eq!(pushed, [10, 11, (CODE + 0x20) | 1]);
    board.set_word(STACK - 12, 20);
    board.step(1);
    assert_eq!(
        (board.r(0), board.r(1), board.r(13), board.core.pc()),
        (20, 11, STACK, CODE + 0x20)
    );
}

#[test]
fn table_branches_count_halfwords() {
    // TBB [PC, R0] with the table after it.
    let mut board = Board::new(&[0xe8df, 0xf000, 0x0402]);
    board.set(0, 1);
    board.step(1);
    assert_eq!(board.core.pc(), CODE + 4 + 2 * 4);
    // TBH [R1, R0, LSL #1].
    let mut board = Board::new(&[0xe8d1, 0xf010]);
    board.set_word(RAM + 0x100, 0x1000_0003);
    board.set(0, 1);
    board.set(1, RAM + 0x100);
    board.step(1);
    assert_eq!(board.core.pc(), CODE + 4 + 2 * 0x1000);
}

#[test]
fn exclusive_store_needs_its_load() {
    // LDREX R0, [R1]; STREX R2, R0, [R1]; STREX R2, R0, [R1].
    let mut board = Board::new(&[0xe851, 0x0f00, 0xe841, 0x0200, 0xe841, 0x0200]);
    board.set(1, RAM + 0x100);
    board.set(2, 9);
    board.step(1);
    board.set(0, 77);
    board.step(1);
    assert_eq!((board.r(2), board.word(RAM + 0x100)), (0, 77));
    board.set(0, 78);
    board.step(1);
    assert_eq!((board.r(2), board.word(RAM + 0x100)), (1, 77));
}

#[test]
fn clrex_breaks_the_reservation() {
    // LDREXB R0, [R1]; CLREX; STREXB R2, R0, [R1].
    let mut board = Board::new(&[0xe8d1, 0x0f4f, 0xf3bf, 0x8f2f, 0xe8c1, 0x0f42]);
    board.set(1, RAM + 0x101);
    board.set(2, 9);
    board.step(3);
    assert_eq!(board.r(2), 1);
}

#[test]
fn program_counter_reads_four_ahead() {
    assert_eq!(execute(&[0x4678], [0; 4], 0).0, CODE + 4);
    // BL links to the next instruction.
    let mut board = Board::new(&[0xf000, 0xf802]);
    board.step(1);
    assert_eq!((board.core.pc(), board.r(14)), (CODE + 8, CODE + 4 + 1));
}

#[test]
fn compare_and_branch_leaves_the_flags() {
    // CBZ R0, .+8.
    for (value, target) in [(0, CODE + 8), (1, CODE + 2)] {
        let mut board = Board::new(&[0xb110]);
        board.set(0, value);
        board.set_nzcv(0b1011);
        board.step(1);
        assert_eq!((board.core.pc(), board.nzcv()), (target, 0b1011));
    }
}

#[test]
fn special_registers_keep_their_bits() {
    // MSR BASEPRI, R0; MSR BASEPRI_MAX, R0; MRS R0, BASEPRI.
    let mut board = Board::new(&[0xf380, 0x8811, 0xf380, 0x8812, 0xf3ef, 0x8011]);
    board.set(0, 0x5f);
    board.step(1);
    assert_eq!(board.core.register(Register::Basepri), 0x50);
    board.set(0, 0x60);
    board.step(1);
    assert_eq!(board.core.register(Register::Basepri), 0x50);
    board.step(1);
    assert_eq!(board.r(0), 0x50);
    // MSR APSR_nzcvq, R0; MRS R0, APSR.
    let (apsr, _) = execute(&[0xf3ef, 0x8000], [0; 4], 0b1010);
    assert_eq!(apsr, 0xa000_0000);
}

#[test]
fn floating_point_is_refused_by_name() {
    // STR R0, [R1] to CPACR, then the instruction.
    for (code, name) in [
        ([0xee30, 0x0a81], "VADD"),
        ([0xed2d, 0x0a04], "VPUSH"),
        ([0xecbd, 0x0a04], "VPOP"),
        ([0xed90, 0x0a00], "VLDR"),
        ([0xed80, 0x0a00], "VSTR"),
        ([0xeca0, 0x0a04], "VSTM"),
        ([0xeef1, 0xfa10], "VMRS"),
        ([0xee00, 0x0a10], "VMOV"),
        ([0xeeb7, 0x0a00], "VMOV"),
        ([0xec41, 0x0a10], "VMOV"),
        ([0xeeb1, 0x0ae0], "VSQRT"),
        ([0xeeb0, 0x0ae0], "VABS"),
        ([0xeeb1, 0x0a60], "VNEG"),
        ([0xeebd, 0x0ae0], "VCVT"),
        ([0xeeb5, 0x0a40], "VCMP"),
        ([0xeea0, 0x0a81], "VFMA"),
        ([0xee80, 0x0a81], "VDIV"),
        ([0xee20, 0x0a81], "VMUL"),
    ] {
        let mut board = Board::new(&[0x6008, code[0], code[1]]);
        board.set(0, 0x00f0_0000);
        board.set(1, 0xe000_ed88);
        assert_eq!(board.step(2), Stop::Refused(Refusal::FloatingPoint(name)));
        assert_eq!(board.core.pc(), CODE + 2);
    }
}

#[test]
fn changed_flash_is_decoded_again() {
    let mut board = Board::new(&[0x2001]);
    board.step(1);
    assert_eq!(board.r(0), 1);
    board.set_code(CODE, &[0x3005]);
    board.set(15, CODE);
    board.step(1);
    assert_eq!(board.r(0), 6);
}

#[test]
fn stored_code_in_ram_is_decoded_again() {
    // From RAM: MOVS R0, #1. Then STRH R0, [R1] replaces it by ADDS R0, #1.
    let mut board = Board::new(&[0x8008]);
    board.set_word(RAM + 0x100, 0x2001);
    board.set(15, RAM + 0x100);
    board.step(1);
    assert_eq!(board.r(0), 1);
    board.set(0, 0x3001);
    board.set(1, RAM + 0x100);
    board.set(15, CODE);
    board.step(1);
    board.set(15, RAM + 0x100);
    board.step(1);
    assert_eq!(board.r(0), 0x3002);
}

#[test]
fn store_over_the_next_instruction_takes_effect() {
    // STR R1, [R2], which writes MOVS R0, #9 and ADDS R0, #1 over MOVW R0, #5; B .
    let mut board = Board::new(&[]);
    for (at, word) in [(0, 0xbf00_6011), (4, 0x0005_f240), (8, 0xbf00_e7fe)] {
        board.set_word(RAM + at, word);
    }
    for (stored, result) in [(0x3001_2009, 10), (0x0005_f240, 5), (0x3001_2009, 10)] {
        board.set(1, stored);
        board.set(2, RAM + 4);
        board.set(15, RAM);
        board.run(20);
        assert_eq!((board.r(0), board.core.pc()), (result, RAM + 8));
    }
}

#[test]
fn breakpoint_stops_before_its_instruction() {
    // MOVS R0, #1; ADDS R0, #1; B .-2.
    let mut board = Board::new(&[0x2001, 0x3001, 0xe7fd]);
    board.core.set_breakpoint(CODE + 2);
    for round in 1..4 {
        assert_eq!(board.run(100), Stop::Breakpoint);
        assert_eq!((board.core.pc(), board.r(0)), (CODE + 2, round));
    }
    board.core.clear_breakpoint(CODE + 2);
    assert_eq!(board.run(100), Stop::Deadline);
}

#[test]
fn profile_counts_each_instruction() {
    // MOVS R0, #1; ADDS R0, #1; B .-2.
    let mut board = Board::new(&[0x2001, 0x3001, 0xe7fd]);
    board.step(3);
    assert!(board.core.take_profile().is_empty());
    board.step(6);
    let profile = board.core.take_profile();
    assert_eq!(profile.into_iter().collect::<Vec<_>>(), [(CODE + 2, 3), (CODE + 4, 3)]);
}

#[test]
fn reset_takes_stack_and_program_from_the_table() {
    let board = Board::new(&[]);
    assert_eq!((board.r(13), board.core.pc(), board.r(14)), (STACK, CODE, u32::MAX));
    assert_eq!(board.core.register(Register::Control), 0);
    // A vector that leads to where nothing may be executed.
    let mut lost = Board::new(&[]);
    lost.core.memory_mut().program(4, &[0xff; 4]).unwrap();
    lost.core.reset(&mut lost.bus);
    assert_eq!(lost.core.pc(), 0xffff_fffe);
    lost.step(1);
    let [cfsr, hfsr, ..] = lost.core.fault_status();
    assert_eq!((lost.exception(), cfsr, hfsr), (3, 1, 1 << 30));
}
