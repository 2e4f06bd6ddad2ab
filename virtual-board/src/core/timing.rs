//! Instruction timing.
//!
//! [`Timing::OneCycle`] counts instructions. [`Timing::CortexM4`] follows the tables of the Cortex-M4 Technical
//! Reference Manual (ARM DDI 0439, 3.3), with these approximations:
//!
//! * The manual's pipeline refill `P` is 1 to 3 cycles, by alignment and width of the target and by the time at which
//!   the target is known. Here it is 1 for a branch with an immediate target, 2 for a branch to a register, 3 for a
//!   load of the PC.
//! * A load followed by a load or store costs one cycle less, unless it loads an address register of the second. A load
//!   or store whose address comes from the previous instruction costs one cycle more. The order in memory decides: the
//!   first instruction after a taken branch is not considered.
//! * A division takes 2 to 12 cycles by the number of bits of its quotient, three bits per cycle.
//! * The write buffer is never full, and a store costs one cycle.
//! * IT is folded and free after a 16-bit instruction; here it costs one cycle.
//!
//! Flash is read by lines. A line that is in neither cache takes the wait states. With prefetch, the fetch of the next
//! line starts with each fetched line. The caches are fully associative and replace the oldest line; contention between
//! fetches, loads and DMA is not counted. A fetch from RAM takes no additional cycle.

use std::collections::VecDeque;

use super::op::{Hint, Index, Multiple, Op, Reg};

/// The counting of cycles.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Timing {
    /// One cycle per instruction, one for exception entry.
    #[default]
    OneCycle,
    /// The cycles of a Cortex-M4, with this flash.
    CortexM4(FlashTiming),
}

/// The flash as seen by the core. The chip changes it by its access control register.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FlashTiming {
    /// Additional cycles of a line.
    pub wait_states: u32,
    /// Bytes per flash line: a power of two.
    pub line_bytes: u32,
    /// Lines of the instruction cache, at least 1: the line buffer.
    pub code_lines: usize,
    /// Lines of the data cache, 0 while it is off.
    pub data_lines: usize,
    /// True with prefetch.
    pub prefetch: bool,
}

/// Cycles of a pipeline refill.
const REFILL_IMMEDIATE: u8 = 1;
const REFILL_REGISTER: u8 = 2;
const REFILL_LOAD: u8 = 3;

/// The counters of a timing.
#[derive(Clone, Debug)]
pub(super) struct Clock {
    timing: Timing,
    /// Cycles from an exception to its handler's first instruction, without the vector fetch; 12 in total.
    pub(super) entry: u64,
    pub(super) vector: u64,
    pub(super) exit: u64,
    pub(super) tail_chain: u64,
    /// Additional cycles of a taken conditional branch.
    pub(super) taken: u64,
    /// True if the cycles of a division depend on its operands, and an unaligned access costs more.
    pub(super) exact: bool,
    /// True if fetches and loads from flash may wait.
    pub(super) flash_waits: bool,
    code: Lines,
    data: Lines,
    /// Bits of an offset within a line.
    line_shift: u32,
    /// The line of the last fetch.
    line: u32,
    /// Arrival of the line after it.
    next_line_at: u64,
}

impl Clock {
    pub(super) fn new(timing: Timing) -> Self {
        let (entry, vector, exit, tail_chain, taken) = match timing {
            Timing::OneCycle => (1, 0, 0, 1, 0),
            // Stacking and the vector fetch overlap; the refill comes last. Exit takes 10 cycles including the BX.
            Timing::CortexM4(_) => (10, 2, 7, 6, u64::from(REFILL_IMMEDIATE)),
        };
        let flash = match timing {
            Timing::CortexM4(flash) if flash.wait_states > 0 => Some(flash),
            _ => None,
        };
        Self {
            timing,
            entry,
            vector,
            exit,
            tail_chain,
            taken,
            exact: timing != Timing::OneCycle,
            flash_waits: flash.is_some(),
            code: Lines::new(flash.map_or(0, |flash| flash.code_lines.max(1))),
            data: Lines::new(flash.map_or(0, |flash| flash.data_lines)),
            line_shift: flash.map_or(0, |flash| flash.line_bytes.trailing_zeros()),
            line: u32::MAX,
            next_line_at: 0,
        }
    }

    pub(super) fn timing(&self) -> Timing {
        self.timing
    }

