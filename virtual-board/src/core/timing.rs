//! What instructions cost.
//!
//! [`Timing::OneCycle`] counts instructions. [`Timing::CortexM4`] follows the tables of the Cortex-M4 Technical Reference
//! Manual (ARM DDI 0439, 3.3), and approximates what they leave open:
//!
//! * The pipeline refill `P` is 1 to 3 cycles there, by alignment and width of the target and by how early the target is
//!   known. Here it is 1 for a branch with an immediate target, 2 for a branch to a register, 3 for a load of the PC.
//! * A load followed by a load or store costs one cycle less, unless it loads an address register of the second. A load or
//!   store whose address comes from the instruction before it costs one cycle more. The order in memory decides, so the
//!   first instruction after a taken branch is not looked at.
//! * A division takes 2 to 12 cycles by the number of bits of its quotient, three bits a cycle.
//! * The write buffer never is full, and a store costs one cycle.
//! * IT is folded and free where a 16-bit instruction precedes it; here it costs one cycle.
//!
//! Flash is read by lines. A line that is not held by the instruction or data cache takes the wait states. With prefetch,
//! the line after the last one that was fetched is under way from that moment. The caches are fully associative and
//! replace the oldest line; contention between fetches, loads and DMA is not counted.

use std::collections::VecDeque;

use super::op::{Hint, Index, Op, Reg};

/// How cycles are counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Timing {
    /// One cycle an instruction, one for an exception's entry.
    #[default]
    OneCycle,
    /// The Cortex-M4's, with this flash.
    CortexM4(FlashTiming),
}

/// The flash as the core sees it. A chip changes it with its flash interface's access control register.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FlashTiming {
    /// Cycles that a line takes beyond the first.
    pub wait_states: u32,
    /// Bytes that the flash delivers at once: a power of two.
    pub line_bytes: u32,
    /// Lines of the instruction cache, at least 1: the line buffer.
    pub code_lines: usize,
    /// Lines of the data cache, 0 while it is off.
    pub data_lines: usize,
    /// Whether the next line is fetched ahead.
    pub prefetch: bool,
}

/// Cycles of a refill of the pipeline.
const REFILL_IMMEDIATE: u8 = 1;
const REFILL_REGISTER: u8 = 2;
const REFILL_LOAD: u8 = 3;

/// The counters of a timing.
#[derive(Clone, Debug)]
pub(super) struct Clock {
    timing: Timing,
    /// Cycles from an exception to its handler's first instruction, without the vector's fetch; 12 in all.
    pub(super) entry: u64,
    pub(super) vector: u64,
    pub(super) exit: u64,
    pub(super) tail_chain: u64,
    /// Cycles that a conditional branch costs more if it is taken.
    pub(super) taken: u64,
    /// Whether a division's cycles depend on its operands, and an unaligned access costs more.
    pub(super) exact: bool,
    /// Whether fetches and loads from flash may have to wait.
    pub(super) flash_waits: bool,
    code: Lines,
    data: Lines,
    /// Bits of an offset within a line.
    line_shift: u32,
    /// The line of the last fetch.
    line: u32,
    /// When the line after it arrives.
    next_line_at: u64,
}

impl Clock {
    pub(super) fn new(timing: Timing) -> Self {
        let (entry, vector, exit, tail_chain, taken) = match timing {
            Timing::OneCycle => (1, 0, 0, 1, 0),
            // Stacking and the vector's fetch overlap; the refill comes last. Exit takes 10 with the BX that it begins with.
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

    /// Cycles of an instruction, given the one after it in memory; without what only shows at run time.
    pub(super) fn cycles(&self, op: Op, next: Op) -> u8 {
        match self.timing {
            Timing::OneCycle => 1,
            Timing::CortexM4(_) => cortex_m4(op, next),
        }
    }

    /// Whether an instruction lies in the line of the last fetch, as a whole.
    #[inline(always)]
    pub(super) fn is_fetched(&self, offset: u32, length: u8) -> bool {
        offset >> self.line_shift == self.line && (offset + u32::from(length) - 1) >> self.line_shift == self.line
    }

    /// Cycles that the fetch of an instruction waits, at this offset in the flash and this cycle.
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

    /// Cycles that a load waits, at this offset in the flash.
    pub(super) fn load_wait(&mut self, offset: u32) -> u64 {
        match self.timing {
            Timing::CortexM4(flash) if !self.data.touch(offset >> self.line_shift) => flash.wait_states.into(),
            _ => 0,
        }
    }

    /// Cycles that a division takes beyond its least (3.3.1, with early termination).
    pub(super) fn divide(dividend: u32, divisor: u32) -> u64 {
        if divisor == 0 {
            return 0;
        }
        let quotient_bits = (divisor.leading_zeros() + 1).saturating_sub(dividend.leading_zeros());
        u64::from(quotient_bits.div_ceil(3).min(10))
    }
}

/// A fully associative cache of flash lines, without what they hold.
#[derive(Clone, Debug)]
struct Lines {
    capacity: usize,
    /// From the oldest.
    held: VecDeque<u32>,
    /// By line: whether it is held.
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

    /// Whether the line is held. It is from now on, unless the cache is off.
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
        Op::LoadMultiple { registers, .. } => {
            let refill = if registers >> 15 != 0 { REFILL_LOAD } else { 0 };
            1 + registers.count_ones() as u8 + refill
        }
        Op::StoreMultiple { registers, .. } => 1 + registers.count_ones() as u8,
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

/// The register that a load of one register writes.
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

/// The registers that make the address of a load or store.
fn address_registers(op: Op) -> [Option<Reg>; 2] {
    match op {
        Op::Ldr { n, .. } | Op::Ldrh { n, .. } | Op::Ldrb { n, .. } => [Some(n), None],
        Op::Str { n, .. } | Op::Strh { n, .. } | Op::Strb { n, .. } => [Some(n), None],
        Op::Load { n, .. } | Op::Store { n, .. } | Op::LoadPc { n, .. } => [Some(n), None],
        Op::LoadUser { n, .. } | Op::StoreUser { n, .. } | Op::Ldrex { n, .. } | Op::Strex { n, .. } => [Some(n), None],
        Op::Ldrd { n, .. } | Op::Strd { n, .. } => [Some(n), None],
        Op::LoadMultiple { n, .. } | Op::StoreMultiple { n, .. } => [Some(n), None],
        Op::LdrReg { n, m, .. } | Op::LdrbReg { n, m, .. } | Op::StrReg { n, m, .. } => [Some(n), Some(m)],
        Op::StrbReg { n, m, .. } | Op::LoadReg { n, m, .. } | Op::StoreReg { n, m, .. } => [Some(n), Some(m)],
        Op::LoadPcReg { n, m, .. } => [Some(n), Some(m)],
        Op::TableBranch { n, m, .. } => [n, Some(m)],
        _ => [None, None],
    }
}

/// The register that a data-processing instruction writes.
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
