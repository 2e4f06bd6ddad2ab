//! The flash content in an ELF file.

use anyhow::{Context, Result, bail, ensure};
use object::Endianness;
use object::elf::{FileHeader32, PT_LOAD, SHT_SYMTAB};
use object::read::elf::{FileHeader, ProgramHeader, Sym};

/// Start of RAM on every Cortex-M.
const RAM: u32 = 0x2000_0000;

/// The symbols at the ends of the program's part of the flash and of the RAM, in the memory files of the boards.
const FLASH_END: &[u8] = b"_flash_end";
const DATA_END: &[u8] = b"_data_end";

/// Length of a gap in flash that remains a gap, in bytes. A shorter one is alignment between parts of a program, possibly
/// within a sector, and is filled. All sectors are longer.
const SMALL_GAP: u32 = 1024;

/// Value of an erased byte of flash.
const ERASED: u8 = 0xFF;

#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Program {
    /// The flash content by address, with gaps in between that may have other content.
    pub(crate) segments: Vec<Segment>,
    /// The end of the flash that the program may have, if its memory file tells.
    pub(crate) flash_end: Option<u32>,
    /// The end of the RAM that its data may have, if its memory file tells.
    pub(crate) data_end: Option<u32>,
    /// RAM usage without the stack, in bytes.
    pub(crate) ram: u64,
    /// The end of its data in RAM.
    pub(crate) ram_end: u32,
}

/// Bytes in flash.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Segment {
    /// Address of the first byte.
    pub(crate) address: u32,
    pub(crate) bytes: Vec<u8>,
}

impl Program {
    /// The program in an ELF file.
    ///
    /// # Errors
    ///
    /// If the file is no ELF file, or has nothing for the flash.
    pub(crate) fn parse(file: &[u8]) -> Result<Self> {
        let elf = FileHeader32::<Endianness>::parse(file)?;
        let endian = elf.endian()?;
        let (mut segments, mut ram, mut ram_end) = (Vec::new(), 0, RAM);
        for header in elf.program_headers(endian, file)? {
            if header.p_type(endian) != PT_LOAD {
                continue;
            }
            let bytes = header
                .data(endian, file)
                .ok()
                .context("the ELF file ends in a segment")?;
            if !bytes.is_empty() {
                segments.push(Segment {
                    address: header.p_paddr(endian),
                    bytes: bytes.to_vec(),
                });
            }
            if header.p_vaddr(endian) >= RAM {
                ram += u64::from(header.p_memsz(endian));
                ram_end = ram_end.max(header.p_vaddr(endian) + header.p_memsz(endian));
            }
        }
        segments.sort_by_key(|segment| segment.address);
        let segments = joined(segments)?;
        ensure!(!segments.is_empty(), "nothing in the ELF file goes to flash");
        let sections = elf.sections(endian, file)?;
        let symbols = sections.symbols(endian, file, SHT_SYMTAB)?;
        let value = |name| {
            let has_name = |symbol: &&_| Sym::name(*symbol, endian, symbols.strings()) == Ok(name);
            symbols.iter().find(has_name).map(|symbol| symbol.st_value(endian))
        };
        let (flash_end, data_end) = (value(FLASH_END), value(DATA_END));
        Ok(Self {
            segments,
            flash_end,
            data_end,
            ram,
            ram_end,
        })
    }

    /// Checks that the chip starts this program: its first segment has a vector table at `vectors`, with a stack of this
    /// size at the start of the RAM, and a reset handler in flash.
    ///
    /// # Errors
    ///
    /// The first difference, for example because the program was linked for another board.
    pub(crate) fn check_vectors(&self, vectors: u32, stack_size: u32) -> Result<()> {
        let first = &self.segments[0];
        let word = |nth: u32| {
            let offset = (vectors + 4 * nth).checked_sub(first.address)?;
            let bytes = first.bytes.get(offset as usize..)?.first_chunk()?;
            Some(u32::from_le_bytes(*bytes))
        };
        let (Some(stack), Some(reset)) = (word(0), word(1)) else {
            bail!("no vector table at {vectors:#x}");
        };
        ensure!(
            stack == RAM + stack_size,
            "the stack begins at {stack:#x}, the board's at {:#x}",
            RAM + stack_size
        );
        // The lowest bit marks Thumb code.
        let code = reset & !1;
        let in_flash = |segment: &Segment| (segment.address..segment.end()).contains(&code);
        ensure!(
            reset & 1 == 1 && self.segments.iter().any(in_flash),
            "the reset handler is at {reset:#x}, which is not the program's"
        );
        Ok(())
    }

    /// Flash usage in bytes, without the gaps.
    pub(crate) fn flash(&self) -> u64 {
        self.segments.iter().map(|segment| segment.bytes.len() as u64).sum()
    }

    /// The flash behind the program that is left for it, in bytes.
    ///
    /// # Errors
    ///
    /// If the program's memory file does not tell the end of its flash, or the program exceeds it.
    pub(crate) fn flash_left(&self) -> Result<u64> {
        let end = self.segments.last().map_or(0, Segment::end);
        let flash_end = self.flash_end.context("the program has no symbol _flash_end")?;
        let left = flash_end.checked_sub(end).context("the program exceeds its flash")?;
        Ok(left.into())
    }

