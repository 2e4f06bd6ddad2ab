//! A Cortex-M4: ARMv7E-M without the floating-point extension, and no chip around it.
//!
//! [`Core`] has the registers, the interrupt controller, the MPU, and flash and RAM in a [`Memory`]. It accesses
//! everything else through a [`Bus`]. [`Core::run`] executes instructions until a deadline in cycles, or until an event
//! for the board:
//!
//! ```
//! use armwire_virtual_board::core::{Access, Bus, BusError, Config, Core, Memory, Stop, Timing};
//!
//! struct Nothing;
//! impl Bus for Nothing {
//!     fn read(&mut self, _: Access, _: &mut Memory) -> Result<u32, BusError> {
//!         Err(BusError)
//!     }
//!     fn write(&mut self, _: Access, _: u32, _: &mut Memory) -> Result<(), BusError> {
//!         Err(BusError)
//!     }
//!     fn needs_attention(&self) -> bool {
//!         false
//!     }
//! }
//!
//! // The initial stack pointer, the reset vector, and a branch to itself.
//! let mut flash = vec![0x00, 0x10, 0x00, 0x20, 0x09, 0x00, 0x00, 0x08];
//! flash.extend([0xfe, 0xe7]);
//! let config = Config {
//!     interrupts: 82,
//!     priority_bits: 4,
//!     vector_table: 0x0800_0000,
//!     mpu_regions: 8,
//!     bit_band: true,
//! };
//! let mut core = Core::new(config, Memory::new(0x0800_0000, flash, 0x2000_0000, 4096));
//! core.reset(&mut Nothing);
//! assert_eq!(core.run(&mut Nothing, 1000), Stop::Deadline);
//! assert_eq!((core.cycle(), core.pc()), (1000, 0x0800_0008));
//! ```
//!
//! The files are layers: `op`, `alu`, `decode`, `memory` and [`bus`] are independent of the core; `state` is the core's
//! state; `system`, `access`, `exception` and `execute` are its functions; this file is the loop.
//! Sections without a name are those of ARM DDI 0403E, the ARMv7-M Architecture Reference Manual.
//!
//! Not modelled: the floating-point extension, SysTick and CCR.BFHFNMIGN, whose use stops with an error; imprecise bus
//! faults; trace and breakpoint units. Instructions are not interrupted: LDM, STM and divisions complete before an
//! exception is taken. CPACR and FPCCR can be written, as by an image for a core with an FPU: without a floating-point
//! instruction, no exception stacks its registers.

mod access;
mod alu;
pub mod bus;
mod code;
mod decode;
mod dsp;
mod exception;
mod execute;
mod fault;
mod memory;
mod mpu;
mod nvic;
mod op;
mod state;
mod system;
mod timing;

use std::collections::{BTreeMap, BTreeSet};

pub use self::bus::{Access, Bus, BusError, NoPeripherals, Purpose};
use self::code::{Code, Slot, mark};
pub use self::fault::Refusal;
use self::fault::Trap;
pub use self::memory::{Memory, Width};
use self::nvic::Nvic;
use self::op::Op;
pub use self::state::Config;
use self::state::{Cpu, Scb, Sleep, ccr};
use self::timing::Clock;
pub use self::timing::{FlashTiming, Timing};

/// The reason for the return of [`Core::run`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stop {
    /// The deadline was reached.
    Deadline,
    /// The core sleeps without a wake-up event.
    Sleep,
    /// The bus requested attention.
    Attention,
    /// The next instruction has a breakpoint. The next call of [`Core::run`] executes it.
    Breakpoint,
    /// A reset was requested by AIRCR.SYSRESETREQ. The board executes it.
    ResetRequest,
    /// A fault occurred in a context that cannot handle it. Only a reset ends the lockup.
    Lockup,
    /// The core does not support the instruction at [`Core::pc`].
    Refused(Refusal),
}

/// A register by its debugger number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Register {
    /// R0 to R12, SP (13), LR (14), PC (15).
    R(u8),
    /// xPSR.
    Xpsr,
    /// The main stack pointer.
    Msp,
    /// The process stack pointer.
    Psp,
    /// PRIMASK.
    Primask,
    /// BASEPRI.
    Basepri,
    /// FAULTMASK.
    Faultmask,
    /// CONTROL.
    Control,
}

