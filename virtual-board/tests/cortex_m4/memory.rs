//! Protection, aliases and alignment, by ARM DDI 0403E, B3.5 and A3.2.

use armwire_virtual_board::core::{Purpose, Width};

use crate::board::{Board, CODE, PERIPHERAL, RAM, STACK};

const LDR_R0_R1: u16 = 0x6808;
const STR_R0_R1: u16 = 0x6008;

const MPU_CTRL: u32 = 0xe000_ed94;
const MPU_RBAR: u32 = 0xe000_ed9c;
const MPU_RASR: u32 = 0xe000_eda0;
const SHCSR: u32 = 0xe000_ed24;

/// Executes STR R0, [R1] at the program's start for each of these, then the program.
fn board_with(writes: &[(u32, u32)], code: &[u16]) -> Board {
    let mut board = Board::new(&[STR_R0_R1]);
    for (address, value) in writes {
        board.set(0, *value);
        board.set(1, *address);
        board.set(15, CODE);
        board.step(1);
    }
    board.set_code(CODE, code);
    board.set(15, CODE);
    board
}

/// A region without access, 32 bytes at the bottom of the stack, over the default map.
fn guarded(code: &[u16]) -> Board {
    let region = [
        (SHCSR, 1 << 16),
        (MPU_RBAR, (RAM + 0x200) | 0x10),
        (MPU_RASR, 4 << 1 | 1),
        (MPU_CTRL, 0b101),
    ];
    board_with(&region, code)
}

#[test]
fn guard_region_faults_reads_and_writes() {
    for (code, address) in [(LDR_R0_R1, RAM + 0x200), (STR_R0_R1, RAM + 0x21c)] {
        let mut board = guarded(&[code]);
        board.set(1, address);
        board.step(1);
        board.step(1);
        let [cfsr, _, mmfar, _] = board.core.fault_status();
        assert_eq!((board.exception(), cfsr, mmfar), (4, 0x82, address));
        assert_eq!(board.word(STACK - 32 + 24), CODE);
    }
}

#[test]
fn memory_beside_the_guard_is_open() {
    for address in [RAM + 0x1fc, RAM + 0x220, CODE, PERIPHERAL] {
        let mut board = guarded(&[LDR_R0_R1]);
        board.set(1, address);
        board.step(1);
        assert_eq!((board.exception(), board.core.pc()), (0, CODE + 2), "{address:#x}");
    }
}

#[test]
fn push_into_the_guard_faults_completely() {
    // PUSH {R0, R1, LR}: the lowest word lies in the guard.
    let mut board = guarded(&[0xb503]);
    board.set(13, RAM + 0x228);
    board.step(1);
    assert_eq!(board.core.fault_status()[0], 0x82);
    assert_eq!(board.core.fault_status()[2], RAM + 0x21c);
}

#[test]
fn stacking_into_the_guard_is_reported() {
    // SVC.
    let mut board = guarded(&[0xdf00]);
    board.set(13, RAM + 0x228);
    board.step(1);
    board.run(3);
    assert_eq!((board.exception(), board.core.fault_status()[0]), (4, 1 << 4));
}

#[test]
fn region_without_execution_faults_the_fetch() {
    // The whole RAM: full access, XN.
    let region = [
        (SHCSR, 1 << 16),
        (MPU_RBAR, RAM | 0x11),
        (MPU_RASR, 1 << 28 | 3 << 24 | 11 << 1 | 1),
        (MPU_CTRL, 0b101),
    ];
    let mut board = board_with(&region, &[]);
    board.set_word(RAM + 0x100, 0x2001);
    board.set(15, RAM + 0x100);
    board.step(1);
    assert_eq!((board.exception(), board.core.fault_status()[0]), (4, 1));
}

#[test]
fn subregion_that_is_off_does_not_count() {
    // 256 bytes without access, their second eighth off.
    let region = [
        (MPU_RBAR, (RAM + 0x200) | 0x10),
        (MPU_RASR, 1 << 9 | 7 << 1 | 1),
        (MPU_CTRL, 0b101),
    ];
    for (address, faults) in [
        (RAM + 0x21c, true),
        (RAM + 0x220, false),
        (RAM + 0x23c, false),
        (RAM + 0x240, true),
    ] {
        let mut board = board_with(&region, &[LDR_R0_R1]);
        board.set(1, address);
        board.step(1);
        assert_eq!(board.core.fault_status()[0] != 0, faults, "{address:#x}");
    }
}

