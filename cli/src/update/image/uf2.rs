//! Parser for UF2 files, firmware images for the drive of the RP2040's boot loader. Validates a file before it is copied.
//!
//! The format is that of <https://github.com/microsoft/uf2>: blocks, each with its number, its address and a page of
//! flash. The first block also has the board's name and a CRC-32 of all pages, as tags.

use crc::{CRC_32_ISO_HDLC, Crc};
use thiserror::Error;

/// The first two words of each block.
pub(super) const SIGNATURE: [u8; 8] = *b"UF2\nWQ\x5D\x9E";
/// The last word of each block.
const END: [u8; 4] = [0x30, 0x6F, 0xB1, 0x0A];
/// Flags of a block: the family is given, and tags follow the page. No other flag may be set: with some the boot loader
/// ignores a block.
const HAS_FAMILY: u32 = 0x2000;
const HAS_TAGS: u32 = 0x8000;
/// The family of the RP2040.
const RP2040: u32 = 0xE48B_FF56;
/// Tags: the name of the device that the file is for, and one of this project, the CRC-32 of all pages.
const DEVICE: u32 = 0x0065_0D9D;
const CHECKSUM: u32 = 0x005A_3C71;

/// Length of a block, of its head and of its page, in bytes.
const BLOCK: usize = 512;
const HEADER: usize = 32;
const PAGE: usize = 256;
/// Number of blocks of a sector.
const SECTOR: usize = 16;
/// Start address of the flash. The second stage of the boot loader is there, and the vector table follows it.
const FLASH: u32 = 0x1000_0000;
/// Room for the largest flash (RP2040 datasheet 2.6.3).
const FLASH_END: u32 = 0x1100_0000;
/// RAM. The initial stack pointer must lie in it.
const RAM: std::ops::RangeInclusive<u32> = 0x2000_0000..=0x2004_2000;
/// Maximum number of blocks.
const MAX_BLOCKS: u32 = (FLASH_END - FLASH) / PAGE as u32;

/// The reason for a file that is refused.
#[derive(Debug, PartialEq, Eq, Error)]
pub(crate) enum Unfit {
    /// The image is larger than any flash.
    #[error("the image has {0} blocks, more than the {MAX_BLOCKS} of the largest")]
    TooLarge(u32),
    /// The file is too short or too long.
    #[error("the file is truncated or damaged: its length is not that of its blocks")]
    Length,
    /// A block is none that the boot loader takes.
    #[error("the file is damaged: block {0} is malformed")]
    Block(usize),
    /// The checksum is wrong.
    #[error("the file is damaged: its checksum is {got:#010x}, expected {expected:#010x}")]
    Checksum { got: u32, expected: u32 },
    /// The file is for another chip.
    #[error("the file is for chips of the UF2 family {0:#010x}, not for the RP2040, {RP2040:#010x}")]
    Family(u32),
    /// The file does not have the tags of an adapter's image.
    #[error("the file has no board's name and checksum: it is no image of the adapter")]
    NoBoard,
    /// A page is elsewhere than in flash, or the boot loader would not erase its sector.
    #[error("block {block} of the file is for {address:#010x}: the sectors must be whole, ascending and in flash")]
    Address { block: usize, address: u32 },
    /// The bytes at the start of flash are no program.
    #[error("the file has no valid program behind the start of flash, {FLASH:#010x}")]
    NoProgram,
}

/// Returns the length of the file that begins with `head`, in bytes.
pub(super) fn file_len(head: &[u8]) -> Result<usize, Unfit> {
    match u32_at(head, 24)? {
        count @ ..=MAX_BLOCKS => Ok(count as usize * BLOCK),
        count => Err(Unfit::TooLarge(count)),
    }
}

