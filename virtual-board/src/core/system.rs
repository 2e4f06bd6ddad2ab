//! The registers of the System Control Space and of the trace unit (ARM DDI 0403E, B3.2 to B3.5, C1.6, C1.8).
//!
//! An access to a missing register is refused with its address, and so is SysTick: the images use a timer for time.

use super::fault::{Refusal, Trap, exception};
use super::memory::Width;
use super::state::{Cpu, ccr};

/// DEMCR.TRCENA: the trace unit counts.
const TRCENA: u32 = 1 << 24;

/// The key that unlocks AIRCR, and its value on a read.
const AIRCR_KEY: u32 = 0x05fa;
const AIRCR_KEY_READ: u32 = 0xfa05;

/// CPUID of a Cortex-M4 r0p1, as in STM32F405 and STM32G431.
const CPUID: u32 = 0x410f_c241;

/// ID_PFR0 to ID_ISAR4 (Cortex-M4 TRM, 4.1).
const IDENTIFICATION: [u32; 13] = [
    0x0000_0030,
    0x0000_0200,
    0x0010_0000,
    0x0000_0000,
    0x0010_0030,
    0x0000_0000,
    0x0100_0000,
    0x0000_0000,
    0x0114_1110,
    0x0211_2000,
    0x2123_2231,
    0x0111_1131,
    0x0131_0102,
];

/// A page of the private peripheral bus that belongs to the core.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Page {
    /// The System Control Space (B3.2.2).
    Control,
    /// The Data Watchpoint and Trace unit (C1.8).
    Trace,
    /// ITM, FPB, TPIU, ETM, ROM table.
    Absent,
}

/// The page of an address. `None` for memory and for the chip's own addresses (B3.1.1).
pub(super) fn private_page(address: u32) -> Option<Page> {
    match address >> 12 {
        0xe000e => Some(Page::Control),
        0xe0001 => Some(Page::Trace),
        0xe0000 | 0xe0002 | 0xe0040 | 0xe0041 | 0xe00ff => Some(Page::Absent),
        _ => None,
    }
}

impl Cpu {
    /// Reads the word at a word-aligned address.
    pub(super) fn read_system(&mut self, page: Page, address: u32) -> Result<u32, Trap> {
        match page {
            Page::Control => self.read_control(address),
            Page::Trace => self.read_trace(address),
            Page::Absent => Err(Refusal::SystemRegister(address).into()),
        }
    }

    /// Writes a byte, halfword or word.
    pub(super) fn write_system(&mut self, page: Page, address: u32, value: u32, width: Width) -> Result<(), Trap> {
        self.request_service();
        match page {
            Page::Control => self.write_control(address, value, width),
            Page::Trace => self.write_trace(address, value),
            Page::Absent => Err(Refusal::SystemRegister(address).into()),
        }
    }

    fn read_control(&self, address: u32) -> Result<u32, Trap> {
        let offset = address & 0xfff;
        let scb = &self.scb;
        Ok(match offset {
            0x004 => self.nvic.ictr(),
            0x008 => scb.actlr,
            // SysTick is off.
            0x010 | 0x014 | 0x018 => 0,
            0x100..0x120 => self.nvic.enabled_register(register_number(offset)),
            0x180..0x1a0 => self.nvic.enabled_register(register_number(offset)),
            0x200..0x220 => self.nvic.pending_register(register_number(offset)),
            0x280..0x2a0 => self.nvic.pending_register(register_number(offset)),
            0x300..0x320 => self.nvic.active_register(register_number(offset)),
            0x400..0x4f0 => self.priorities((offset - 0x400) as u16 + exception::INTERRUPT_0),
            0xd00 => CPUID,
            0xd04 => self.icsr(),
            0xd08 => scb.vtor,
            0xd0c => AIRCR_KEY_READ << 16 | u32::from(self.nvic.group()) << 8,
            0xd10 => scb.scr,
            0xd14 => scb.ccr,
            0xd18..0xd24 => self.priorities((offset - 0xd18) as u16 + 4),
            0xd24 => self.shcsr(),
            0xd28 => scb.cfsr,
            0xd2c => scb.hfsr,
            0xd30 => 0,
            0xd34 => scb.mmfar,
            0xd38 => scb.bfar,
            0xd3c => 0,
            0xd40..0xd74 => IDENTIFICATION[(offset as usize - 0xd40) / 4],
            0xd88 => scb.cpacr,
            0xd90..0xdc0 => {
                let value = self.mpu.read(offset - 0xd90);
                value.ok_or(Refusal::SystemRegister(address))?
            }
            // A program sees no debugger.
            0xdf0 => 0,
            0xdfc => scb.demcr,
            0xf34 => scb.fpccr,
            0xf38 => scb.fpcar,
            0xf3c => scb.fpdscr,
            0xf40 => 0x1011_0021,
            0xf44 => 0x1100_0011,
            0xf48 => 0,
            _ => return Err(Refusal::SystemRegister(address).into()),
        })
    }

