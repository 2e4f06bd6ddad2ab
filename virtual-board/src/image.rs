//! Firmware images: ELF files for the core.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use object::elf::{FileHeader32, PT_LOAD};
use object::read::elf::{FileHeader, ProgramHeader};
use object::{Architecture, Endianness, Object, ObjectSection, ObjectSymbol, SymbolSection};

use crate::error::Error;
use crate::report::{Crash, crash_of};

/// The section of an image with its vector table, as cortex-m-rt names it.
const VECTOR_TABLE: &str = ".vector_table";

#[derive(Clone, Debug, Default)]
pub(crate) struct Image {
    segments: Vec<(u64, Vec<u8>)>,
    symbols: BTreeMap<String, u64>,
    vector_table: Option<u64>,
}

impl Image {
    /// Reads an ELF file.
    ///
    /// # Errors
    ///
    /// [`Error::Image`] if it cannot be read, or is no ELF file for a 32-bit Arm core.
    pub(crate) fn read(path: &Path) -> Result<Self, Error> {
        let failed = |reason: String| Error::Image {
            path: path.to_owned(),
            reason,
        };
        let bytes = fs::read(path).map_err(|error| failed(error.to_string()))?;
        Self::parse(&bytes).map_err(|error| failed(error.to_string()))
    }

    fn parse(bytes: &[u8]) -> Result<Self, Box<dyn std::error::Error>> {
        let file = object::File::parse(bytes)?;
        if file.architecture() != Architecture::Arm {
            return Err("not an image for an Arm core of 32 bits".into());
        }
        let header = FileHeader32::<Endianness>::parse(bytes)?;
        let endian = header.endian()?;
        let mut segments = Vec::new();
        for segment in header.program_headers(endian, bytes)? {
            if segment.p_type(endian) == PT_LOAD && segment.p_filesz(endian) > 0 {
                let data = segment.data(endian, bytes).map_err(|()| "a segment beyond the end")?;
                segments.push((segment.p_paddr(endian).into(), data.to_vec()));
            }
        }
        let symbols = file
            .symbols()
            .filter(|symbol| symbol.is_definition() || symbol.section() == SymbolSection::Absolute)
            .filter_map(|symbol| Some((symbol.name().ok()?.to_owned(), symbol.address() & !1)));
        Ok(Self {
            segments,
            symbols: symbols.collect(),
            vector_table: file.section_by_name(VECTOR_TABLE).map(|table| table.size()),
        })
    }

    #[cfg(test)]
    pub(crate) fn plain(address: u64, bytes: Vec<u8>) -> Self {
        Self {
            segments: vec![(address, bytes)],
            ..Self::default()
        }
    }

    /// The loaded segments, with their addresses.
    pub(crate) fn segments(&self) -> impl Iterator<Item = (u64, &[u8])> {
        self.segments.iter().map(|(address, bytes)| (*address, &bytes[..]))
    }

    /// The symbols. A function has the address of its first instruction.
    pub(crate) fn symbols(&self) -> &BTreeMap<String, u64> {
        &self.symbols
    }

    /// Size of the vector table in bytes, if there is such a section.
    pub(crate) fn vector_table(&self) -> Option<u64> {
        self.vector_table
    }

    /// Addresses that are reached only in a crash.
    pub(crate) fn crashes(&self) -> BTreeMap<u32, Crash> {
        let crash = |(name, address): (&String, &u64)| Some((u32::try_from(*address).ok()?, crash_of(name)?));
        self.symbols.iter().filter_map(crash).collect()
    }
}
