//! Exceptions, faults, sleep and reset, by ARM DDI 0403E, B1.5.

use armwire_virtual_board::core::{Refusal, Register, Stop};

use crate::board::{BELL, Board, CODE, PERIPHERAL, RAM, STACK, handler};

const NOP: u16 = 0xbf00;
const LOOP: u16 = 0xe7fe;
const BX_LR: u16 = 0x4770;
const SVC: u16 = 0xdf00;
const WFI: u16 = 0xbf30;
const WFE: u16 = 0xbf20;
const SEV: u16 = 0xbf40;
const CPSID_I: u16 = 0xb672;
const CPSIE_I: u16 = 0xb662;
const UDF: u16 = 0xde00;
const STR_R0_R1: u16 = 0x6008;
const LDR_R0_R1: u16 = 0x6808;

const AIRCR: u32 = 0xe000_ed0c;
const CCR: u32 = 0xe000_ed14;
const SCR: u32 = 0xe000_ed10;
const SHCSR: u32 = 0xe000_ed24;
const ICSR: u32 = 0xe000_ed04;
const VTOR: u32 = 0xe000_ed08;
const ISER: u32 = 0xe000_e100;
const IPR: u32 = 0xe000_e400;

impl Board {
    /// Writes a system register as a program does, from RAM: nothing else changes.
    fn write(&mut self, address: u32, value: u32) {
        let (r0, r1, pc) = (self.r(0), self.r(1), self.core.pc());
        self.set_word(RAM + 0xf00, STR_R0_R1.into());
        self.set(0, value);
        self.set(1, address);
        self.set(15, RAM + 0xf00);
        assert_eq!(self.step(1), Stop::Deadline);
        self.set(0, r0);
        self.set(1, r1);
        self.set(15, pc);
    }

    fn read(&mut self, address: u32) -> u32 {
        let (r0, r1, pc) = (self.r(0), self.r(1), self.core.pc());
        self.set_word(RAM + 0xf00, LDR_R0_R1.into());
        self.set(1, address);
        self.set(15, RAM + 0xf00);
        assert_eq!(self.step(1), Stop::Deadline);
        let value = self.r(0);
        self.set(0, r0);
        self.set(1, r1);
        self.set(15, pc);
        value
    }

    /// Enables an interrupt with this priority.
    fn enable(&mut self, interrupt: u32, priority: u8) {
        self.write(ISER + interrupt / 32 * 4, 1 << (interrupt % 32));
        let register = IPR + interrupt / 4 * 4;
        let shift = 8 * (interrupt % 4);
        let others = self.read(register) & !(0xff << shift);
        self.write(register, others | u32::from(priority) << shift);
    }
}

#[test]
fn entry_stacks_eight_registers() {
    let mut board = Board::new(&[NOP, NOP]);
    board.enable(5, 0);
    for number in [0, 1, 2, 3, 12] {
        board.set(number, 0x100 + u32::from(number));
    }
    board.set(14, 0xabcd);
    board.set_nzcv(0b0110);
    board.core.set_interrupt_line(5, true);
    board.step(1);
    assert_eq!((board.exception(), board.core.pc()), (21, handler(21)));
    assert_eq!((board.r(13), board.r(14)), (STACK - 32, 0xffff_fff9));
    let frame: Vec<u32> = (0..8).map(|at| board.word(STACK - 32 + 4 * at)).collect();
    assert_eq!(frame, [0x100, 0x101, 0x102, 0x103, 0x10c, 0xabcd, CODE, 0x6100_0000]);
}

#[test]
fn return_restores_the_stacked_registers() {
    // The handler changes R0 and the flags: MOVS R0, #0; BX LR.
    let mut board = Board::new(&[NOP, LOOP]);
    board.set_handler(16, &[0x2000, BX_LR]);
    board.enable(0, 0);
    board.set(0, 5);
    board.set_nzcv(0b1011);
    board.core.pend_interrupt(0);
    board.step(2);
    assert_eq!((board.exception(), board.core.pc(), board.r(13)), (0, CODE, STACK));
    assert_eq!((board.r(0), board.nzcv()), (5, 0b1011));
}

