//! Firmware files for ST's boot loader: DfuSe 1.1a (ST UM0391).

use crc::{CRC_32_JAMCRC, Crc};

use crate::program::Segment;

/// The USB vendor and product of the boot loader in every STM32.
const DEVICE: [u16; 2] = [0x0483, 0xDF11];

/// The device release that the file is for: any.
const ANY_RELEASE: u16 = 0xFFFF;

/// The version of DFU with ST's extensions.
const DFUSE: u16 = 0x011A;

/// The length of a target's name, zeros at its end included.
const NAME: usize = 255;

/// The length of the suffix.
const SUFFIX: u8 = 16;

/// The file for one target, the flash, with an element for each segment. The boot loader erases only the sectors of the
/// elements.
pub(crate) fn file(name: &str, segments: &[Segment]) -> Vec<u8> {
    let mut elements = Vec::new();
    for segment in segments {
        elements.extend(segment.address.to_le_bytes());
        elements.extend((segment.bytes.len() as u32).to_le_bytes());
        elements.extend(&segment.bytes);
    }

    let mut target = b"Target".to_vec();
    target.push(0); // the boot loader's alternate setting for flash
    target.extend(1_u32.to_le_bytes()); // there is a name
    let mut text = name.as_bytes().to_vec();
    text.resize(NAME, 0);
    target.extend(text);
    target.extend((elements.len() as u32).to_le_bytes());
    target.extend((segments.len() as u32).to_le_bytes());
    target.extend(elements);

    const PREFIX: usize = 11;
    let mut file = b"DfuSe\x01".to_vec();
    file.extend(((PREFIX + target.len()) as u32).to_le_bytes());
    file.push(1); // one target
    debug_assert_eq!(file.len(), PREFIX);
    file.extend(target);

    let [vendor, product] = DEVICE;
    for number in [ANY_RELEASE, product, vendor, DFUSE] {
        file.extend(number.to_le_bytes());
    }
    file.extend(b"UFD");
    file.push(SUFFIX);
    // Ethernet's CRC-32 without the final inversion.
    let crc = Crc::<u32>::new(&CRC_32_JAMCRC).checksum(&file);
    file.extend(crc.to_le_bytes());
    file
}

#[cfg(test)]
mod tests {
    use oorandom::Rand32;

    use super::*;
    use crate::image_parser::{Format, Image, parse};

    #[test]
    fn dfuse_file_passes_dfu_suffix() {
        let segments = [
            Segment {
                address: 0x0800_0000,
                bytes: vec![1, 2, 3],
            },
            Segment {
                address: 0x0800_C000,
                bytes: vec![4, 5],
            },
        ];
        let file = file("board", &segments);
        let mut expected = Vec::new();
        expected.extend(b"DfuSe\x01");
        expected.extend([0x32, 0x01, 0, 0, 1]); // 306 bytes before the suffix, one target
        expected.extend(b"Target\x00\x01\x00\x00\x00board");
        expected.extend([0; 250]);
        expected.extend([21, 0, 0, 0, 2, 0, 0, 0]); // 21 bytes in two elements
        expected.extend([0, 0, 0, 8, 3, 0, 0, 0, 1, 2, 3]);
        expected.extend([0, 0xC0, 0, 8, 2, 0, 0, 0, 4, 5]);
        // The suffix that `dfu-suffix --add --vid 0x0483 --pid 0xdf11 --spec 0x011a` appends.
        expected.extend(b"\xFF\xFF\x11\xDF\x83\x04\x1A\x01UFD\x10");
        expected.extend([0x53, 0xD2, 0xA4, 0xB1]);
        assert_eq!(file, expected);
    }

    #[test]
    fn command_reads_every_file_back() {
        let mut random = Rand32::new(1);
        for _ in 0..1_000 {
            // A vector table: the initial stack pointer and the reset handler.
            let mut first = [0x2002_0000_u32, 0x0800_0101].map(u32::to_le_bytes).concat();
            first.resize(8 + random.rand_range(0..300) as usize, 0xA5);
            let mut segments = vec![Segment {
                address: 0x0800_0000,
                bytes: first,
            }];
            for _ in 0..random.rand_range(0..3) {
                segments.push(Segment {
                    address: 0x0800_0000 + random.rand_range(0x4000..0x10_0000),
                    bytes: vec![random.rand_u32() as u8; random.rand_range(1..300) as usize],
                });
            }
            let name: String = (0..random.rand_range(0..20)).map(|_| 'b').collect();
            let image = Image {
                format: Format::DfuSe,
                len: segments.iter().map(|segment| segment.bytes.len()).sum(),
                board: name.clone(),
            };
            assert_eq!(parse(&file(&name, &segments)), Ok(image), "{segments:?}");
        }
    }
}
