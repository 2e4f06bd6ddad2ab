//! Firmware files for the boot loader in the RP2040's ROM: UF2 (<https://github.com/microsoft/uf2>).

use std::collections::BTreeMap;

use crc::{CRC_32_ISO_HDLC, Crc};

use crate::program::Segment;

/// Marks of a block: its first two words, and its last.
const START: [u32; 2] = [0x0A32_4655, 0x9E5D_5157];
const END: u32 = 0x0AB1_6F30;

/// The block names the family of the chip.
const HAS_FAMILY: u32 = 0x2000;
/// The block has tags behind its bytes of flash.
const HAS_TAGS: u32 = 0x8000;

/// The family of the RP2040.
const RP2040: u32 = 0xE48B_FF56;

/// Tag with the name of the device that the file is for.
const DEVICE: u32 = 0x0065_0D9D;
/// Tag of this project: CRC-32 of all bytes of flash.
const CHECKSUM: u32 = 0x005A_3C71;

/// Bytes of flash in a block: a page. The ROM writes only whole and aligned ones (RP2040 datasheet 2.8.4.2).
const PAGE: usize = 256;

/// Bytes of flash that are erased together.
const SECTOR: usize = 4096;

/// Bytes of a block before its end mark, with unused ones.
const BLOCK: usize = 508;

/// Value of an erased byte of flash.
const ERASED: u8 = 0xFF;

/// The file for the board of this name: blocks for each sector of the segments.
///
/// The sectors are whole. The ROM counts blocks to find the sectors that it erases: behind a sector with missing blocks
/// it would erase others than it writes (RP2040-E14).
pub(crate) fn file(name: &str, segments: &[Segment]) -> Vec<u8> {
    let sectors = sectors(segments);
    let bytes: Vec<u8> = sectors.values().flatten().copied().collect();
    let checksum = Crc::<u32>::new(&CRC_32_ISO_HDLC).checksum(&bytes);
    let tags = [tag(DEVICE, name.as_bytes()), tag(CHECKSUM, &checksum.to_le_bytes())].concat();

    let pages = sectors.iter().flat_map(|(&address, sector)| {
        let addresses = (address..).step_by(PAGE);
        addresses.zip(sector.chunks(PAGE))
    });
    let count = bytes.len() / PAGE;
    let mut file = Vec::new();
    for (number, (address, page)) in (0_u32..).zip(pages) {
        // The last tag is followed by an empty one: unused bytes are zeros.
        let (flags, tags) = match number {
            0 => (HAS_FAMILY | HAS_TAGS, &tags[..]),
            _ => (HAS_FAMILY, &[][..]),
        };
        let fields = [flags, address, PAGE as u32, number, count as u32, RP2040];
        let mut block: Vec<u8> = START.into_iter().chain(fields).flat_map(u32::to_le_bytes).collect();
        block.extend(page);
        block.extend(tags);
        block.resize(BLOCK, 0);
        block.extend(END.to_le_bytes());
        file.extend(block);
    }
    file
}

/// The sectors by address, with erased bytes around the segments.
fn sectors(segments: &[Segment]) -> BTreeMap<u32, Vec<u8>> {
    let mut sectors = BTreeMap::new();
    for segment in segments {
        for (address, byte) in (segment.address..).zip(&segment.bytes) {
            let offset = address as usize % SECTOR;
            let sector = sectors
                .entry(address - offset as u32)
                .or_insert_with(|| vec![ERASED; SECTOR]);
            sector[offset] = *byte;
        }
    }
    sectors
}

