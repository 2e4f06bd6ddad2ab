//! Flash and RAM, each with the instructions that its bytes were decoded to.
//!
//! One owner for both, so that a change of the bytes drops what was decoded from them, no matter who writes: the core, a
//! DMA controller, the flash controller, a debugger.

use std::ops::Range;

use super::op::Op;

/// The size of a transfer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Width {
    /// 8 bits.
    Byte,
    /// 16 bits.
    Half,
    /// 32 bits.
    Word,
}

impl Width {
    /// The size in bytes.
    pub const fn bytes(self) -> u32 {
        match self {
            Self::Byte => 1,
            Self::Half => 2,
            Self::Word => 4,
        }
    }

    /// The bits of a word that a transfer of this size carries.
    pub const fn mask(self) -> u32 {
        match self {
            Self::Byte => 0xff,
            Self::Half => 0xffff,
            Self::Word => u32::MAX,
        }
    }
}

/// A decoded instruction, as it waits to be executed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Slot {
    pub(super) op: Op,
    /// Bytes of the encoding: 2 or 4.
    pub(super) length: u8,
    /// Cycles, without what only shows at run time.
    pub(super) cycles: u8,
    /// Reasons not to execute the instruction right away: see [`mark`].
    pub(super) marks: u8,
}

/// Reasons not to execute a slot's instruction right away.
pub(super) mod mark {
    /// It has not been decoded.
    pub(in super::super) const NEW: u8 = 1;
    /// It has been decoded as part of an IT block.
    pub(in super::super) const IN_IT: u8 = 2;
    /// It has a breakpoint.
    pub(in super::super) const BREAKPOINT: u8 = 4;
    /// It is counted by the profile.
    pub(in super::super) const COUNTED: u8 = 8;
    /// Its fetch may have to wait for the flash.
    pub(in super::super) const LINE: u8 = 16;
}

impl Slot {
    pub(super) const NEW: Self = Self {
        op: Op::Undefined,
        length: 2,
        cycles: 1,
        marks: mark::NEW,
    };
}

/// A memory with its decoded instructions, by halfword.
#[derive(Clone, Debug)]
pub(super) struct Region {
    base: u32,
    bytes: Box<[u8]>,
    code: Box<[Slot]>,
    /// Nothing is decoded outside these bytes.
    decoded: Range<usize>,
}

impl Region {
    fn new(base: u32, mut bytes: Vec<u8>) -> Self {
        // Whole words: an access that is aligned is inside or outside.
        bytes.resize(bytes.len().next_multiple_of(4), 0xff);
        let code = vec![Slot::NEW; bytes.len() / 2].into();
        Self {
            base,
            bytes: bytes.into(),
            code,
            decoded: 0..0,
        }
    }

    pub(super) fn base(&self) -> u32 {
        self.base
    }

    fn offset(&self, address: u32) -> usize {
        address.wrapping_sub(self.base) as usize
    }

    /// The decoded instruction at an even address, [`Slot::NEW`] if it has not been decoded. `None` outside the memory.
    #[inline(always)]
    pub(super) fn slot(&self, address: u32) -> Option<Slot> {
        self.code.get(self.offset(address) >> 1).copied()
    }

    /// Keeps a decoded instruction. Does nothing outside the memory.
    pub(super) fn keep(&mut self, address: u32, slot: Slot) {
        let offset = self.offset(address);
        if let Some(kept) = self.code.get_mut(offset >> 1) {
            *kept = slot;
            // What the instruction costs depends on the next one: the longest pair has 8 bytes.
            let decoded = offset..offset + 8;
            self.decoded = match self.decoded.is_empty() {
                true => decoded,
                false => self.decoded.start.min(decoded.start)..self.decoded.end.max(decoded.end),
            };
        }
    }

    /// Reads a byte, halfword or word. `None` outside the memory.
    #[inline(always)]
    pub(super) fn read<const BYTES: usize>(&self, address: u32) -> Option<u32> {
        let offset = self.offset(address);
        let bytes = self.bytes.get(offset..offset.wrapping_add(BYTES))?;
        let mut word = [0; 4];
        word[..BYTES].copy_from_slice(bytes);
        Some(u32::from_le_bytes(word))
    }

