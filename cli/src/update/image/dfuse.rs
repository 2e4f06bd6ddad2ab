//! Parser for DfuSe files, ST's form of a firmware image for USB DFU. Validates a file before dfu-util runs.
//!
//! The format is that of ST's UM0391: a prefix, one target with elements, each with its address, and the suffix of the
//! USB DFU specification 1.1 (appendix B) with a CRC-32 of all that is before it.

use crc::{CRC_32_JAMCRC, Crc};
use thiserror::Error;

/// USB vendor and product of the boot loader in ST's chips, which the file is for.
pub(crate) const BOOT_LOADER: (u16, u16) = (0x0483, 0xDF11);

/// The first bytes of a file, with the version of the format.
pub(super) const SIGNATURE: [u8; 6] = *b"DfuSe\x01";
/// `bcdDFU` of a DfuSe file.
const DFUSE_VERSION: u16 = 0x011A;
/// Start address of the chip: its flash, with the vector table in front.
const FLASH: u32 = 0x0800_0000;
/// Room for the largest flash of these chips.
const FLASH_END: u32 = 0x0820_0000;
/// RAM. The initial stack pointer must lie in it.
const RAM: std::ops::RangeInclusive<u32> = 0x1000_0000..=0x2010_0000;
/// Length of the prefix, in bytes.
const PREFIX: usize = 11;
/// Length of the suffix, in bytes.
const SUFFIX: usize = 16;
/// Maximum length of a file without its suffix: the largest flash, and headers.
const MAX_BODY: u32 = FLASH_END - FLASH + 4096;

/// The reason for a file that is refused.
#[derive(Debug, PartialEq, Eq, Error)]
pub(crate) enum Unfit {
    /// The suffix is none of a DfuSe file.
    #[error("the file is damaged: it does not end as a DfuSe file")]
    Suffix,
    /// The image is larger than any flash.
    #[error("the image has {0} bytes, more than the {MAX_BODY} of the largest")]
    TooLarge(u32),
    /// The file is too short or too long.
    #[error("the file is truncated or damaged: its lengths are inconsistent")]
    Length,
    /// The checksum is wrong.
    #[error("the file is damaged: its checksum is {got:#010x}, expected {expected:#010x}")]
    Checksum { got: u32, expected: u32 },
    /// The file is for another USB device.
    #[error(
        "the file is for the USB device {vendor:04x}:{product:04x}, not for the boot loader {:04x}:{:04x}",
        BOOT_LOADER.0,
        BOOT_LOADER.1
    )]
    Device { vendor: u16, product: u16 },
    /// The file does not have exactly one target with data.
    #[error("the file must have exactly one target with data")]
    Targets,
    /// An element has an address outside of flash.
    #[error("the file writes to {0:#010x}, which is not in flash")]
    Address(u32),
    /// The bytes at the start of flash are no program.
    #[error("the file has no valid program at the start address {FLASH:#010x}")]
    NoProgram,
}

/// Returns the length of the file that begins with `head`, in bytes.
pub(super) fn file_len(head: &[u8]) -> Result<usize, Unfit> {
    match u32_at(head, 6)? {
        body @ ..=MAX_BODY => Ok(body as usize + SUFFIX),
        body => Err(Unfit::TooLarge(body)),
    }
}

/// Takes a file apart. Returns the board's name, that of its target, and the number of bytes in flash.
pub(super) fn parse(file: &[u8]) -> Result<(String, usize), Unfit> {
    if file.len() != file_len(file)? {
        return Err(Unfit::Length);
    }
    let (body, suffix) = file.split_last_chunk::<SUFFIX>().ok_or(Unfit::Length)?;
    let (checked, crc) = file.split_last_chunk::<4>().ok_or(Unfit::Length)?;
    if suffix[8..12] != *b"UFD\x10" || u16_at(suffix, 6)? != DFUSE_VERSION {
        return Err(Unfit::Suffix);
    }
    let expected = Crc::<u32>::new(&CRC_32_JAMCRC).checksum(checked);
    let got = u32::from_le_bytes(*crc);
    if got != expected {
        return Err(Unfit::Checksum { got, expected });
    }
    let (product, vendor) = (u16_at(suffix, 2)?, u16_at(suffix, 4)?);
    if (vendor, product) != BOOT_LOADER {
        return Err(Unfit::Device { vendor, product });
    }
    let (prefix, target) = body.split_first_chunk::<PREFIX>().ok_or(Unfit::Length)?;
    let (header, elements) = target.split_first_chunk::<274>().ok_or(Unfit::Length)?;
    // Alternate setting 0 of the boot loader is the flash.
    if prefix[10] != 1 || !header.starts_with(b"Target\x00") {
        return Err(Unfit::Targets);
    }
    if u32_at(header, 266)? as usize != elements.len() {
        return Err(Unfit::Length);
    }
    let name = header[11..266].split(|&byte| byte == 0).next().unwrap_or_default();
    let board = String::from_utf8_lossy(name).into_owned();
    let len = program(elements, u32_at(header, 270)?)?;
    Ok((board, len))
}