/// A tag: its length without the padding, its 24-bit type and its value.
fn tag(kind: u32, value: &[u8]) -> Vec<u8> {
    let len = 4 + value.len();
    let mut tag = (kind << 8 | len as u32).to_le_bytes().to_vec();
    tag.extend(value);
    tag.resize(len.next_multiple_of(4), 0);
    tag
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image_parser::{Format, Image, parse};

    fn segments() -> [Segment; 3] {
        [
            Segment {
                address: 0x1000_0000,
                bytes: vec![1; 300],
            },
            Segment {
                address: 0x1000_0180,
                bytes: vec![2; 1],
            },
            Segment {
                address: 0x1000_2004,
                bytes: vec![3; 2],
            },
        ]
    }

    #[test]
    fn each_page_of_a_touched_sector_has_a_block() {
        let file = file("board", &segments());
        let blocks: Vec<_> = file.chunks(512).collect();
        assert_eq!(blocks.len(), 32);
        // The header of the specification's example, with the family in place of the file's size.
        assert_eq!(
            blocks[1][..32],
            [
                0x55, 0x46, 0x32, 0x0A, 0x57, 0x51, 0x5D, 0x9E, 0x00, 0x20, 0, 0, 0, 1, 0, 0x10, 0, 1, 0, 0, 1, 0, 0,
                0, 32, 0, 0, 0, 0x56, 0xFF, 0x8B, 0xE4,
            ]
        );
        assert_eq!(blocks[0][32..288], [1; 256]);
        let mut second = [ERASED; 256];
        second[..44].fill(1);
        second[0x80] = 2;
        assert_eq!(blocks[1][32..288], second);
        assert_eq!(
            blocks[16][32..40],
            [ERASED, ERASED, ERASED, ERASED, 3, 3, ERASED, ERASED]
        );
        for (number, block) in blocks.iter().enumerate() {
            assert_eq!(block.len(), 512);
            let address = if number < 16 { 0x1000_0000 } else { 0x1000_1000 } + 256 * number as u32;
            assert_eq!(block[12..16], address.to_le_bytes());
            if number > 0 {
                assert_eq!(block[288..508], [0; 220]);
            }
            assert_eq!(block[508..], [0x30, 0x6F, 0xB1, 0x0A]);
        }
    }

    /// The ROM's boot loader: it erases a sector at the first block of each 16, by the blocks' numbers (`virtual_disk.c` of
    /// pico-bootrom-rp2040).
    fn write(flash: &mut [u8], file: &[u8]) {
        let mut is_erased = vec![false; flash.len() / SECTOR];
        for block in file.chunks(512) {
            let word = |at: usize| u32::from_le_bytes(*block[at..].first_chunk().unwrap());
            let (offset, number) = ((word(12) - 0x1000_0000) as usize, word(20) as usize);
            if !std::mem::replace(&mut is_erased[number * PAGE / SECTOR], true) {
                let sector = offset - offset % SECTOR;
                flash[sector..sector + SECTOR].fill(ERASED);
            }
            for (byte, written) in flash[offset..].iter_mut().zip(&block[32..288]) {
                *byte &= written;
            }
        }
    }

    #[test]
    fn rom_writes_every_segment() {
        let segments = segments();
        let mut flash = [0; 4 * SECTOR];
        write(&mut flash, &file("board", &segments));
        for Segment { address, bytes } in &segments {
            let offset = (address - 0x1000_0000) as usize;
            assert_eq!(flash[offset..offset + bytes.len()], *bytes, "{address:#x}");
        }
        // A sector that is not in the file stays.
        assert_eq!(flash[SECTOR..2 * SECTOR], [0; SECTOR]);
    }

    #[test]
    fn first_block_names_the_board() {
        let file = file("board", &segments());
        assert_eq!(file[8..12], [0x00, 0xA0, 0, 0]);
        // Five letters and padding, the checksum, and the end.
        assert_eq!(file[288..300], *b"\x09\x9D\x0D\x65board\0\0\0");
        assert_eq!(file[300..304], [8, 0x71, 0x3C, 0x5A]);
        assert_eq!(file[308..508], [0; 200]);
    }

    #[test]
    fn command_reads_the_file_back() {
        let mut program = vec![0; 0x1_2345];
        program[256..264].copy_from_slice(&[0, 0, 4, 0x20, 1, 2, 0, 0x10]);
        let far = Segment {
            address: 0x1008_0010,
            bytes: vec![7; 5],
        };
        let program = Segment {
            address: 0x1000_0000,
            bytes: program,
        };
        let image = Image {
            format: Format::Uf2,
            board: "pico".to_owned(),
            len: 20 * SECTOR,
        };
        assert_eq!(parse(&file("pico", &[program, far])), Ok(image));
    }
}