/// The core. A clone is a snapshot of the core and its memory.
#[derive(Clone, Debug)]
pub struct Core {
    cpu: Cpu,
    code: Code,
    /// Number of executions of each instruction, by address, if enabled.
    profile: Option<BTreeMap<u32, u64>>,
    /// The breakpoint reported last: its instruction is executed when the core continues.
    reported: Option<u32>,
}

/// Maximum number of instructions decoded at once.
const LONGEST_RUN: usize = 32;

/// The handling of an instruction on the slow path.
enum Verdict {
    /// Execute the one at this index.
    Execute(usize),
    Skip,
    Stop,
}

impl Core {
    /// A core with its memory, before its first reset.
    pub fn new(config: Config, memory: Memory) -> Self {
        Self {
            code: Code::new(&memory),
            cpu: Cpu {
                r: [0; 16],
                flags: alu::Flags::new(0),
                q: false,
                ge: 0,
                it: 0,
                thumb: true,
                exception: 0,
                primask: false,
                faultmask: false,
                basepri: 0,
                control: 0,
                other_sp: 0,
                event: false,
                sleep: Sleep::Awake,
                exclusive: false,
                entering: false,
                lockup: false,
                reset_requested: false,
                refused: None,
                cycle: 0,
                instructions: 0,
                limit: 0,
                config,
                scb: Scb::default(),
                nvic: Nvic::new(config.interrupts, config.priority_bits),
                mpu: mpu::Mpu::new(config.mpu_regions),
                clock: Clock::new(Timing::OneCycle),
                memory,
                breakpoints: BTreeSet::new(),
            },
            profile: None,
            reported: None,
        }
    }

    /// Resets the core, and fetches stack pointer and program counter from the vector table (B1.5.5). Memory, cycles,
    /// timing, breakpoints and profile stay. An unreadable vector table causes lockup.
    pub fn reset(&mut self, bus: &mut dyn Bus) {
        let cpu = &mut self.cpu;
        cpu.scb = Scb {
            vtor: cpu.config.vector_table,
            ccr: ccr::STKALIGN,
            fpccr: 0xc000_0000,
            ..Scb::default()
        };
        cpu.nvic = Nvic::new(cpu.config.interrupts, cpu.config.priority_bits);
        cpu.mpu = mpu::Mpu::new(cpu.config.mpu_regions);
        // The registers are UNKNOWN at reset.
        cpu.r = [0; 16];
        cpu.r[14] = u32::MAX;
        cpu.other_sp = 0;
        cpu.set_xpsr(1 << 24);
        (cpu.primask, cpu.faultmask, cpu.basepri, cpu.control) = (false, false, 0, 0);
        cpu.exception = 0;
        (cpu.event, cpu.sleep, cpu.exclusive, cpu.entering) = (false, Sleep::Awake, false, false);
        (cpu.lockup, cpu.reset_requested, cpu.refused) = (false, false, None);
        cpu.update_open_window();
        cpu.memory.note_change_of_all();
        cpu.request_service();
        self.reported = None;
        let cpu = &mut self.cpu;
        let table = cpu.config.vector_table;
        let (sp, start) = (cpu.load::<4>(bus, table), cpu.load::<4>(bus, table.wrapping_add(4)));
        match (sp, start) {
            (Ok(sp), Ok(start)) => {
                cpu.set_main_sp(sp);
                cpu.r[15] = start & !1;
                cpu.thumb = start & 1 != 0;
            }
            _ => cpu.lockup = true,
        }
    }

    /// Executes instructions that begin before this cycle, and takes exceptions between them.
    pub fn run(&mut self, bus: &mut dyn Bus, until: u64) -> Stop {
        self.reported = self.reported.filter(|address| *address == self.pc());
        loop {
            if let Some(stop) = self.service_pending(bus, until) {
                return stop;
            }
            self.cpu.limit = until;
            if self.execute_until_limit(bus) {
                self.reported = Some(self.pc());
                return Stop::Breakpoint;
            }
        }
    }