#[test]
fn misaligned_stack_is_padded() {
    let mut board = Board::new(&[NOP, LOOP]);
    board.set_handler(16, &[BX_LR]);
    board.enable(0, 0);
    board.set(13, STACK - 4);
    board.core.pend_interrupt(0);
    board.run(1);
    assert_eq!((board.r(13), board.word(STACK - 40 + 28) >> 9 & 1), (STACK - 40, 1));
    board.step(1);
    assert_eq!((board.exception(), board.r(13)), (0, STACK - 4));
}

#[test]
fn higher_priority_preempts_lower_waits() {
    let mut board = Board::new(&[NOP, LOOP]);
    board.enable(1, 0x40);
    board.enable(2, 0x20);
    board.enable(3, 0x40);
    board.core.pend_interrupt(1);
    board.step(1);
    assert_eq!(board.exception(), 17);
    board.core.pend_interrupt(3);
    board.step(3);
    assert_eq!(board.exception(), 17);
    board.core.pend_interrupt(2);
    board.step(1);
    assert_eq!(
        (board.exception(), board.r(14), board.r(13)),
        (18, 0xffff_fff1, STACK - 64)
    );
}

#[test]
fn lowest_number_wins_equal_priorities() {
    let mut board = Board::new(&[NOP, LOOP]);
    for interrupt in [9, 7, 8] {
        board.enable(interrupt, 0x30);
    }
    for interrupt in [9, 7, 8] {
        board.core.pend_interrupt(interrupt);
    }
    board.step(1);
    assert_eq!(board.exception(), 16 + 7);
}

#[test]
fn subpriority_orders_but_does_not_preempt() {
    let mut board = Board::new(&[NOP, LOOP]);
    // PRIGROUP 5: two bits of group priority.
    board.write(AIRCR, 0x05fa_0500);
    assert_eq!(board.read(AIRCR), 0xfa05_0500);
    board.enable(1, 0x70);
    board.enable(2, 0x40);
    board.enable(3, 0x30);
    board.core.pend_interrupt(1);
    board.step(1);
    board.core.pend_interrupt(2);
    board.step(2);
    assert_eq!(board.exception(), 17);
    board.core.pend_interrupt(3);
    board.step(1);
    assert_eq!(board.exception(), 19);
}

#[test]
fn pending_interrupt_is_tail_chained() {
    let mut board = Board::new(&[NOP, LOOP]);
    board.set_handler(17, &[BX_LR]);
    board.set_handler(18, &[NOP, BX_LR]);
    board.enable(1, 0x40);
    board.enable(2, 0x40);
    board.core.pend_interrupt(1);
    board.core.pend_interrupt(2);
    board.set(0, 3);
    board.step(1);
    // BX LR led right to the other handler, with the first one's frame.
    assert_eq!((board.exception(), board.core.pc()), (18, handler(18)));
    assert_eq!((board.r(13), board.r(14)), (STACK - 32, 0xffff_fff9));
    board.step(2);
    assert_eq!((board.exception(), board.core.pc(), board.r(0)), (0, CODE, 3));
}

#[test]
fn late_arrival_uses_the_stacked_frame() {
    let mut board = Board::new(&[NOP, LOOP]);
    board.enable(1, 0x40);
    board.enable(2, 0x20);
    board.core.pend_interrupt(1);
    // One cycle: the frame is stacked, the handler is not chosen.
    board.run(1);
    assert_eq!((board.exception(), board.r(13)), (0, STACK - 32));
    board.core.pend_interrupt(2);
    board.step(1);
    assert_eq!(
        (board.exception(), board.r(13), board.r(14)),
        (18, STACK - 32, 0xffff_fff9)
    );
}