/// Takes a file apart. Returns the board's name and the number of bytes in flash.
pub(super) fn parse(file: &[u8]) -> Result<(String, usize), Unfit> {
    let (blocks, rest) = file.as_chunks::<BLOCK>();
    if file.len() != file_len(file)? || !rest.is_empty() {
        return Err(Unfit::Length);
    }
    let first = blocks.first().ok_or(Unfit::Length)?;
    let family = u32_at(first, 28)?;
    if u32_at(first, 8)? & HAS_FAMILY != 0 && family != RP2040 {
        return Err(Unfit::Family(family));
    }
    let board = tag(first, DEVICE).ok_or(Unfit::NoBoard)?;
    let checksum = tag(first, CHECKSUM).and_then(|bytes| bytes.first_chunk());
    let got = u32::from_le_bytes(*checksum.ok_or(Unfit::NoBoard)?);

    let mut bytes = Vec::new();
    let mut last = None;
    for (number, block) in blocks.iter().enumerate() {
        let address = check(block, number, blocks.len(), last)?;
        bytes.extend(&block[HEADER..HEADER + PAGE]);
        last = Some(address);
    }
    let expected = Crc::<u32>::new(&CRC_32_ISO_HDLC).checksum(&bytes);
    if got != expected {
        return Err(Unfit::Checksum { got, expected });
    }
    // The vector table: the initial stack pointer, and where the program starts, odd for Thumb code.
    let (stack, reset) = (u32_at(&bytes, PAGE)?, u32_at(&bytes, PAGE + 4)?);
    if !RAM.contains(&stack) || !(FLASH..FLASH_END).contains(&reset) || reset % 2 == 0 {
        return Err(Unfit::NoProgram);
    }
    Ok((String::from_utf8_lossy(board).into_owned(), bytes.len()))
}

/// Checks the block of this number, whose predecessor is for the address `last`. Returns its address.
fn check(block: &[u8; BLOCK], number: usize, count: usize, last: Option<u32>) -> Result<u32, Unfit> {
    let flags = HAS_FAMILY | if number == 0 { HAS_TAGS } else { 0 };
    let fields = [
        (8, flags),
        (16, PAGE as u32),
        (20, number as u32),
        (24, count as u32),
        (28, RP2040),
    ];
    let mut is_well_formed = block.starts_with(&SIGNATURE) && block.ends_with(&END);
    for (at, value) in fields {
        is_well_formed &= u32_at(block, at)? == value;
    }
    if !is_well_formed {
        return Err(Unfit::Block(number));
    }
    let address = u32_at(block, 12)?;
    // The boot loader counts blocks to find the sectors that it erases (RP2040-E14).
    let is_erased = match last {
        None => address == FLASH,
        Some(last) if number.is_multiple_of(SECTOR) => {
            address > last && (address as usize).is_multiple_of(SECTOR * PAGE)
        }
        Some(last) => address == last + PAGE as u32,
    };
    match is_erased && address < FLASH_END {
        true => Ok(address),
        false => Err(Unfit::Address { block: number, address }),
    }
}

/// The value of a tag. A tag is its length, its 24-bit type and its value, padded to words; an empty one is the last.
fn tag(block: &[u8; BLOCK], kind: u32) -> Option<&[u8]> {
    let mut rest = &block[HEADER + PAGE..BLOCK - END.len()];
    loop {
        let head = u32_at(rest, 0).ok()?;
        let value = rest.get(4..(head & 0xFF) as usize)?;
        if head >> 8 == kind {
            return Some(value);
        }
        rest = rest.get(4 + value.len().next_multiple_of(4)..)?;
    }
}