    /// Handles everything except instructions. Returns the reason to stop, if any.
    fn service_pending(&mut self, bus: &mut dyn Bus, until: u64) -> Option<Stop> {
        let cpu = &mut self.cpu;
        loop {
            if let Some(refusal) = cpu.refused {
                return Some(Stop::Refused(refusal));
            }
            if cpu.lockup {
                return Some(Stop::Lockup);
            }
            if std::mem::take(&mut cpu.reset_requested) {
                return Some(Stop::ResetRequest);
            }
            if bus.needs_attention() {
                return Some(Stop::Attention);
            }
            if cpu.cycle >= until {
                return Some(Stop::Deadline);
            }
            cpu.wake();
            match (cpu.entering, cpu.due_exception()) {
                (true, Some(number)) => cpu.take_exception(bus, number),
                (false, Some(_)) => cpu.stack_frame(bus),
                // An exception cannot be withdrawn while a frame is stacked.
                (true, None) => cpu.entering = false,
                (false, None) if cpu.sleep != Sleep::Awake => return Some(Stop::Sleep),
                (false, None) if !cpu.thumb => cpu.raise(fault::Fault::InvalidState),
                (false, None) => return None,
            }
        }
    }

    /// The loop. Returns true if it ended at a breakpoint.
    fn execute_until_limit(&mut self, bus: &mut dyn Bus) -> bool {
        if self.cpu.memory.has_changed() {
            self.code.forget(self.cpu.memory.take_changed());
        }
        let mut pc = self.cpu.r[15];
        let mut place = self.code.place(pc);
        while self.cpu.cycle < self.cpu.limit {
            let mut slot = self.code.slot(place);
            let mut it = 0;
            // Usually a single comparison.
            if slot.marks | self.cpu.it != 0 {
                if slot.marks == mark::LINE && self.cpu.it == 0 {
                    self.cpu.wait_for_fetch(pc, slot.length);
                } else {
                    it = self.cpu.it;
                    match self.consider(bus, pc) {
                        Verdict::Execute(considered) => place = considered,
                        Verdict::Skip => {
                            pc = self.cpu.r[15];
                            place = self.code.place(pc);
                            continue;
                        }
                        Verdict::Stop => return true,
                    }
                    slot = self.code.slot(place);
                }
            }
            let following = pc.wrapping_add(slot.length.into());
            match self.cpu.execute(bus, &slot.op, following) {
                Ok(next) => pc = next,
                Err(trap) => {
                    if matches!(trap, Trap::Fault(_) | Trap::Refused(_)) {
                        // Restores the state before the instruction.
                        self.cpu.it = it;
                    }
                    self.cpu.handle(bus, trap, following);
                    pc = self.cpu.r[15];
                }
            }
            self.cpu.r[15] = pc;
            self.cpu.cycle += u64::from(slot.cycles);
            self.cpu.instructions += 1;
            place = if pc == following {
                place + 1
            } else {
                self.code.place(pc)
            };
        }
        false
    }

    /// Finds or decodes an instruction, or handles its marks: an IT block, a breakpoint, the profile, the flash's wait
    /// states.
    #[inline(never)]
    fn consider(&mut self, bus: &mut dyn Bus, pc: u32) -> Verdict {
        let mut place = self.code.place(pc);
        let in_it = self.cpu.it & 15 != 0;
        let marks = self.code.slot(place).marks;
        if marks & mark::NONE != 0 || (marks & mark::IN_IT != 0) != in_it {
            match self.decode_run(bus, pc) {
                Ok(decoded) => place = decoded,
                Err(trap) => {
                    self.cpu.handle(bus, trap, pc);
                    return Verdict::Skip;
                }
            }
        }
        let Slot { marks, length, .. } = *self.code.slot(place);
        if marks & mark::BREAKPOINT != 0 && self.reported.take() != Some(pc) {
            return Verdict::Stop;
        }
        if let Some(profile) = &mut self.profile {
            *profile.entry(pc).or_default() += 1;
        }
        let cpu = &mut self.cpu;
        if marks & mark::LINE != 0 {
            cpu.wait_for_fetch(pc, length);
        }
        if in_it {
            let condition = cpu.it >> 4;
            cpu.it = it_advance(cpu.it);
            if !cpu.flags.holds(condition) {
                cpu.r[15] = pc.wrapping_add(length.into());
                cpu.cycle += 1;
                cpu.instructions += 1;
                return Verdict::Skip;
            }
        }
        Verdict::Execute(place)
    }