#[test]
fn masks_hold_interrupts_back() {
    // CPSID I; NOP; CPSIE I; NOP.
    let mut board = Board::new(&[CPSID_I, NOP, CPSIE_I, NOP, LOOP]);
    board.enable(1, 0x40);
    board.step(1);
    board.core.pend_interrupt(1);
    board.step(1);
    assert_eq!((board.exception(), board.core.pc()), (0, CODE + 4));
    board.step(2);
    assert_eq!(board.exception(), 17);
    // BASEPRI holds back its own priority and below.
    let mut board = Board::new(&[NOP, NOP, LOOP]);
    board.enable(1, 0x40);
    board.enable(2, 0x30);
    board.core.set_register(Register::Basepri, 0x40);
    board.core.pend_interrupt(1);
    board.step(1);
    assert_eq!(board.exception(), 0);
    board.core.pend_interrupt(2);
    board.step(1);
    assert_eq!(board.exception(), 18);
}

#[test]
fn line_that_stays_high_pends_again() {
    let mut board = Board::new(&[NOP, LOOP]);
    board.set_handler(17, &[BX_LR]);
    board.enable(1, 0);
    board.core.set_interrupt_line(1, true);
    board.step(1);
    assert_eq!((board.exception(), board.core.pc()), (17, handler(17)));
    // Cleared in the handler: not again.
    board.core.set_interrupt_line(1, false);
    board.step(1);
    assert_eq!(board.exception(), 0);
}

#[test]
fn pulse_in_the_handler_pends_again() {
    let mut board = Board::new(&[NOP, LOOP]);
    board.set_handler(17, &[NOP, BX_LR]);
    board.enable(1, 0);
    board.core.pend_interrupt(1);
    board.step(1);
    board.core.pend_interrupt(1);
    board.step(1);
    assert_eq!((board.exception(), board.core.pc()), (17, handler(17)));
}

#[test]
fn it_state_survives_an_exception() {
    // ITTE EQ: MOVEQ R0, #1; MOVEQ R1, #1; MOVNE R0, #2.
    let mut board = Board::new(&[0xbf06, 0x2001, 0x2101, 0x2002, LOOP]);
    board.set_handler(16, &[0x2800, BX_LR]);
    board.enable(0, 0);
    board.set_nzcv(0b0100);
    board.step(2);
    board.core.pend_interrupt(0);
    board.step(2);
    assert_eq!((board.exception(), board.core.pc()), (0, CODE + 4));
    board.step(2);
    assert_eq!((board.r(0), board.r(1), board.core.pc()), (1, 1, CODE + 8));
}

#[test]
fn thread_returns_to_its_process_stack() {
    // MSR PSP, R0; MSR CONTROL, R1; ISB; NOP.
    let mut board = Board::new(&[0xf380, 0x8809, 0xf381, 0x8814, 0xf3bf, 0x8f6f, NOP, LOOP]);
    board.set_handler(16, &[BX_LR]);
    board.enable(0, 0);
    board.set(0, RAM + 0x400);
    board.set(1, 2);
    board.step(3);
    assert_eq!((board.r(13), board.core.register(Register::Msp)), (RAM + 0x400, STACK));
    board.core.pend_interrupt(0);
    board.core.run(&mut board.bus, board.core.cycle() + 1);
    assert_eq!(
        (board.r(14), board.core.register(Register::Psp)),
        (0xffff_fffd, RAM + 0x400 - 32)
    );
    board.step(1);
    assert_eq!((board.exception(), board.r(13)), (0, RAM + 0x400));
    assert_eq!(board.core.register(Register::Control), 2);
}

#[test]
fn unprivileged_thread_may_not_touch_the_system() {
    let mut board = Board::new(&[LDR_R0_R1]);
    board.core.set_register(Register::Control, 1);
    board.set(1, SCR);
    board.step(1);
    board.step(1);
    let [cfsr, hfsr, _, bfar] = board.core.fault_status();
    assert_eq!((board.exception(), cfsr, hfsr, bfar), (3, 0x8200, 1 << 30, SCR));
}

#[test]
fn supervisor_call_returns_behind_itself() {
    let mut board = Board::new(&[SVC, NOP, LOOP]);
    board.set_handler(11, &[BX_LR]);
    board.step(1);
    board.step(1);
    assert_eq!((board.exception(), board.core.pc()), (0, CODE + 2));
}