    /// Cycles of an instruction before `next` in memory, except those known only at run time.
    pub(super) fn cycles(&self, op: Op, next: Op) -> u8 {
        match self.timing {
            Timing::OneCycle => 1,
            Timing::CortexM4(_) => cortex_m4(op, next),
        }
    }

    /// Returns true if an instruction lies completely in the line of the last fetch.
    #[inline(always)]
    pub(super) fn is_fetched(&self, offset: u32, length: u8) -> bool {
        offset >> self.line_shift == self.line && (offset + u32::from(length) - 1) >> self.line_shift == self.line
    }

    /// Wait cycles of an instruction fetch, at this offset in the flash and this cycle.
    #[inline(never)]
    pub(super) fn fetch_wait(&mut self, offset: u32, length: u8, cycle: u64) -> u64 {
        let Timing::CortexM4(flash) = self.timing else {
            return 0;
        };
        let mut waited = 0;
        for line in offset >> self.line_shift..=(offset + u32::from(length) - 1) >> self.line_shift {
            if line == self.line {
                continue;
            }
            let now = cycle + waited;
            if !self.code.touch(line) {
                let wait = u64::from(flash.wait_states);
                let ahead = flash.prefetch && line == self.line.wrapping_add(1);
                waited += if ahead {
                    self.next_line_at.saturating_sub(now).min(wait)
                } else {
                    wait
                };
            }
            self.line = line;
            self.next_line_at = cycle + waited + u64::from(flash.wait_states) + 1;
        }
        waited
    }

    /// Wait cycles of a load, at this offset in the flash.
    pub(super) fn load_wait(&mut self, offset: u32) -> u64 {
        match self.timing {
            Timing::CortexM4(flash) if !self.data.touch(offset >> self.line_shift) => flash.wait_states.into(),
            _ => 0,
        }
    }

    /// Cycles of a division above its minimum (3.3.1, with early termination).
    pub(super) fn divide(dividend: u32, divisor: u32) -> u64 {
        if divisor == 0 {
            return 0;
        }
        let quotient_bits = (divisor.leading_zeros() + 1).saturating_sub(dividend.leading_zeros());
        u64::from(quotient_bits.div_ceil(3).min(10))
    }
}

/// A fully associative cache of flash lines, without their content.
#[derive(Clone, Debug)]
struct Lines {
    capacity: usize,
    /// The cached lines, oldest first.
    held: VecDeque<u32>,
    /// By line: true if it is cached.
    is_held: Vec<bool>,
}

impl Lines {
    fn new(capacity: usize) -> Self {
        Self {
            capacity,
            held: VecDeque::new(),
            is_held: Vec::new(),
        }
    }

    /// Returns true if the line is cached, and caches it unless the cache is off.
    fn touch(&mut self, line: u32) -> bool {
        let index = line as usize;
        if self.is_held.len() <= index {
            self.is_held.resize(index + 1, false);
        }
        if self.is_held[index] || self.capacity == 0 {
            return self.is_held[index];
        }
        if self.held.len() == self.capacity
            && let Some(oldest) = self.held.pop_front()
        {
            self.is_held[oldest as usize] = false;
        }
        self.held.push_back(line);
        self.is_held[index] = true;
        false
    }
}

/// Table 3-1 and section 3.3.2 of the manual.
fn cortex_m4(op: Op, next: Op) -> u8 {
    let base = match op {
        Op::Branch { .. } | Op::BranchLink { .. } => 1 + REFILL_IMMEDIATE,
        Op::BranchReg { .. } | Op::BranchLinkReg { .. } | Op::MovPc { .. } | Op::AddPc { .. } => 1 + REFILL_REGISTER,
        Op::TableBranch { .. } => 2 + REFILL_LOAD,
        Op::LoadPc { .. } | Op::LoadPcReg { .. } | Op::LoadPcLiteral { .. } => 2 + REFILL_LOAD,
        Op::Ldrd { .. } | Op::LdrdLiteral { .. } | Op::Strd { .. } => 3,
        Op::LoadMultiple(Multiple { registers, .. }) => {
            let refill = if registers >> 15 != 0 { REFILL_LOAD } else { 0 };
            1 + registers.count_ones() as u8 + refill
        }
        Op::StoreMultiple(Multiple { registers, .. }) => 1 + registers.count_ones() as u8,
        Op::Sdiv { .. } | Op::Udiv { .. } => 2,
        Op::Hint(Hint::Isb) => 1 + REFILL_IMMEDIATE,
        _ if loaded(op).is_some() => 2,
        Op::Strex { .. } => 2,
        _ => 1,
    };
    let address = address_registers(next);
    let uses = |register: Option<Reg>| register.is_some() && address.contains(&register);
    if loaded(op).is_some() {
        // Pipelined with the next load or store.
        base - u8::from(is_single_transfer(next) && !uses(loaded(op)))
    } else {
        base + u8::from(uses(computed(op)))
    }
}

