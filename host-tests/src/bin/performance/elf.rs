//! The ELF file of a program for a microcontroller, and the high-water mark of its stack.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use object::Endianness;
use object::elf::{FileHeader32, PT_LOAD};
use object::read::elf::{FileHeader, ProgramHeader};
use object::{Object, ObjectSegment, ObjectSymbol, SymbolSection};

use crate::Result;

/// Start of flash and RAM, on all chips.
pub(crate) const FLASH: u32 = 0x0800_0000;
pub(crate) const RAM: u32 = 0x2000_0000;

/// A word that no program writes into its stack.
pub(crate) const PAINT: u32 = 0x5AFE_C0DE;

pub(crate) struct Elf {
    /// The flash from its start to the last byte of code and constants, and the number of bytes of the program, with the
    /// initial values of variables.
    pub(crate) flash: Vec<u8>,
    pub(crate) flash_bytes: usize,
    /// The end of the program in flash, behind the initial values of variables.
    flash_end: u32,
    /// The bytes of RAM for variables.
    pub(crate) ram_bytes: u32,
    /// The addresses of functions by their mangled names.
    pub(crate) symbols: BTreeMap<String, u32>,
}

impl Elf {
    pub(crate) fn read(path: &Path) -> Result<Self> {
        let bytes = fs::read(path).map_err(|error| format!("{}: {error}", path.display()))?;
        let file = object::File::parse(&*bytes)?;
        let (mut flash, mut flash_bytes, mut ram_bytes) = (Vec::new(), 0, 0);
        for segment in file.segments() {
            let (address, data) = (segment.address() as u32, segment.data()?);
            flash_bytes += data.len();
            if address >= RAM {
                ram_bytes += segment.size() as u32;
            } else {
                flash.resize((address - FLASH) as usize, 0xFF);
                flash.extend(data);
            }
        }
        let header = FileHeader32::<Endianness>::parse(&*bytes)?;
        let endian = header.endian()?;
        let loaded = header.program_headers(endian, &*bytes)?.iter();
        let ends = loaded
            .filter(|segment| segment.p_type(endian) == PT_LOAD && segment.p_filesz(endian) > 0)
            .map(|segment| segment.p_paddr(endian) + segment.p_filesz(endian));
        let flash_end = ends.max().unwrap_or(FLASH);
        let symbols = file.symbols().filter_map(|symbol| {
            let name = symbol.name().ok()?.to_owned();
            let is_defined = symbol.is_definition() || symbol.section() == SymbolSection::Absolute;
            is_defined.then_some((name, symbol.address() as u32 & !1))
        });
        let symbols = symbols.collect();
        Ok(Self {
            flash,
            flash_bytes,
            flash_end,
            ram_bytes,
            symbols,
        })
    }

    /// The bytes of flash behind an image that are left for it. Its memory file defines the symbol.
    pub(crate) fn flash_left(&self) -> Option<u32> {
        self.symbols.get("_flash_end")?.checked_sub(self.flash_end)
    }

    /// The ends of an image's stack.
    ///
    /// # Panics
    ///
    /// If the image has no symbols for them, which its memory file defines.
    pub(crate) fn stack(&self) -> [u32; 2] {
        ["_stack_end", "_stack_start"].map(|name| self.symbols[name])
    }
}

/// The addresses of the words of a stack.
pub(crate) fn words([low, high]: [u32; 2]) -> impl Iterator<Item = u32> {
    (low..high).step_by(4)
}

/// The used bytes of a painted stack.
pub(crate) fn used(stack: [u32; 2], mut read: impl FnMut(u32) -> u32) -> u32 {
    let lowest = words(stack).find(|address| read(*address) != PAINT);
    stack[1] - lowest.unwrap_or(stack[1])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stack_use_ends_at_lowest_changed_word() {
        let stack = [100, 120];
        let used_if = |changed: &[u32]| used(stack, |address| if changed.contains(&address) { 0 } else { PAINT });
        assert_eq!([used_if(&[]), used_if(&[116]), used_if(&[108, 116])], [0, 4, 12]);
    }
}