#[test]
fn masked_supervisor_call_escalates() {
    let mut board = Board::new(&[CPSID_I, SVC, LOOP]);
    board.step(2);
    board.step(1);
    assert_eq!((board.exception(), board.core.fault_status()[1]), (3, 1 << 30));
}

#[test]
fn undefined_instruction_takes_its_fault() {
    // While UsageFault is enabled, and else HardFault. Both return to the instruction.
    for (enabled, exception, hfsr) in [(1 << 18, 6, 0), (0, 3, 1 << 30)] {
        let mut board = Board::new(&[NOP, UDF]);
        board.write(SHCSR, enabled);
        board.step(2);
        board.step(1);
        let [cfsr, forced, ..] = board.core.fault_status();
        assert_eq!((board.exception(), cfsr, forced), (exception, 1 << 16, hfsr));
        assert_eq!(board.word(STACK - 32 + 24), CODE + 2);
    }
}

#[test]
fn fault_in_hard_fault_locks_up() {
    let mut board = Board::new(&[UDF]);
    board.set_handler(3, &[UDF]);
    assert_eq!(board.step(3), Stop::Lockup);
    assert_eq!(board.run(100), Stop::Lockup);
    board.core.reset(&mut board.bus);
    assert_eq!(board.core.pc(), CODE);
    assert_eq!(board.core.fault_status(), [0; 4]);
}

#[test]
fn bus_error_reports_its_address() {
    let mut board = Board::new(&[LDR_R0_R1, LOOP]);
    board.write(SHCSR, 1 << 17);
    board.set(0, 77);
    board.set(1, 0x6000_0010);
    board.step(1);
    board.step(1);
    let [cfsr, hfsr, _, bfar] = board.core.fault_status();
    assert_eq!((board.exception(), cfsr, hfsr, bfar), (5, 0x8200, 0, 0x6000_0010));
    assert_eq!((board.word(STACK - 32), board.word(STACK - 32 + 24)), (77, CODE));
}

#[test]
fn traps_of_ccr_are_taken_when_on() {
    // SDIV R0, R1, R2 by zero; LDR R0, [R1] at an odd address.
    for (code, trap, cfsr) in [
        (vec![0xfb91, 0xf0f2, LOOP], 1 << 4, 1 << 25),
        (vec![LDR_R0_R1, LOOP], 1 << 3, 1 << 24),
    ] {
        for (ccr, expected) in [(0x200, 0), (0x200 | trap, cfsr)] {
            let mut board = Board::new(&code);
            board.write(CCR, ccr);
            board.set(1, RAM + 0x101);
            board.set(2, 0);
            board.step(1);
            board.run(3);
            assert_eq!(board.core.fault_status()[0], expected);
            assert_eq!(board.exception(), if expected == 0 { 0 } else { 3 });
        }
    }
}

#[test]
fn branch_to_an_even_address_faults() {
    // BX R0.
    let mut board = Board::new(&[0x4700]);
    board.set(0, RAM + 0x100);
    board.step(1);
    board.step(1);
    assert_eq!((board.exception(), board.core.fault_status()[0]), (3, 1 << 17));
    assert_eq!(
        (board.word(STACK - 32 + 24), board.word(STACK - 4) & 1 << 24),
        (RAM + 0x100, 0)
    );
}

#[test]
fn coprocessor_without_access_faults() {
    // VADD.F32 with CPACR at reset, and MCR p15.
    for code in [[0xee30, 0x0a81], [0xee01, 0x0f10]] {
        let mut board = Board::new(&code);
        board.step(1);
        board.step(1);
        assert_eq!((board.exception(), board.core.fault_status()[0]), (3, 1 << 19));
    }
}

#[test]
fn breakpoint_instruction_is_a_debug_fault() {
    let mut board = Board::new(&[0xbe00]);
    board.step(1);
    board.step(1);
    assert_eq!((board.exception(), board.core.fault_status()[1]), (3, 1 << 31));
}