/// Number of program bytes in `count` elements. An element is an address, a length and the bytes.
fn program(mut rest: &[u8], count: u32) -> Result<usize, Unfit> {
    let mut len = 0;
    let mut starts = false;
    for _ in 0..count {
        let (address, size) = (u32_at(rest, 0)?, u32_at(rest, 4)?);
        let (bytes, behind) = rest[8..].split_at_checked(size as usize).ok_or(Unfit::Length)?;
        if address < FLASH || u64::from(address) + u64::from(size) > FLASH_END.into() {
            return Err(Unfit::Address(address));
        }
        if address == FLASH {
            // The vector table: the initial stack pointer, and where the program starts, odd for Thumb code.
            let (stack, reset) = (u32_at(bytes, 0)?, u32_at(bytes, 4)?);
            starts = RAM.contains(&stack) && (FLASH..FLASH_END).contains(&reset) && reset % 2 == 1;
        }
        len += bytes.len();
        rest = behind;
    }
    match rest {
        [] if starts => Ok(len),
        [] => Err(Unfit::NoProgram),
        _ => Err(Unfit::Length),
    }
}

fn u16_at(bytes: &[u8], at: usize) -> Result<u16, Unfit> {
    let bytes = bytes.get(at..).and_then(|bytes| bytes.first_chunk());
    bytes.map(|bytes| u16::from_le_bytes(*bytes)).ok_or(Unfit::Length)
}

fn u32_at(bytes: &[u8], at: usize) -> Result<u32, Unfit> {
    let bytes = bytes.get(at..).and_then(|bytes| bytes.first_chunk());
    bytes.map(|bytes| u32::from_le_bytes(*bytes)).ok_or(Unfit::Length)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The front of a program, as it is at the start of flash.
    fn start() -> Vec<u8> {
        let mut program = vec![0; 64];
        program[..4].copy_from_slice(&0x2002_0000_u32.to_le_bytes());
        program[4..8].copy_from_slice(&0x0800_C1A1_u32.to_le_bytes());
        program
    }

    /// A file with these elements, without its suffix.
    fn body(elements: &[(u32, &[u8])]) -> Vec<u8> {
        let mut target = Vec::new();
        for (address, bytes) in elements {
            target.extend(address.to_le_bytes());
            target.extend((bytes.len() as u32).to_le_bytes());
            target.extend(*bytes);
        }
        let mut file = b"DfuSe\x01".to_vec();
        file.extend((285 + target.len() as u32).to_le_bytes());
        file.push(1);
        file.extend(b"Target\x00\x01\0\0\0");
        file.extend(b"board");
        file.extend([0; 250]);
        file.extend((target.len() as u32).to_le_bytes());
        file.extend((elements.len() as u32).to_le_bytes());
        file.extend(target);
        file
    }

    /// The same with a suffix.
    fn sealed(mut file: Vec<u8>, vendor: u16, product: u16) -> Vec<u8> {
        file.extend([0, 0]);
        file.extend(product.to_le_bytes());
        file.extend(vendor.to_le_bytes());
        file.extend([0x1A, 0x01]);
        file.extend(b"UFD\x10");
        file.extend(Crc::<u32>::new(&CRC_32_JAMCRC).checksum(&file).to_le_bytes());
        file
    }

    fn file(elements: &[(u32, &[u8])]) -> Vec<u8> {
        sealed(body(elements), 0x0483, 0xDF11)
    }

    #[test]
    fn one_or_two_pieces_are_an_image() {
        let (program, board) = (start(), "board".to_owned());
        assert_eq!(parse(&file(&[(FLASH, &program)])), Ok((board.clone(), 64)));
        let image = parse(&file(&[(FLASH, &program), (0x0800_C000, &[1; 100])]));
        assert_eq!(image, Ok((board, 164)));
    }

    #[test]
    fn every_damaged_or_shortened_file_is_refused() {
        let good = file(&[(FLASH, &start())]);
        for bit in 0..8 * good.len() {
            let mut bad = good.clone();
            bad[bit / 8] ^= 1 << (bit % 8);
            assert!(parse(&bad).is_err(), "bit {bit}");
        }
        for len in 0..good.len() {
            assert!(parse(&good[..len]).is_err(), "{len} bytes");
        }
    }

    #[test]
    fn file_for_another_device_is_refused() {
        let program = start();
        let device = Unfit::Device {
            vendor: 0x1209,
            product: 0xDF11,
        };
        assert_eq!(parse(&sealed(body(&[(FLASH, &program)]), 0x1209, 0xDF11)), Err(device));
        // The option bytes, which can lock the chip permanently, are at that address.
        assert_eq!(
            parse(&file(&[(FLASH, &program), (0x1FFF_C000, &[0; 4])])),
            Err(Unfit::Address(0x1FFF_C000))
        );
        assert_eq!(
            parse(&file(&[(FLASH_END - 1, &[0; 2])])),
            Err(Unfit::Address(FLASH_END - 1))
        );
        assert_eq!(parse(&file(&[(0x0800_4000, &program)])), Err(Unfit::NoProgram));
        assert_eq!(parse(&file(&[(FLASH, &[0xFF; 64])])), Err(Unfit::NoProgram));
    }

    #[test]
    fn lengths_that_do_not_agree_are_told() {
        let mut short = body(&[(FLASH, &start())]);
        short.push(0);
        assert_eq!(parse(&sealed(short, 0x0483, 0xDF11)), Err(Unfit::Length));
        let mut huge = body(&[(FLASH, &start())]);
        huge[289..293].copy_from_slice(&u32::MAX.to_le_bytes());
        assert_eq!(parse(&sealed(huge, 0x0483, 0xDF11)), Err(Unfit::Length));
    }
}