    /// Decodes the instruction at an address, and in memory those after it, up to an unconditional branch. Returns the
    /// index of the first.
    fn decode_run(&mut self, bus: &mut dyn Bus, pc: u32) -> Result<usize, Trap> {
        let (mut at, mut it) = (pc, self.cpu.it);
        let first = self.decode(bus, at, it & 15 != 0)?;
        let mut place = first;
        for _ in 1..LONGEST_RUN {
            let Slot { op, length, .. } = *self.code.slot(place);
            it = match op {
                Op::It { state } => state,
                _ => it_advance(it),
            };
            at = at.wrapping_add(length.into());
            if op.leads_elsewhere() || !self.cpu.memory.is_fetched_plainly(at) || self.code.place(at) != 0 {
                break;
            }
            match self.decode(bus, at, it & 15 != 0) {
                Ok(next) => place = next,
                Err(_) => break,
            }
        }
        self.code.end_run();
        Ok(first)
    }

    /// Decodes and stores the instruction at an address. Returns its index.
    fn decode(&mut self, bus: &mut dyn Bus, pc: u32, in_it: bool) -> Result<usize, Trap> {
        let cpu = &mut self.cpu;
        let (op, length) = decode_at(cpu, bus, pc, in_it)?;
        let next = match cpu.clock.timing() {
            Timing::OneCycle => Op::Undefined,
            Timing::CortexM4(_) => peek(&cpu.memory, pc.wrapping_add(length.into())),
        };
        let in_flash = cpu.memory.flash.contains(pc);
        let marks = [
            (in_it, mark::IN_IT),
            (cpu.breakpoints.contains(&pc), mark::BREAKPOINT),
            (self.profile.is_some(), mark::COUNTED),
            (in_flash && cpu.clock.flash_waits, mark::LINE),
        ];
        let slot = Slot {
            op,
            length,
            cycles: cpu.clock.cycles(op, next),
            marks: marks.iter().filter(|(is_set, _)| *is_set).map(|(_, mark)| mark).sum(),
        };
        // The cost of an instruction depends on the next one: the longest pair has 8 bytes.
        cpu.memory.note_decoded(pc, 8);
        Ok(self.code.keep(pc, slot))
    }

    /// The cycles since the core's creation. They do not advance while it sleeps or is stopped, except by
    /// [`Core::advance`].
    pub fn cycle(&self) -> u64 {
        self.cpu.cycle
    }

    /// The number of executed instructions, including those that failed their condition.
    pub fn instructions(&self) -> u64 {
        self.cpu.instructions
    }

    /// Advances the cycles without instructions, for a core that sleeps or waits for its flash.
    pub fn advance(&mut self, cycle: u64) {
        self.cpu.cycle = self.cpu.cycle.max(cycle);
    }

    /// The address of the next instruction.
    pub fn pc(&self) -> u32 {
        self.cpu.r[15]
    }

    /// Returns true if the core was asleep when it last checked.
    pub fn is_asleep(&self) -> bool {
        self.cpu.sleep != Sleep::Awake
    }

    /// Flash and RAM.
    pub fn memory(&self) -> &Memory {
        &self.cpu.memory
    }

    /// Flash and RAM, for changes by a DMA controller, a flash controller, a debugger.
    pub fn memory_mut(&mut self) -> &mut Memory {
        &mut self.cpu.memory
    }

    /// Sets the level of an interrupt line. A rising edge pends the interrupt, and a high level keeps it pending.
    pub fn set_interrupt_line(&mut self, interrupt: u16, high: bool) {
        if self.cpu.nvic.set_line(interrupt, high) {
            self.cpu.request_service();
        }
    }

    /// Pends an interrupt, as a pulse on its line does.
    pub fn pend_interrupt(&mut self, interrupt: u16) {
        self.cpu.nvic.pend(interrupt + fault::exception::INTERRUPT_0);
        self.cpu.request_service();
    }

    /// Pends the NMI.
    pub fn pend_nmi(&mut self) {
        self.cpu.nvic.pend(fault::exception::NMI);
        self.cpu.request_service();
    }

    /// Sets the event register of WFE, as a pulse on the core's event input does.
    pub fn send_event(&mut self) {
        self.cpu.event = true;
        self.cpu.request_service();
    }

    /// Changes the counting of cycles from now on.
    pub fn set_timing(&mut self, timing: Timing) {
        if self.cpu.clock.timing() != timing {
            self.cpu.clock = Clock::new(timing);
            self.cpu.memory.note_change_of_all();
        }
    }

    /// Makes [`Core::run`] stop before the instruction at this address.
    pub fn set_breakpoint(&mut self, address: u32) {
        self.cpu.breakpoints.insert(address & !1);
        self.cpu.memory.note_change_of(address & !1);
    }