    fn write_control(&mut self, address: u32, value: u32, width: Width) -> Result<(), Trap> {
        let offset = address & 0xfff;
        // Priorities and fault status can be written by bytes, too.
        match offset {
            0x400..0x4f0 => {
                self.set_priorities((offset - 0x400) as u16 + exception::INTERRUPT_0, value, width);
                return Ok(());
            }
            0xd18..0xd24 => {
                self.set_priorities((offset - 0xd18) as u16 + 4, value, width);
                return Ok(());
            }
            0xd28..0xd2c => {
                self.scb.cfsr &= !(value << (8 * (offset & 3)));
                return Ok(());
            }
            _ => {}
        }
        if width != Width::Word {
            return Err(Refusal::SystemRegister(address).into());
        }
        let scb = &mut self.scb;
        match offset {
            0x008 => scb.actlr = value & 0x307,
            0x010 if value & 1 != 0 => return Err(Refusal::Function("SysTick").into()),
            0x010 | 0x014 | 0x018 => {}
            0x100..0x120 => self.for_interrupts(offset, value, |cpu, number| cpu.nvic.set_enabled(number, true)),
            0x180..0x1a0 => self.for_interrupts(offset, value, |cpu, number| cpu.nvic.set_enabled(number, false)),
            0x200..0x220 => self.for_interrupts(offset, value, |cpu, number| cpu.nvic.pend(number)),
            0x280..0x2a0 => self.for_interrupts(offset, value, |cpu, number| cpu.nvic.unpend(number)),
            0xd04 => self.write_icsr(value),
            0xd08 => scb.vtor = value & !0x7f,
            0xd0c => self.write_aircr(value),
            0xd10 => scb.scr = value & 0x16,
            0xd14 if value & ccr::BFHFNMIGN != 0 => return Err(Refusal::Function("CCR.BFHFNMIGN").into()),
            0xd14 => scb.ccr = value & (ccr::WRITABLE),
            0xd24 => self.write_shcsr(value),
            0xd2c => scb.hfsr &= !value,
            0xd30 => {}
            0xd34 => scb.mmfar = value,
            0xd38 => scb.bfar = value,
            0xd88 => scb.cpacr = value & 0x00f0_0000,
            0xd90..0xdc0 => {
                let written = self.mpu.write(offset - 0xd90, value);
                written.ok_or(Refusal::SystemRegister(address))?;
                self.update_open_window();
                // Permissions to execute are checked during decoding.
                self.memory.note_change_of_all();
            }
            0xdf0 => {}
            0xdfc => scb.demcr = value & 0x010f_07f1,
            0xf00 => self.nvic.pend((value & 0x1ff) as u16 + exception::INTERRUPT_0),
            0xf34 => scb.fpccr = value & 0xc000_0000,
            0xf38 => scb.fpcar = value & !7,
            0xf3c => scb.fpdscr = value & 0x07c0_0000,
            _ => return Err(Refusal::SystemRegister(address).into()),
        }
        Ok(())
    }

    fn read_trace(&self, address: u32) -> Result<u32, Trap> {
        match address & 0xfff {
            // Four comparators, and the cycle counter.
            0x000 => Ok(4 << 28 | u32::from(self.scb.cycle_counter_on)),
            0x004 => Ok(self.cycle_counter()),
            _ => Err(Refusal::SystemRegister(address).into()),
        }
    }

    fn write_trace(&mut self, address: u32, value: u32) -> Result<(), Trap> {
        let now = self.cycle as u32;
        match address & 0xfff {
            0x000 if value & !1 & 0x0fff_ffff == 0 => {
                let counted = self.cycle_counter();
                self.scb.cycle_counter_on = value & 1 != 0;
                self.set_cycle_counter(counted, now);
            }
            0x004 => self.set_cycle_counter(value, now),
            _ => return Err(Refusal::SystemRegister(address).into()),
        }
        Ok(())
    }

    fn counts_cycles(&self) -> bool {
        self.scb.cycle_counter_on && self.scb.demcr & TRCENA != 0
    }

    fn cycle_counter(&self) -> u32 {
        let since = if self.counts_cycles() { self.cycle as u32 } else { 0 };
        self.scb.cycle_counter.wrapping_add(since)
    }