#[test]
fn bit_band_alias_is_one_bit() {
    let mut board = Board::new(&[STR_R0_R1, LDR_R0_R1]);
    board.set_word(RAM + 0x104, 0xffff_0000);
    // Bit 5 of the word at RAM + 0x104.
    board.set(1, 0x2200_0000 + 0x104 * 32 + 5 * 4);
    board.set(0, 0xffff_ffff);
    board.step(1);
    assert_eq!(board.word(RAM + 0x104), 0xffff_0020);
    board.set(0, 9);
    board.step(1);
    assert_eq!(board.r(0), 1);
    // And of a peripheral's register, read and written as a word.
    board.bus.values.insert(PERIPHERAL + 8, 0x81);
    board.set(1, 0x4200_0000 + 8 * 32 + 7 * 4);
    board.set(0, 0);
    board.set(15, CODE);
    board.step(1);
    assert_eq!(board.bus.values[&(PERIPHERAL + 8)], 0x01);
}

#[test]
fn unaligned_word_crosses_two_words() {
    let mut board = Board::new(&[LDR_R0_R1, STR_R0_R1]);
    board.set_word(RAM + 0x100, 0x4433_2211);
    board.set_word(RAM + 0x104, 0x8877_6655);
    board.set(1, RAM + 0x103);
    board.step(1);
    assert_eq!(board.r(0), 0x7766_5544);
    board.set(0, 0xa1b2_c3d4);
    board.step(1);
    assert_eq!(
        (board.word(RAM + 0x100), board.word(RAM + 0x104)),
        (0xd433_2211, 0x88a1_b2c3)
    );
}

#[test]
fn unaligned_multiple_and_device_accesses_fault() {
    // LDMIA R3!, {R0, R1, R2}; LDRD R0, R1, [R2, #8]; LDR R0, [R1] of a peripheral.
    for code in [vec![0xcb07], vec![0xe9d2, 0x0102], vec![LDR_R0_R1]] {
        let mut board = Board::new(&code);
        board.set(1, PERIPHERAL + 2);
        board.set(2, RAM + 0x102);
        board.set(3, RAM + 0x102);
        board.step(1);
        assert_eq!(board.core.fault_status()[0], 1 << 24);
        assert_eq!(board.r(3), RAM + 0x102);
    }
}

#[test]
fn store_to_flash_goes_to_the_bus() {
    let mut board = Board::new(&[STR_R0_R1]);
    board.set(1, CODE);
    board.step(1);
    assert_eq!(board.bus.accesses.len(), 1);
    assert_eq!(board.core.fault_status()[3], CODE);
}

#[test]
fn flash_reads_go_to_the_bus_on_request() {
    let mut board = Board::new(&[LDR_R0_R1]);
    board.core.memory_mut().set_flash_reads_on_bus(true);
    board.set(1, CODE);
    // The instruction's fetch, which fails here.
    board.step(1);
    let (access, _) = board.bus.accesses[0];
    assert_eq!((access.address, access.width.bytes()), (CODE, 2));
}

#[test]
fn debugger_reads_and_writes_without_time() {
    let mut board = Board::new(&[LDR_R0_R1]);
    let (core, bus) = (&mut board.core, &mut board.bus);
    assert_eq!(core.debug_write(bus, RAM + 0x100, 0x1234, Width::Half), Some(()));
    assert_eq!(core.debug_read(bus, RAM + 0x100, Width::Byte), Some(0x34));
    assert_eq!(core.debug_read(bus, RAM + 0x101, Width::Word), None);
    assert_eq!(core.debug_read(bus, 0x6000_0000, Width::Word), None);
    // CPUID, and a peripheral's register.
    assert_eq!(core.debug_read(bus, 0xe000_ed00, Width::Word), Some(0x410f_c241));
    assert_eq!(core.debug_write(bus, PERIPHERAL, 7, Width::Word), Some(()));
    assert_eq!(core.debug_read(bus, PERIPHERAL, Width::Word), Some(7));
    assert!(bus.accesses.iter().all(|(access, _)| access.purpose == Purpose::Debug));
    assert_eq!((core.cycle(), core.pc(), core.fault_status()), (0, CODE, [0; 4]));
}

#[test]
fn clone_is_a_snapshot() {
    // STR R0, [R1]; LDR R0, [R1].
    let mut board = Board::new(&[STR_R0_R1, LDR_R0_R1]);
    board.set(0, 5);
    board.set(1, RAM + 0x100);
    let snapshot = board.core.clone();
    board.step(1);
    assert_eq!(board.word(RAM + 0x100), 5);
    board.core = snapshot;
    assert_eq!(
        (board.word(RAM + 0x100), board.core.pc(), board.core.cycle()),
        (0, CODE, 0)
    );
}