    /// Removes a breakpoint.
    pub fn clear_breakpoint(&mut self, address: u32) {
        self.cpu.breakpoints.remove(&(address & !1));
        self.cpu.memory.note_change_of(address & !1);
    }

    /// Number of executions of each instruction since the last call. The first call starts the count.
    pub fn take_profile(&mut self) -> BTreeMap<u32, u64> {
        if self.profile.is_none() {
            self.profile = Some(BTreeMap::new());
            self.cpu.memory.note_change_of_all();
        }
        self.profile.replace(BTreeMap::new()).unwrap_or_default()
    }

    /// Reads a register.
    pub fn register(&self, register: Register) -> u32 {
        let cpu = &self.cpu;
        match register {
            Register::R(number) => cpu.r[usize::from(number & 15)],
            Register::Xpsr => cpu.xpsr(),
            Register::Msp => cpu.main_sp(),
            Register::Psp => cpu.process_sp(),
            Register::Primask => cpu.primask.into(),
            Register::Basepri => cpu.basepri.into(),
            Register::Faultmask => cpu.faultmask.into(),
            Register::Control => cpu.control.into(),
        }
    }

    /// Writes a register, as a debugger does. The exception number in xPSR stays.
    pub fn set_register(&mut self, register: Register, value: u32) {
        let cpu = &mut self.cpu;
        match register {
            Register::R(13) => cpu.set_or_sp(op::Reg::SP, value),
            Register::R(15) => cpu.r[15] = value & !1,
            Register::R(number) => cpu.r[usize::from(number & 15)] = value,
            Register::Xpsr => cpu.set_xpsr(value),
            Register::Msp => cpu.set_main_sp(value),
            Register::Psp => cpu.set_process_sp(value),
            Register::Primask => cpu.primask = value & 1 != 0,
            Register::Basepri => cpu.basepri = cpu.nvic.mask_priority(value),
            Register::Faultmask => cpu.faultmask = value & 1 != 0,
            Register::Control => cpu.change_mode(cpu.exception, value as u8 & 3),
        }
        cpu.request_service();
    }

    /// Reads memory or a register as a debugger does: without faults and cycles. `None` for a hole, or for an unaligned
    /// address.
    pub fn debug_read(&mut self, bus: &mut dyn Bus, address: u32, width: Width) -> Option<u32> {
        let is_aligned = address.is_multiple_of(width.bytes());
        is_aligned.then(|| self.cpu.debug_read(bus, address, width)).flatten()
    }

    /// Writes memory or a register as a debugger does: without faults and cycles. Writes to flash go to the bus. `None`
    /// for a hole, or for an unaligned address.
    pub fn debug_write(&mut self, bus: &mut dyn Bus, address: u32, value: u32, width: Width) -> Option<()> {
        let is_aligned = address.is_multiple_of(width.bytes());
        is_aligned
            .then(|| self.cpu.debug_write(bus, address, value, width))
            .flatten()
    }

    /// The fault status registers: CFSR, HFSR, MMFAR, BFAR (B3.2.15 to B3.2.18).
    pub fn fault_status(&self) -> [u32; 4] {
        let scb = &self.cpu.scb;
        [scb.cfsr, scb.hfsr, scb.mmfar, scb.bfar]
    }
}

/// ITAdvance() (A7.3.3).
fn it_advance(state: u8) -> u8 {
    if state & 7 == 0 {
        0
    } else {
        state & 0xe0 | state << 1 & 0x1f
    }
}

/// Fetches and decodes an instruction. Returns its length in bytes, too.
fn decode_at(cpu: &mut Cpu, bus: &mut dyn Bus, pc: u32, in_it: bool) -> Result<(Op, u8), Trap> {
    let first = cpu.fetch(bus, pc)?;
    if !decode::is_wide(first) {
        return Ok((decode::decode_16(pc, first, in_it), 2));
    }
    let second = cpu.fetch(bus, pc.wrapping_add(2))?;
    Ok((decode::decode_32(pc, first, second), 4))
}

/// The instruction at an address in memory, for its registers only: the IT block is irrelevant.
fn peek(memory: &Memory, pc: u32) -> Op {
    let halfword = |address| memory.read(address, Width::Half).unwrap_or(0);
    match halfword(pc) {
        first if decode::is_wide(first) => decode::decode_32(pc, first, halfword(pc.wrapping_add(2))),
        first => decode::decode_16(pc, first, false),
    }
}
