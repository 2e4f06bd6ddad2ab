//! The core's state (ARM DDI 0403E, B1.4).

use std::collections::BTreeSet;

use super::alu::Flags;
use super::fault::{Refusal, exception};
use super::memory::Memory;
use super::mpu::Mpu;
use super::nvic::Nvic;
use super::op::Reg;
use super::timing::Clock;

/// Bits of CONTROL.
pub(super) mod control {
    /// nPRIV: thread mode is unprivileged.
    pub(in super::super) const UNPRIVILEGED: u8 = 1;
    /// SPSEL: thread mode uses the process stack.
    pub(in super::super) const PROCESS_STACK: u8 = 2;
}

/// Bits of CCR (B3.2.8).
pub(super) mod ccr {
    pub(in super::super) const NONBASETHRDENA: u32 = 1;
    pub(in super::super) const USERSETMPEND: u32 = 1 << 1;
    pub(in super::super) const UNALIGN_TRP: u32 = 1 << 3;
    pub(in super::super) const DIV_0_TRP: u32 = 1 << 4;
    pub(in super::super) const BFHFNMIGN: u32 = 1 << 8;
    pub(in super::super) const STKALIGN: u32 = 1 << 9;
    /// All writable bits.
    pub(in super::super) const WRITABLE: u32 = 0x31b;
}

/// Bits of SCR (B3.2.7).
pub(super) mod scr {
    pub(in super::super) const SLEEPONEXIT: u32 = 1 << 1;
    pub(in super::super) const SEVONPEND: u32 = 1 << 4;
}

/// The core's sleep state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Sleep {
    /// Not asleep.
    Awake,
    /// For an interrupt: WFI, SLEEPONEXIT.
    Interrupt,
    /// For an event: WFE.
    Event,
}

/// Registers of the System Control Block with a state of their own.
#[derive(Clone, Debug, Default)]
pub(super) struct Scb {
    pub(super) vtor: u32,
    pub(super) scr: u32,
    pub(super) ccr: u32,
    pub(super) cfsr: u32,
    pub(super) hfsr: u32,
    pub(super) mmfar: u32,
    pub(super) bfar: u32,
    pub(super) actlr: u32,
    pub(super) cpacr: u32,
    pub(super) fpccr: u32,
    pub(super) fpcar: u32,
    pub(super) fpdscr: u32,
    pub(super) demcr: u32,
    /// DWT_CTRL.CYCCNTENA.
    pub(super) cycle_counter_on: bool,
    /// The offset of DWT_CYCCNT from the core's cycles, or its value while the counter is off.
    pub(super) cycle_counter: u32,
}

/// The chip's choices for its core.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Config {
    /// Number of interrupt lines, 1 to 240.
    pub interrupts: u16,
    /// Number of priority bits, 3 to 8.
    pub priority_bits: u8,
    /// The address of the vector table at reset.
    pub vector_table: u32,
    /// Number of MPU regions: 0 without an MPU, or 8.
    pub mpu_regions: u8,
    /// True for bit-band aliases of the first megabytes of RAM and peripherals.
    pub bit_band: bool,
}

/// The core with its memory.
#[derive(Clone, Debug)]
pub(super) struct Cpu {
    /// R0 to R15. While an instruction is executed, R15 is its address.
    pub(super) r: [u32; 16],
    pub(super) flags: Flags,
    /// APSR.Q.
    pub(super) q: bool,
    /// APSR.GE.
    pub(super) ge: u8,
    /// EPSR.IT: 0 outside an IT block.
    pub(super) it: u8,
    /// EPSR.T.
    pub(super) thumb: bool,
    /// IPSR: 0 in thread mode.
    pub(super) exception: u16,
    pub(super) primask: bool,
    pub(super) faultmask: bool,
    pub(super) basepri: u8,
    pub(super) control: u8,
    /// The inactive stack pointer.
    pub(super) other_sp: u32,
    /// The event register of WFE.
    pub(super) event: bool,
    pub(super) sleep: Sleep,
    /// The local monitor of LDREX and STREX (A3.4).
    pub(super) exclusive: bool,
    /// A stack frame has been written, and the handler has not been chosen.
    pub(super) entering: bool,
    /// A fault could not be handled (B1.5.15).
    pub(super) lockup: bool,
    /// AIRCR.SYSRESETREQ was written.
    pub(super) reset_requested: bool,
    pub(super) refused: Option<Refusal>,

    pub(super) cycle: u64,
    pub(super) instructions: u64,
    /// No instruction begins at this cycle or later. 0 if other work comes first.
    pub(super) limit: u64,

