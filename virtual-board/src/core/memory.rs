//! Flash and RAM.
//!
//! The memories record the ranges with decoded instructions, and the changes in them by any writer: the core, a DMA
//! controller, the flash controller, a debugger.

use std::ops::Range;

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

#[derive(Clone, Debug)]
pub(super) struct Region {
    base: u32,
    bytes: Box<[u8]>,
    /// Offsets outside of this range have no decoded instructions.
    decoded: Range<usize>,
    /// Decoded instructions outside of these offsets are unchanged.
    changed: Range<usize>,
}

impl Region {
    fn new(base: u32, mut bytes: Vec<u8>) -> Self {
        // Whole words: an aligned access is either inside or outside.
        bytes.resize(bytes.len().next_multiple_of(4), 0xff);
        Self {
            base,
            bytes: bytes.into(),
            decoded: 0..0,
            changed: 0..0,
        }
    }

    pub(super) fn base(&self) -> u32 {
        self.base
    }

    fn offset(&self, address: u32) -> usize {
        address.wrapping_sub(self.base) as usize
    }

    pub(super) fn len(&self) -> usize {
        self.bytes.len()
    }

    pub(super) fn contains(&self, address: u32) -> bool {
        self.offset(address) < self.bytes.len()
    }

    /// Records that decoded instructions depend on the bytes from this address on. Does nothing outside the memory.
    fn note_decoded(&mut self, address: u32, length: usize) {
        let offset = self.offset(address);
        if offset < self.bytes.len() {
            self.decoded = hull(&self.decoded, offset..offset + length);
        }
    }

    /// Records a change of bytes. Returns true if decoded instructions depend on them.
    #[inline(always)]
    fn note_change(&mut self, bytes: Range<usize>) -> bool {
        let is_decoded = bytes.start < self.decoded.end && bytes.end > self.decoded.start;
        if is_decoded {
            self.changed = hull(&self.changed, bytes);
        }
        is_decoded
    }

    /// Records a change of all bytes.
    fn note_change_of_all(&mut self) {
        self.changed = self.decoded.clone();
    }