/// The destination of a load of one register.
fn loaded(op: Op) -> Option<Reg> {
    match op {
        Op::Ldr { t, .. } | Op::Ldrh { t, .. } | Op::Ldrb { t, .. } => Some(t),
        Op::LdrReg { t, .. } | Op::LdrbReg { t, .. } | Op::LdrLiteral { t, .. } => Some(t),
        Op::Load { t, .. } | Op::LoadReg { t, .. } | Op::LoadLiteral { t, .. } => Some(t),
        Op::LoadUser { t, .. } | Op::Ldrex { t, .. } => Some(t),
        _ => None,
    }
}

fn is_single_transfer(op: Op) -> bool {
    let store = matches!(
        op,
        Op::Str { .. }
            | Op::Strh { .. }
            | Op::Strb { .. }
            | Op::StrReg { .. }
            | Op::StrbReg { .. }
            | Op::Store { .. }
            | Op::StoreReg { .. }
            | Op::StoreUser { .. }
            | Op::Strex { .. }
    );
    store || loaded(op).is_some()
}

/// The registers in the address of a load or store.
fn address_registers(op: Op) -> [Option<Reg>; 2] {
    match op {
        Op::Ldr { n, .. } | Op::Ldrh { n, .. } | Op::Ldrb { n, .. } => [Some(n), None],
        Op::Str { n, .. } | Op::Strh { n, .. } | Op::Strb { n, .. } => [Some(n), None],
        Op::Load { n, .. } | Op::Store { n, .. } | Op::LoadPc { n, .. } => [Some(n), None],
        Op::LoadUser { n, .. } | Op::StoreUser { n, .. } | Op::Ldrex { n, .. } | Op::Strex { n, .. } => [Some(n), None],
        Op::Ldrd { n, .. } | Op::Strd { n, .. } => [Some(n), None],
        Op::LoadMultiple(Multiple { n, .. }) | Op::StoreMultiple(Multiple { n, .. }) => [Some(n), None],
        Op::LdrReg { n, m, .. } | Op::LdrbReg { n, m, .. } | Op::StrReg { n, m, .. } => [Some(n), Some(m)],
        Op::StrbReg { n, m, .. } | Op::LoadReg { n, m, .. } | Op::StoreReg { n, m, .. } => [Some(n), Some(m)],
        Op::LoadPcReg { n, m, .. } => [Some(n), Some(m)],
        Op::TableBranch { n, m, .. } => [n, Some(m)],
        _ => [None, None],
    }
}

/// The destination of a data-processing instruction.
fn computed(op: Op) -> Option<Reg> {
    match op {
        Op::MovImm { d, .. } | Op::MovImmS { d, .. } | Op::MovTop { d, .. } | Op::MovReg { d, .. } => Some(d),
        Op::MovRegS { d, .. } | Op::AddImm { d, .. } | Op::AddImmS { d, .. } | Op::SubImmS { d, .. } => Some(d),
        Op::AddReg { d, .. } | Op::AddRegS { d, .. } | Op::SubReg { d, .. } | Op::SubRegS { d, .. } => Some(d),
        Op::ShiftImmS { d, .. } | Op::AluImm { d, .. } | Op::AluReg { d, .. } | Op::MovShift { d, .. } => Some(d),
        Op::Mvn { d, .. } | Op::ShiftReg { d, .. } | Op::Uxtb { d, .. } | Op::Uxth { d, .. } => Some(d),
        Op::Extend { d, .. } | Op::ExtendAdd { d, .. } | Op::Ubfx { d, .. } | Op::Sbfx { d, .. } => Some(d),
        Op::Bfi { d, .. } | Op::Bfc { d, .. } | Op::Mul { d, .. } | Op::MulS { d, .. } => Some(d),
        Op::Mla { d, .. } | Op::Mls { d, .. } | Op::Clz { d, .. } | Op::Rev { d, .. } => Some(d),
        // A post-indexed access computes its base register.
        Op::Store { index, n, .. } if index != Index::Offset => Some(n),
        _ => None,
    }
}