#[test]
fn forged_exception_return_faults() {
    // In a handler, BX R0 with a return to a handler that is not there, and with a frame of floating-point registers.
    for value in [0xffff_fff1, 0xffff_ffe9, 0xffff_fff5] {
        let mut board = Board::new(&[SVC, LOOP]);
        board.set_handler(11, &[0x4700]);
        board.set(0, value);
        board.step(2);
        board.step(1);
        assert_eq!(
            (board.exception(), board.core.fault_status()[0]),
            (3, 1 << 18),
            "{value:#x}"
        );
        assert_eq!((board.r(14), board.r(13)), (value, STACK - 32));
    }
}

#[test]
fn stacking_into_nothing_is_reported() {
    let mut board = Board::new(&[SVC, LOOP]);
    board.set(13, RAM + 8);
    board.step(1);
    board.step(1);
    // The derived HardFault is taken first; SVCall waits.
    assert_eq!((board.exception(), board.core.fault_status()[0]), (3, 1 << 12));
}

#[test]
fn vector_table_moves() {
    let mut board = Board::new(&[NOP, LOOP]);
    board.set_word(RAM + 0x200 + 4 * 16, (CODE + 0x40) | 1);
    board.write(VTOR, RAM + 0x200);
    board.enable(0, 0);
    board.core.pend_interrupt(0);
    board.run(2);
    assert_eq!((board.exception(), board.core.pc()), (16, CODE + 0x40));
}

#[test]
fn wfi_sleeps_until_an_interrupt() {
    let mut board = Board::new(&[WFI, NOP, LOOP]);
    board.enable(1, 0x40);
    assert_eq!(board.run(100), Stop::Sleep);
    assert!(board.core.is_asleep());
    let slept = board.core.cycle();
    assert_eq!(board.run(100), Stop::Sleep);
    assert_eq!(board.core.cycle(), slept);
    // Not by one that is not enabled.
    board.core.pend_interrupt(2);
    assert_eq!(board.run(100), Stop::Sleep);
    board.core.advance(slept + 1000);
    board.core.pend_interrupt(1);
    assert_eq!(board.step(1), Stop::Deadline);
    assert_eq!((board.exception(), board.core.cycle()), (17, slept + 1002));
}

#[test]
fn masked_interrupt_wakes_without_its_handler() {
    let mut board = Board::new(&[CPSID_I, WFI, NOP, LOOP]);
    board.enable(1, 0x40);
    assert_eq!(board.run(100), Stop::Sleep);
    board.core.pend_interrupt(1);
    board.step(1);
    assert_eq!((board.exception(), board.core.pc()), (0, CODE + 6));
}

#[test]
fn wfe_takes_one_event() {
    let mut board = Board::new(&[SEV, WFE, NOP, WFE, NOP, LOOP]);
    assert_eq!(board.run(100), Stop::Sleep);
    assert_eq!(board.core.pc(), CODE + 8);
    board.core.send_event();
    board.step(1);
    assert_eq!(board.core.pc(), CODE + 10);
}

#[test]
fn masked_interrupt_does_not_end_wfe() {
    let mut board = Board::new(&[CPSID_I, WFE, NOP, LOOP]);
    board.enable(1, 0x40);
    assert_eq!(board.run(100), Stop::Sleep);
    board.core.pend_interrupt(1);
    assert_eq!(board.run(100), Stop::Sleep);
    // With SEVONPEND, pending is an event. It has to become pending anew.
    let mut board = Board::new(&[CPSID_I, WFE, NOP, LOOP]);
    board.enable(1, 0x40);
    board.write(SCR, 1 << 4);
    assert_eq!(board.run(100), Stop::Sleep);
    board.core.pend_interrupt(1);
    assert_eq!(board.run(100), Stop::Deadline);
    assert_eq!(board.exception(), 0);
}

#[test]
fn exception_return_is_an_event() {
    let mut board = Board::new(&[NOP, WFE, NOP, LOOP]);
    board.set_handler(16, &[BX_LR]);
    board.enable(0, 0);
    board.core.pend_interrupt(0);
    assert_eq!(board.run(20), Stop::Deadline);
    assert_eq!(board.core.pc(), CODE + 6);
}

