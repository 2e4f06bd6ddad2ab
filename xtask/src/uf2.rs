//! Firmware files for the boot loader in the RP2040's ROM: UF2 (<https://github.com/microsoft/uf2>).

use crate::program::Segment;

/// Marks of a block: its first two words, and its last.
const START: [u32; 2] = [0x0A32_4655, 0x9E5D_5157];
const END: u32 = 0x0AB1_6F30;

/// The block names the family of the chip.
const HAS_FAMILY: u32 = 0x2000;

/// The family of the RP2040.
const RP2040: u32 = 0xE48B_FF56;

/// Bytes of flash in a block: a page. The ROM writes only whole and aligned ones (RP2040 datasheet 2.8.4.2).
const PAGE: u32 = 256;

/// Bytes of a block before its end mark, with unused ones.
const BLOCK: usize = 508;

/// Value of an erased byte of flash.
const ERASED: u8 = 0xFF;

/// The file: a block for each page of the segments, which are sorted by address. The boot loader erases only the
/// sectors of these pages.
pub(crate) fn file(segments: &[Segment]) -> Vec<u8> {
    let pages = pages(segments);
    let mut file = Vec::new();
    for (number, (address, page)) in (0_u32..).zip(&pages) {
        let fields = [HAS_FAMILY, *address, PAGE, number, pages.len() as u32, RP2040];
        let mut block: Vec<u8> = START.into_iter().chain(fields).flat_map(u32::to_le_bytes).collect();
        block.extend(page);
        block.resize(BLOCK, 0);
        block.extend(END.to_le_bytes());
        file.extend(block);
    }
    file
}

/// The pages by address, with erased bytes around the segments.
fn pages(segments: &[Segment]) -> Vec<(u32, Vec<u8>)> {
    let mut pages: Vec<(u32, Vec<u8>)> = Vec::new();
    for segment in segments {
        for (address, byte) in (segment.address..).zip(&segment.bytes) {
            let start = address - address % PAGE;
            if pages.last().is_none_or(|(last, _)| *last != start) {
                pages.push((start, vec![ERASED; PAGE as usize]));
            }
            if let Some((_, page)) = pages.last_mut() {
                page[(address - start) as usize] = *byte;
            }
        }
    }
    pages
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_page_has_one_block() {
        let segments = [
            Segment {
                address: 0x1000_0000,
                bytes: vec![1; 300],
            },
            Segment {
                address: 0x1000_0180,
                bytes: vec![2; 1],
            },
            Segment {
                address: 0x1000_1004,
                bytes: vec![3; 2],
            },
        ];
        let file = file(&segments);
        let blocks: Vec<_> = file.chunks(512).collect();
        assert_eq!(blocks.len(), 3);
        // The header of the specification's example, with the family in place of the file's size.
        assert_eq!(
            blocks[1][..32],
            [
                0x55, 0x46, 0x32, 0x0A, 0x57, 0x51, 0x5D, 0x9E, 0x00, 0x20, 0, 0, 0, 1, 0, 0x10, 0, 1, 0, 0, 1, 0, 0,
                0, 3, 0, 0, 0, 0x56, 0xFF, 0x8B, 0xE4,
            ]
        );
        assert_eq!(blocks[0][32..288], [1; 256]);
        let mut second = [ERASED; 256];
        second[..44].fill(1);
        second[0x80] = 2;
        assert_eq!(blocks[1][32..288], second);
        assert_eq!(blocks[2][12..16], 0x1000_1000_u32.to_le_bytes());
        assert_eq!(
            blocks[2][32..40],
            [ERASED, ERASED, ERASED, ERASED, 3, 3, ERASED, ERASED]
        );
        for block in blocks {
            assert_eq!(block.len(), 512);
            assert_eq!(block[288..508], [0; 220]);
            assert_eq!(block[508..], [0x30, 0x6F, 0xB1, 0x0A]);
        }
    }
}