    /// Takes the changed offsets. The core drops the dependent instructions.
    fn take_changed(&mut self) -> Range<usize> {
        if self.changed == self.decoded {
            self.decoded = 0..0;
        }
        std::mem::take(&mut self.changed)
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

    /// Writes a byte, halfword or word, from the lowest bits of the value. `None` outside the memory; otherwise true if
    /// decoded instructions depend on it.
    #[inline(always)]
    pub(super) fn write<const BYTES: usize>(&mut self, address: u32, value: u32) -> Option<bool> {
        let offset = self.offset(address);
        let bytes = self.bytes.get_mut(offset..offset.wrapping_add(BYTES))?;
        bytes.copy_from_slice(&value.to_le_bytes()[..BYTES]);
        Some(self.note_change(offset..offset + BYTES))
    }
}

/// The smallest range that contains both.
#[cold]
fn hull(a: &Range<usize>, b: Range<usize>) -> Range<usize> {
    match a.is_empty() {
        true => b,
        false => a.start.min(b.start)..a.end.max(b.end),
    }
}

/// Flash and RAM of the chip. Addresses are absolute.
#[derive(Clone, Debug)]
pub struct Memory {
    pub(super) flash: Region,
    pub(super) ram: Region,
    /// True if the core's loads from flash go to the bus.
    pub(super) flash_loads_on_bus: bool,
    /// True if its fetches do.
    pub(super) flash_fetches_on_bus: bool,
    /// True if the chip requires both.
    chip_checks_reads: bool,
    /// True if the chip requires it for loads.
    chip_answers_loads: bool,
    /// Offsets of the flash whose reads are bus errors.
    unreadable: Range<usize>,
}

impl Memory {
    /// A flash with these bytes, and a RAM of this size in bytes, full of zeros.
    pub fn new(flash_base: u32, flash: Vec<u8>, ram_base: u32, ram_size: usize) -> Self {
        Self {
            flash: Region::new(flash_base, flash),
            ram: Region::new(ram_base, vec![0; ram_size]),
            flash_loads_on_bus: false,
            flash_fetches_on_bus: false,
            chip_checks_reads: false,
            chip_answers_loads: false,
            unreadable: 0..0,
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

    /// Redirects the core's reads of flash to [`Bus::read`](super::Bus::read), while flash errors must be detected. An
    /// instruction is fetched through the bus once; after that it is executed as decoded.
    pub fn set_flash_reads_on_bus(&mut self, on: bool) {
        self.chip_checks_reads = on;
        self.choose_path();
        self.flash.note_change_of_all();
    }

    /// Redirects the core's loads from flash to [`Bus::read`](super::Bus::read), while a cache answers some of them with
    /// another content.
    pub fn set_flash_loads_on_bus(&mut self, on: bool) {
        self.chip_answers_loads = on;
        self.choose_path();
    }

    /// Makes reads of these offsets of the flash bus errors, until one of the bytes changes.
    pub fn break_flash(&mut self, offsets: Range<usize>) {
        self.unreadable = offsets;
        self.choose_path();
        self.flash.note_change_of_all();
    }

    fn choose_path(&mut self) {
        self.flash_fetches_on_bus = self.chip_checks_reads || !self.unreadable.is_empty();
        self.flash_loads_on_bus = self.flash_fetches_on_bus || self.chip_answers_loads;
    }

    /// Changes the flash content from this offset in bytes. `None`, without a change, unless all bytes are inside.
    pub fn program(&mut self, offset: usize, bytes: &[u8]) -> Option<()> {
        let range = offset..offset.checked_add(bytes.len())?;
        self.flash.bytes.get_mut(range.clone())?.copy_from_slice(bytes);
        self.flash.note_change(range.clone());
        if range.start < self.unreadable.end && range.end > self.unreadable.start {
            self.break_flash(0..0);
        }
        Some(())
    }

    /// Reads from flash or RAM, as a DMA controller does. `None` unless the whole transfer is inside.
    pub fn read(&self, address: u32, width: Width) -> Option<u32> {
        let is_broken = !self.unreadable.is_empty() && self.unreadable.contains(&self.flash.offset(address));
        self.read_ram(address, width).or_else(|| match width {
            _ if is_broken => None,
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

    /// Writes to RAM, as a DMA controller does. `None`, without a change, unless the whole transfer is inside.
    pub fn write(&mut self, address: u32, width: Width, value: u32) -> Option<()> {
        let written = match width {
            Width::Byte => self.ram.write::<1>(address, value),
            Width::Half => self.ram.write::<2>(address, value),
            Width::Word => self.ram.write::<4>(address, value),
        };
        written.map(|_| ())
    }

    /// Fills the RAM, byte by byte.
    pub fn fill_ram(&mut self, content: impl FnMut() -> u8) {
        self.ram.bytes.fill_with(content);
        self.ram.note_change_of_all();
    }

    /// Records that decoded instructions depend on the bytes from this address on.
    pub(super) fn note_decoded(&mut self, address: u32, length: usize) {
        self.flash.note_decoded(address, length);
        self.ram.note_decoded(address, length);
    }

    /// Returns true if the core fetches an instruction at this address from this memory without side effects.
    pub(super) fn is_fetched_plainly(&self, address: u32) -> bool {
        let [in_flash, in_ram] =
            [&self.flash, &self.ram].map(|region| region.contains(address) && region.contains(address.wrapping_add(2)));
        in_ram || in_flash && !self.flash_fetches_on_bus
    }

    /// Records that the instruction at this address must be decoded again.
    pub(super) fn note_change_of(&mut self, address: u32) {
        for region in [&mut self.flash, &mut self.ram] {
            let offset = region.offset(address);
            region.note_change(offset..offset.saturating_add(1));
        }
    }

    /// Records that all instructions must be decoded again.
    pub(super) fn note_change_of_all(&mut self) {
        self.flash.note_change_of_all();
        self.ram.note_change_of_all();
    }

    /// Returns true if decoded bytes have changed.
    pub(super) fn has_changed(&self) -> bool {
        !self.flash.changed.is_empty() || !self.ram.changed.is_empty()
    }

    /// Takes the offsets of changed decoded bytes in flash and RAM.
    pub(super) fn take_changed(&mut self) -> [Range<usize>; 2] {
        [self.flash.take_changed(), self.ram.take_changed()]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn broken_flash_is_unreadable_until_it_changes() {
        let mut memory = Memory::new(0x800, vec![0; 64], 0x2000, 16);
        memory.break_flash(8..16);
        let readable = |memory: &Memory| [0x804, 0x808, 0x80C, 0x810].map(|at| memory.read(at, Width::Word).is_some());
        assert_eq!(
            (readable(&memory), memory.flash_loads_on_bus),
            ([true, false, false, true], true)
        );
        memory.program(0, &[0xFF; 8]).unwrap();
        assert_eq!(readable(&memory), [true, false, false, true]);
        memory.program(12, &[0xFF; 4]).unwrap();
        assert_eq!((readable(&memory), memory.flash_loads_on_bus), ([true; 4], false));
        memory.set_flash_reads_on_bus(true);
        memory.break_flash(8..16);
        memory.break_flash(0..0);
        assert!(memory.flash_loads_on_bus);
    }
}