#[test]
fn sevonpend_wakes_for_a_disabled_interrupt() {
    for (scr, stop) in [(0, Stop::Sleep), (1 << 4, Stop::Deadline)] {
        let mut board = Board::new(&[WFE, LOOP]);
        board.write(SCR, scr);
        assert_eq!(board.run(100), Stop::Sleep);
        board.core.pend_interrupt(3);
        assert_eq!(board.run(100), stop);
    }
}

#[test]
fn sleeponexit_sleeps_after_the_handler() {
    let mut board = Board::new(&[NOP, LOOP]);
    board.set_handler(16, &[BX_LR]);
    board.enable(0, 0);
    board.write(SCR, 1 << 1);
    board.core.pend_interrupt(0);
    assert_eq!(board.run(100), Stop::Sleep);
    board.core.pend_interrupt(0);
    assert_eq!(board.run(100), Stop::Sleep);
    assert_eq!(board.core.pc(), CODE);
}

#[test]
fn reset_request_stops_the_core() {
    let mut board = Board::new(&[STR_R0_R1, NOP, LOOP]);
    board.set(1, AIRCR);
    // Without the key, nothing.
    board.set(0, 0x1234_0004);
    assert_eq!(board.run(2), Stop::Deadline);
    board.set(0, 0x05fa_0004);
    board.set(15, CODE);
    assert_eq!(board.run(10), Stop::ResetRequest);
    assert_eq!(board.core.pc(), CODE + 2);
}

#[test]
fn pendsv_is_pended_by_icsr() {
    let mut board = Board::new(&[STR_R0_R1, NOP, LOOP]);
    board.set(0, 1 << 28);
    board.set(1, ICSR);
    board.step(1);
    board.step(1);
    assert_eq!(board.exception(), 14);
    assert_eq!(board.core.register(Register::Xpsr) & 0x1ff, 14);
}

#[test]
fn nmi_ignores_the_masks() {
    let mut board = Board::new(&[0xb671, NOP, LOOP]);
    board.step(1);
    board.core.pend_nmi();
    board.step(1);
    assert_eq!(board.exception(), 2);
}

#[test]
fn attention_stops_behind_the_access() {
    let mut board = Board::new(&[STR_R0_R1, NOP, LOOP]);
    board.set(0, 42);
    board.set(1, BELL);
    assert_eq!(board.run(100), Stop::Attention);
    assert_eq!((board.core.pc(), board.core.cycle()), (CODE + 2, 1));
    board.bus.attention = false;
    assert_eq!(board.run(100), Stop::Deadline);
    let (access, value) = board.bus.accesses[0];
    assert_eq!(
        (access.address, access.pc, access.cycle, value),
        (BELL, CODE, 0, Some(42))
    );
}

#[test]
fn access_carries_cycle_and_width() {
    // NOP; LDRH R0, [R1].
    let mut board = Board::new(&[NOP, 0x8808, LOOP]);
    board.set(1, PERIPHERAL + 2);
    board.bus.values.insert(PERIPHERAL + 2, 0xffff_1234);
    board.step(2);
    let (access, _) = board.bus.accesses[0];
    assert_eq!((access.cycle, access.width.bytes(), access.pc), (1, 2, CODE + 2));
    assert_eq!(board.r(0), 0x1234);
}

#[test]
fn systick_is_refused_by_name() {
    let mut board = Board::new(&[STR_R0_R1]);
    board.set(0, 1);
    board.set(1, 0xe000_e010);
    assert_eq!(board.step(1), Stop::Refused(Refusal::Function("SysTick")));
}

#[test]
fn unknown_system_register_is_refused() {
    let mut board = Board::new(&[LDR_R0_R1]);
    board.set(1, 0xe000_0000);
    assert_eq!(board.step(1), Stop::Refused(Refusal::SystemRegister(0xe000_0000)));
}

#[test]
fn cycle_counter_counts_while_it_is_on() {
    let mut board = Board::new(&[NOP; 8]);
    board.write(0xe000_edfc, 1 << 24);
    board.write(0xe000_1004, 0);
    board.write(0xe000_1000, 1);
    board.step(8);
    // And the load itself.
    assert_eq!(board.read(0xe000_1004), 9);
}