    fn set_cycle_counter(&mut self, value: u32, now: u32) {
        self.scb.cycle_counter = if self.counts_cycles() {
            value.wrapping_sub(now)
        } else {
            value
        };
    }

    /// Four priorities, starting with this exception.
    fn priorities(&self, first: u16) -> u32 {
        u32::from_le_bytes([0, 1, 2, 3].map(|i| self.nvic.priority(first + i) as u8))
    }

    fn set_priorities(&mut self, first: u16, value: u32, width: Width) {
        for (number, priority) in (first..).zip(value.to_le_bytes()).take(width.bytes() as usize) {
            self.nvic.set_priority(number, priority);
        }
    }

    fn for_interrupts(&mut self, offset: u32, bits: u32, mut action: impl FnMut(&mut Self, u16)) {
        let first = exception::INTERRUPT_0 + 32 * register_number(offset);
        for bit in (0..32).filter(|bit| bits >> bit & 1 != 0) {
            action(self, first + bit);
        }
    }

    /// B3.2.4.
    fn icsr(&self) -> u32 {
        let pending = self.nvic.first_pending().unwrap_or(0);
        // RETTOBASE: no exception is active except the current one.
        let last = self.exception != 0 && self.nvic.active_count() <= 1;
        u32::from(self.exception)
            | u32::from(last) << 11
            | u32::from(pending) << 12
            | u32::from(self.nvic.is_interrupt_pending()) << 22
            | u32::from(self.nvic.is_pending(exception::SYS_TICK)) << 26
            | u32::from(self.nvic.is_pending(exception::PEND_SV)) << 28
            | u32::from(self.nvic.is_pending(exception::NMI)) << 31
    }

    fn write_icsr(&mut self, value: u32) {
        for (bit, number) in [
            (31, exception::NMI),
            (28, exception::PEND_SV),
            (26, exception::SYS_TICK),
        ] {
            if value >> bit & 1 != 0 {
                self.nvic.pend(number);
            }
        }
        for (bit, number) in [(27, exception::PEND_SV), (25, exception::SYS_TICK)] {
            if value >> bit & 1 != 0 {
                self.nvic.unpend(number);
            }
        }
    }

    /// B3.2.6.
    fn write_aircr(&mut self, value: u32) {
        if value >> 16 != AIRCR_KEY {
            return;
        }
        self.nvic.set_group((value >> 8) as u8);
        self.reset_requested |= value & 4 != 0;
    }

    /// B3.2.13.
    fn shcsr(&self) -> u32 {
        let bits = SHCSR_ACTIVE
            .iter()
            .map(|(bit, number)| u32::from(self.nvic.is_active(*number)) << bit);
        let pending = SHCSR_PENDING
            .iter()
            .map(|(bit, number)| u32::from(self.nvic.is_pending(*number)) << bit);
        let enabled = SHCSR_ENABLED
            .iter()
            .map(|(bit, number)| u32::from(self.nvic.is_enabled(*number)) << bit);
        bits.chain(pending).chain(enabled).sum()
    }

    fn write_shcsr(&mut self, value: u32) {
        for (bit, number) in SHCSR_ACTIVE {
            self.nvic.set_active(number, value >> bit & 1 != 0);
        }
        for (bit, number) in SHCSR_PENDING {
            if value >> bit & 1 != 0 {
                self.nvic.pend(number);
            } else {
                self.nvic.unpend(number);
            }
        }
        for (bit, number) in SHCSR_ENABLED {
            self.nvic.set_enabled(number, value >> bit & 1 != 0);
        }
    }
}

/// Bits of SHCSR with their exceptions.
const SHCSR_ACTIVE: [(u32, u16); 7] = [
    (0, exception::MEM_MANAGE),
    (1, exception::BUS_FAULT),
    (3, exception::USAGE_FAULT),
    (7, exception::SV_CALL),
    (8, exception::DEBUG_MONITOR),
    (10, exception::PEND_SV),
    (11, exception::SYS_TICK),
];
const SHCSR_PENDING: [(u32, u16); 4] = [
    (12, exception::USAGE_FAULT),
    (13, exception::MEM_MANAGE),
    (14, exception::BUS_FAULT),
    (15, exception::SV_CALL),
];
const SHCSR_ENABLED: [(u32, u16); 3] = [
    (16, exception::MEM_MANAGE),
    (17, exception::BUS_FAULT),
    (18, exception::USAGE_FAULT),
];

/// The index of an NVIC register among those of its kind.
fn register_number(offset: u32) -> u16 {
    (offset as u16 & 0x7f) / 4
}