    pub(super) config: Config,
    pub(super) scb: Scb,
    pub(super) nvic: Nvic,
    pub(super) mpu: Mpu,
    pub(super) clock: Clock,
    pub(super) memory: Memory,
    pub(super) breakpoints: BTreeSet<u32>,
}

impl Cpu {
    /// Reads a register. R15 is the address of the instruction, not the value that the instruction would read.
    #[inline(always)]
    pub(super) fn get(&self, register: Reg) -> u32 {
        self.r[register.index()]
    }

    /// Writes a register other than R13 and R15.
    #[inline(always)]
    pub(super) fn set(&mut self, register: Reg, value: u32) {
        self.r[register.index()] = value;
    }

    /// Writes a register that may be R13, whose two lowest bits are always 0.
    #[inline(always)]
    pub(super) fn set_or_sp(&mut self, register: Reg, value: u32) {
        let ignored = if register == Reg::SP { 3 } else { 0 };
        self.r[register.index()] = value & !ignored;
    }

    /// Makes the run loop handle other work before the next instruction.
    pub(super) fn request_service(&mut self) {
        self.limit = 0;
    }

    /// xPSR as an exception stacks it, without the alignment bit (B1.4.2).
    pub(super) fn xpsr(&self) -> u32 {
        let it = u32::from(self.it);
        self.flags.nzcv() << 28
            | u32::from(self.q) << 27
            | (it & 3) << 25
            | u32::from(self.thumb) << 24
            | u32::from(self.ge) << 16
            | it >> 2 << 10
            | u32::from(self.exception)
    }

    /// Sets flags, IT and T from a stacked xPSR.
    pub(super) fn set_xpsr(&mut self, xpsr: u32) {
        self.set_apsr(xpsr);
        self.ge = (xpsr >> 16 & 15) as u8;
        self.it = (xpsr >> 8 & 0xfc | xpsr >> 25 & 3) as u8;
        self.thumb = xpsr >> 24 & 1 != 0;
    }

    /// Sets N, Z, C, V and Q.
    pub(super) fn set_apsr(&mut self, apsr: u32) {
        self.flags = Flags::new(apsr >> 28);
        self.q = apsr >> 27 & 1 != 0;
    }

    pub(super) fn is_privileged(&self) -> bool {
        self.exception != 0 || self.control & control::UNPRIVILEGED == 0
    }

    /// ExecutionPriority() (B1.5.4).
    pub(super) fn execution_priority(&self) -> i16 {
        let mut priority = self.nvic.active_priority();
        if self.basepri != 0 {
            priority = priority.min(self.nvic.group_priority(self.basepri.into()));
        }
        if self.primask {
            priority = priority.min(0);
        }
        if self.faultmask {
            priority = priority.min(-1);
        }
        priority
    }

    /// Returns true at the priority of HardFault, NMI, or of code with FAULTMASK.
    pub(super) fn handles_fault(&self) -> bool {
        let is_fault_handler = matches!(self.exception, exception::NMI | exception::HARD_FAULT);
        // Usually none applies.
        self.faultmask || is_fault_handler || self.exception != 0 && self.execution_priority() < 0
    }

    /// Returns true if R13 is the process stack pointer.
    pub(super) fn uses_process_stack(&self) -> bool {
        self.exception == 0 && self.control & control::PROCESS_STACK != 0
    }

    /// Changes the mode, and exchanges the stack pointers if it selects the other one.
    pub(super) fn change_mode(&mut self, exception: u16, control: u8) {
        let before = self.uses_process_stack();
        self.exception = exception;
        self.control = control;
        if self.uses_process_stack() != before {
            std::mem::swap(&mut self.r[Reg::SP.index()], &mut self.other_sp);
        }
        self.update_open_window();
    }

    pub(super) fn main_sp(&self) -> u32 {
        if self.uses_process_stack() {
            self.other_sp
        } else {
            self.get(Reg::SP)
        }
    }

    pub(super) fn process_sp(&self) -> u32 {
        if self.uses_process_stack() {
            self.get(Reg::SP)
        } else {
            self.other_sp
        }
    }

    pub(super) fn set_main_sp(&mut self, value: u32) {
        if self.uses_process_stack() {
            self.other_sp = value & !3;
        } else {
            self.set_or_sp(Reg::SP, value);
        }
    }

    pub(super) fn set_process_sp(&mut self, value: u32) {
        if self.uses_process_stack() {
            self.set_or_sp(Reg::SP, value);
        } else {
            self.other_sp = value & !3;
        }
    }

    /// Recomputes the address range without MPU checks.
    pub(super) fn update_open_window(&mut self) {
        let privileged = self.is_privileged();
        self.mpu.update_window(privileged, &self.memory);
    }
}