    /// The RAM that is left for data, in bytes.
    ///
    /// # Errors
    ///
    /// If the program's memory file does not tell the end of its data.
    pub(crate) fn ram_left(&self) -> Result<u64> {
        let end = self.data_end.context("the program has no symbol _data_end")?;
        let left = end.checked_sub(self.ram_end).context("the program exceeds its RAM")?;
        Ok(left.into())
    }

    /// The flash from the start of the first segment to the end of the last one, with erased gaps.
    pub(crate) fn bin(&self) -> Vec<u8> {
        let mut bin = Vec::new();
        for segment in &self.segments {
            let start = segment.address - self.segments[0].address;
            bin.resize(start as usize, ERASED);
            bin.extend(&segment.bytes);
        }
        bin
    }
}

impl Segment {
    fn end(&self) -> u32 {
        self.address + self.bytes.len() as u32
    }
}

/// Joins segments, sorted by address, over small gaps.
fn joined(segments: Vec<Segment>) -> Result<Vec<Segment>> {
    let mut all: Vec<Segment> = Vec::new();
    for segment in segments {
        let Some(last) = all.last_mut() else {
            all.push(segment);
            continue;
        };
        let gap = segment.address.checked_sub(last.end());
        match gap.with_context(|| format!("two segments have address {:#x}", segment.address))? {
            gap @ 0..SMALL_GAP => {
                last.bytes.resize(last.bytes.len() + gap as usize, ERASED);
                last.bytes.extend(segment.bytes);
            }
            _ => all.push(segment),
        }
    }
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn segment(address: u32, bytes: &[u8]) -> Segment {
        Segment {
            address,
            bytes: bytes.to_vec(),
        }
    }

    #[test]
    fn segments_are_joined_over_small_gaps_only() {
        let parts = [
            segment(0x800_0000, &[1, 2, 3]),
            segment(0x800_0004, &[4]),
            segment(0x800_0005, &[5]),
            segment(0x800_0006 + SMALL_GAP, &[6]),
        ];
        let expected = [
            segment(0x800_0000, &[1, 2, 3, 0xFF, 4, 5]),
            segment(0x800_0006 + SMALL_GAP, &[6]),
        ];
        assert_eq!(joined(parts.to_vec()).unwrap(), expected);
    }

    #[test]
    fn overlapping_segments_are_refused() {
        let parts = [segment(0x800_0000, &[1, 2, 3]), segment(0x800_0002, &[4])];
        let error = joined(parts.to_vec()).unwrap_err();
        assert_eq!(error.to_string(), "two segments have address 0x8000002");
    }

    #[test]
    fn bin_has_its_gaps_erased() {
        let program = Program {
            segments: vec![segment(0x800_0000, &[1, 2]), segment(0x800_0005, &[3])],
            flash_end: None,
            data_end: None,
            ram: 0,
            ram_end: RAM,
        };
        assert_eq!(program.bin(), [1, 2, 0xFF, 0xFF, 0xFF, 3]);
        assert_eq!(program.flash(), 3);
    }

    #[test]
    fn flash_left_begins_behind_the_last_segment() {
        let left = |flash_end| {
            let segments = vec![segment(0x800_0000, &[1, 2]), segment(0x800_C000, &[3])];
            Program {
                segments,
                flash_end,
                data_end: None,
                ram: 0,
                ram_end: RAM,
            }
            .flash_left()
        };
        assert_eq!(left(Some(0x800_C005)).unwrap(), 4);
        assert_eq!(left(Some(0x800_C001)).unwrap(), 0);
        assert!(left(Some(0x800_C000)).is_err());
        assert!(left(None).is_err());
    }

    #[test]
    fn ram_left_begins_behind_the_data() {
        let left = |data_end| {
            Program {
                segments: Vec::new(),
                flash_end: None,
                data_end,
                ram: 8,
                ram_end: RAM + 1_008,
            }
            .ram_left()
        };
        assert_eq!(left(Some(RAM + 1_024)).unwrap(), 16);
        assert!(left(Some(RAM + 1_000)).is_err());
        assert!(left(None).is_err());
    }

    #[test]
    fn program_for_another_board_is_refused() {
        const VECTORS: u32 = 0x0800_0000;
        let program = |address, words: [u32; 3]| Program {
            segments: vec![segment(address, &words.map(u32::to_le_bytes).concat())],
            flash_end: None,
            data_end: None,
            ram: 0,
            ram_end: RAM,
        };
        let good = [0x2000_5800, VECTORS + 9, 0];
        assert!(program(VECTORS, good).check_vectors(VECTORS, 0x5800).is_ok());
        for (program, stack_size, error) in [
            (
                program(VECTORS, good),
                0x2_0000,
                "the stack begins at 0x20005800, the board's at 0x20020000",
            ),
            (program(VECTORS + 0x4000, good), 0x5800, "no vector table at 0x8000000"),
            (
                program(VECTORS, [0x2000_5800, VECTORS + 8, 0]),
                0x5800,
                "the reset handler is at 0x8000008,",
            ),
            (
                program(VECTORS, [0x2000_5800, VECTORS + 13, 0]),
                0x5800,
                "the reset handler is at 0x800000d,",
            ),
        ] {
            let refused = program.check_vectors(VECTORS, stack_size).unwrap_err().to_string();
            assert!(refused.starts_with(error), "{refused}");
        }
    }

    #[test]
    fn other_files_are_refused() {
        assert!(Program::parse(b"not an ELF file").is_err());
    }
}