    /// Writes a byte, halfword or word, the value's lowest. `None` outside the memory.
    #[inline(always)]
    pub(super) fn write<const BYTES: usize>(&mut self, address: u32, value: u32) -> Option<()> {
        let offset = self.offset(address);
        let bytes = self.bytes.get_mut(offset..offset.wrapping_add(BYTES))?;
        bytes.copy_from_slice(&value.to_le_bytes()[..BYTES]);
        if offset < self.decoded.end && offset + BYTES > self.decoded.start {
            self.forget(offset..offset + BYTES);
        }
        Some(())
    }

    /// Drops the instructions that lie in these bytes, or whose cost depends on them.
    #[cold]
    fn forget(&mut self, bytes: Range<usize>) {
        let first = bytes.start.saturating_sub(6) / 2;
        let end = bytes.end.div_ceil(2).min(self.code.len());
        self.code[first.min(end)..end].fill(Slot::NEW);
    }

    fn forget_all(&mut self) {
        self.forget(self.decoded.clone());
        self.decoded = 0..0;
    }
}

/// Flash and RAM of the chip. Addresses are absolute.
#[derive(Clone, Debug)]
pub struct Memory {
    pub(super) flash: Region,
    pub(super) ram: Region,
    /// Whether the core's reads of flash go to the bus.
    pub(super) flash_reads_on_bus: bool,
}

impl Memory {
    /// A flash with these bytes, and a RAM of this size in bytes, full of zeros.
    pub fn new(flash_base: u32, flash: Vec<u8>, ram_base: u32, ram_size: usize) -> Self {
        Self {
            flash: Region::new(flash_base, flash),
            ram: Region::new(ram_base, vec![0; ram_size]),
            flash_reads_on_bus: false,
        }
    }

    /// The contents of the flash.
    pub fn flash(&self) -> &[u8] {
        &self.flash.bytes
    }

    /// The contents of the RAM.
    pub fn ram(&self) -> &[u8] {
        &self.ram.bytes
    }

    /// Sends the core's reads of flash to [`Bus::read`](super::Bus::read), for as long as a flaw in the flash has to be
    /// noticed. An instruction is fetched through the bus once; after that it is executed as decoded.
    pub fn set_flash_reads_on_bus(&mut self, on: bool) {
        self.flash_reads_on_bus = on;
        self.flash.forget_all();
    }

    /// Changes the contents of the flash from this offset in bytes. `None`, and no change, if it is not all inside.
    pub fn program(&mut self, offset: usize, bytes: &[u8]) -> Option<()> {
        let range = offset..offset.checked_add(bytes.len())?;
        self.flash.bytes.get_mut(range.clone())?.copy_from_slice(bytes);
        self.flash.forget(range);
        Some(())
    }

    /// Reads from flash or RAM, as a DMA controller does. `None` if the transfer is not all inside.
    pub fn read(&self, address: u32, width: Width) -> Option<u32> {
        self.read_ram(address, width).or_else(|| match width {
            Width::Byte => self.flash.read::<1>(address),
            Width::Half => self.flash.read::<2>(address),
            Width::Word => self.flash.read::<4>(address),
        })
    }

    pub(super) fn read_ram(&self, address: u32, width: Width) -> Option<u32> {
        match width {
            Width::Byte => self.ram.read::<1>(address),
            Width::Half => self.ram.read::<2>(address),
            Width::Word => self.ram.read::<4>(address),
        }
    }

    /// Writes to RAM, as a DMA controller does. `None`, and no change, if the transfer is not all inside.
    pub fn write(&mut self, address: u32, width: Width, value: u32) -> Option<()> {
        match width {
            Width::Byte => self.ram.write::<1>(address, value),
            Width::Half => self.ram.write::<2>(address, value),
            Width::Word => self.ram.write::<4>(address, value),
        }
    }

    /// Fills the RAM, as after power-on.
    pub fn fill_ram(&mut self, byte: u8) {
        self.ram.bytes.fill(byte);
        self.ram.forget_all();
    }

    pub(super) fn forget_decoded(&mut self) {
        self.flash.forget_all();
        self.ram.forget_all();
    }

    pub(super) fn forget_decoded_at(&mut self, address: u32) {
        for region in [&mut self.flash, &mut self.ram] {
            let offset = region.offset(address);
            if offset < region.bytes.len() {
                region.forget(offset..offset + 1);
            }
        }
    }
}