fn u32_at(bytes: &[u8], at: usize) -> Result<u32, Unfit> {
    let bytes = bytes.get(at..).and_then(|bytes| bytes.first_chunk());
    bytes.map(|bytes| u32::from_le_bytes(*bytes)).ok_or(Unfit::Length)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An image of two sectors, with a gap of one between them.
    fn pages() -> Vec<(u32, [u8; PAGE])> {
        let addresses = (0..SECTOR as u32).chain(2 * SECTOR as u32..3 * SECTOR as u32);
        let mut pages: Vec<_> = addresses.map(|n| (FLASH + 256 * n, [n as u8; PAGE])).collect();
        pages[1].1[..8].copy_from_slice(&[0, 0, 4, 0x20, 0xA1, 1, 0, 0x10]);
        pages
    }

    /// A file with these pages, and tags with this name.
    fn file(pages: &[(u32, [u8; PAGE])], name: &[u8]) -> Vec<u8> {
        let bytes: Vec<u8> = pages.iter().flat_map(|(_, page)| *page).collect();
        let checksum = Crc::<u32>::new(&CRC_32_ISO_HDLC).checksum(&bytes);
        let mut tags = vec![4 + name.len() as u8, 0x9D, 0x0D, 0x65];
        tags.extend(name);
        tags.resize(tags.len().next_multiple_of(4), 0);
        tags.extend([8, 0x71, 0x3C, 0x5A]);
        tags.extend(checksum.to_le_bytes());
        let mut file = Vec::new();
        for (number, (address, page)) in pages.iter().enumerate() {
            let start = file.len();
            let flags = if number == 0 { 0xA000 } else { 0x2000 };
            file.extend(SIGNATURE);
            for word in [flags, *address, 256, number as u32, pages.len() as u32, RP2040] {
                file.extend(word.to_le_bytes());
            }
            file.extend(page);
            file.extend(if number == 0 { &tags[..] } else { &[] });
            file.resize(start + BLOCK - END.len(), 0);
            file.extend(END);
        }
        file
    }

    /// The file with this word of the block with this number.
    fn with_word(mut file: Vec<u8>, block: usize, at: usize, word: u32) -> Vec<u8> {
        file[block * BLOCK + at..][..4].copy_from_slice(&word.to_le_bytes());
        file
    }

    #[test]
    fn sectors_with_a_gap_are_an_image() {
        assert_eq!(parse(&file(&pages(), b"board")), Ok(("board".to_owned(), 32 * PAGE)));
        assert_eq!(file_len(&file(&pages(), b"board")[..HEADER]), Ok(32 * BLOCK));
    }

    #[test]
    fn every_damaged_page_and_shortened_file_is_refused() {
        let good = file(&pages()[..SECTOR], b"board");
        for block in 0..SECTOR {
            for byte in 0..HEADER + PAGE {
                let mut bad = good.clone();
                bad[block * BLOCK + byte] ^= 1 << (byte % 8);
                assert!(parse(&bad).is_err(), "byte {byte} of block {block}");
            }
        }
        for len in 0..good.len() {
            assert!(parse(&good[..len]).is_err(), "{len} bytes");
        }
    }

    #[test]
    fn file_for_another_chip_is_refused() {
        // The RP2350, in a file without tags.
        let other = with_word(file(&pages(), b""), 0, 28, 0xE48B_FF59);
        assert_eq!(parse(&other), Err(Unfit::Family(0xE48B_FF59)));
        // The chip of a block in the middle.
        let mixed = with_word(file(&pages(), b"board"), 3, 28, 0xE48B_FF59);
        assert_eq!(parse(&mixed), Err(Unfit::Block(3)));
    }

    #[test]
    fn file_without_a_board_is_refused() {
        let file = file(&pages(), b"board");
        assert_eq!(parse(&with_word(file.clone(), 0, 288, 0)), Err(Unfit::NoBoard));
        // A tag beyond the block.
        assert_eq!(parse(&with_word(file, 0, 288, 0x0065_0DFF)), Err(Unfit::NoBoard));
    }

    #[test]
    fn pages_that_would_not_be_erased_are_refused() {
        let at = |block: usize, address: u32| {
            let mut pages = pages();
            pages[block].0 = address;
            assert_eq!(parse(&file(&pages, b"board")), Err(Unfit::Address { block, address }));
        };
        at(0, FLASH + 4096);
        at(0, 0x2000_0000);
        at(5, FLASH + 4 * 256);
        at(5, FLASH + 6 * 256);
        at(16, FLASH + 16 * 256 + 256);
        at(16, FLASH);
        at(16, FLASH_END);
    }

    #[test]
    fn start_without_a_program_is_refused() {
        let mut pages = pages();
        pages[1].1[..8].fill(0xFF);
        assert_eq!(parse(&file(&pages, b"board")), Err(Unfit::NoProgram));
    }

    #[test]
    fn number_of_blocks_is_limited() {
        let huge = with_word(file(&pages(), b"board"), 0, 24, u32::MAX);
        assert_eq!(file_len(&huge), Err(Unfit::TooLarge(u32::MAX)));
        let none = with_word(file(&pages(), b"board"), 0, 24, 0);
        assert_eq!(parse(&none), Err(Unfit::Length));
    }
}
