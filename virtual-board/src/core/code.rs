//! Decoded instructions.
//!
//! They are stored in runs, in the order of their addresses, independent of their lengths. The core looks up the first
//! one of a run by its address, and steps to the next ones.

use std::ops::Range;

use super::memory::{Memory, Region};
use super::op::Op;

/// A decoded instruction.
#[derive(Clone, Copy, Debug)]
pub(super) struct Slot {
    pub(super) op: Op,
    /// Bytes of the encoding: 2 or 4.
    pub(super) length: u8,
    /// Cycles, except those known only at run time.
    pub(super) cycles: u8,
    /// Reasons for the slow path: see [`mark`].
    pub(super) marks: u8,
}

/// Reasons for the slow path of a slot's instruction.
pub(super) mod mark {
    /// No instruction in this slot. It may be elsewhere, by its address.
    pub(in super::super) const NONE: u8 = 1;
    /// It has been decoded as part of an IT block.
    pub(in super::super) const IN_IT: u8 = 2;
    /// It has a breakpoint.
    pub(in super::super) const BREAKPOINT: u8 = 4;
    /// It is counted by the profile.
    pub(in super::super) const COUNTED: u8 = 8;
    /// Its fetch may wait for the flash.
    pub(in super::super) const LINE: u8 = 16;
}

impl Slot {
    const NONE: Self = Self {
        op: Op::Undefined,
        length: 2,
        cycles: 1,
        marks: mark::NONE,
    };
}

/// The slot for instructions outside both memories, one at a time.
const OUTSIDE: usize = 1;
/// The first slot for instructions in a memory.
const FIRST: usize = 3;

/// The instructions of flash and RAM.
#[derive(Clone, Debug)]
pub(super) struct Code {
    flash: Places,
    ram: Places,
    /// Each instruction is followed by the next one in memory, or by an empty slot. Slot 0 is empty.
    slots: Vec<Slot>,
    /// Number of instructions with a slot.
    kept: usize,
}

/// The slots of a memory's instructions.
#[derive(Clone, Debug)]
struct Places {
    base: u32,
    /// By halfword: 0 for none.
    places: Box<[u32]>,
}

impl Places {
    fn new(region: &Region) -> Self {
        Self {
            base: region.base(),
            places: vec![0; region.len() / 2].into(),
        }
    }

    fn index(&self, address: u32) -> usize {
        address.wrapping_sub(self.base) as usize >> 1
    }
}

impl Code {
    /// No decoded instructions of a memory.
    pub(super) fn new(memory: &Memory) -> Self {
        Self {
            flash: Places::new(&memory.flash),
            ram: Places::new(&memory.ram),
            slots: vec![Slot::NONE; FIRST],
            kept: 0,
        }
    }

    /// The slot index of the instruction at an even address, 0 if not stored.
    #[inline(always)]
    pub(super) fn place(&self, address: u32) -> usize {
        match self.flash.places.get(self.flash.index(address)) {
            Some(place) => *place as usize,
            None => self.place_in_ram(address),
        }
    }

    #[inline(never)]
    fn place_in_ram(&self, address: u32) -> usize {
        self.ram
            .places
            .get(self.ram.index(address))
            .map_or(0, |place| *place as usize)
    }

    /// The instruction at a slot index.
    #[inline(always)]
    pub(super) fn slot(&self, place: usize) -> &Slot {
        self.slots.get(place).unwrap_or(&Slot::NONE)
    }

    /// Stores an instruction, in its old slot or after the last one. Returns its index.
    pub(super) fn keep(&mut self, address: u32, slot: Slot) -> usize {
        let index = self.flash.index(address);
        let place = match self.flash.places.get_mut(index) {
            Some(place) => place,
            None => {
                let index = self.ram.index(address);
                match self.ram.places.get_mut(index) {
                    Some(place) => place,
                    None => {
                        self.slots[OUTSIDE] = slot;
                        return OUTSIDE;
                    }
                }
            }
        };
        if *place == 0 {
            *place = self.slots.len() as u32;
            self.slots.push(slot);
            self.kept += 1;
        } else {
            self.slots[*place as usize] = slot;
        }
        *place as usize
    }

    /// Ends a run: the next stored instruction does not follow the last one.
    pub(super) fn end_run(&mut self) {
        if self.slots.last().is_some_and(|slot| slot.marks & mark::NONE == 0) {
            self.slots.push(Slot::NONE);
        }
    }

    /// Drops the instructions at these offsets in flash and RAM, and those whose cost depends on them.
    pub(super) fn forget(&mut self, offsets: [Range<usize>; 2]) {
        for (region, offsets) in [&mut self.flash, &mut self.ram].into_iter().zip(offsets) {
            let end = offsets.end.div_ceil(2).min(region.places.len());
            let first = (offsets.start.saturating_sub(REACH) / 2).min(end);
            for place in &mut region.places[first..end] {
                if *place != 0 {
                    self.slots[std::mem::take(place) as usize] = Slot::NONE;
                    self.kept -= 1;
                }
            }
        }
        if self.kept == 0 {
            self.slots.truncate(FIRST);
        }
    }
}

/// Number of bytes before a change in which dependent instructions may begin: the longest instruction has 4 bytes, and
/// its cost depends on the next one.
const REACH: usize = 6;
