//! CRC-32/ISO-HDLC, as the Ling document has it.
//!
//! A table of 16 entries is 64 bytes, and fits everywhere. One of 256 is 1 KiB and takes half the steps, which is the
//! feature `crc-table`.

/// How many bits a step takes.
#[cfg(not(feature = "crc-table"))]
const BITS: usize = 4;
#[cfg(feature = "crc-table")]
const BITS: usize = 8;

const ENTRIES: usize = 1 << BITS;

/// The polynomial 0x04C11DB7, its bits in the order in which they are sent.
const POLYNOMIAL: u32 = 0xEDB8_8320;

/// What each value of the next bits adds to the rest.
static TABLE: [u32; ENTRIES] = table();

const fn table() -> [u32; ENTRIES] {
    let mut table = [0; ENTRIES];
    let mut entry = 0;
    while entry < ENTRIES {
        let mut crc = entry as u32;
        let mut bit = 0;
        while bit < BITS {
            crc = (crc >> 1) ^ (POLYNOMIAL * (crc & 1));
            bit += 1;
        }
        table[entry] = crc;
        entry += 1;
    }
    table
}

/// The checksum of `bytes`. Four bytes at a time are taken in with one load, which is most of what there is to save.
/// Inlined, it would take registers from what calls it and seldom comes to it.
#[inline(never)]
pub(super) fn crc32(bytes: &[u8]) -> u32 {
    let (words, rest) = bytes.as_chunks::<4>();
    let mut crc = u32::MAX;
    for word in words {
        crc = shift::<32>(crc ^ u32::from_le_bytes(*word));
    }
    for byte in rest {
        crc = shift::<8>(crc ^ u32::from(*byte));
    }
    !crc
}

/// Shifts out so many bits.
#[inline(always)]
fn shift<const N: usize>(mut crc: u32) -> u32 {
    for _ in 0..N / BITS {
        crc = (crc >> BITS) ^ TABLE[crc as usize % ENTRIES];
    }
    crc
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_check_value_of_the_catalogue_comes_out() {
        // https://reveng.sourceforge.io/crc-catalogue/17plus.htm#crc.cat.crc-32-iso-hdlc
        assert_eq!(crc32(b"123456789"), 0xCBF4_3926);
    }

    #[test]
    fn it_is_what_the_definition_says_for_every_length() {
        let bytes: [u8; 80] = core::array::from_fn(|i| (i * 167 + 13) as u8);
        for len in 0..=bytes.len() {
            let mut crc = u32::MAX;
            for byte in &bytes[..len] {
                crc ^= u32::from(*byte);
                for _ in 0..8 {
                    crc = if crc % 2 == 1 { (crc / 2) ^ POLYNOMIAL } else { crc / 2 };
                }
            }
            assert_eq!(crc32(&bytes[..len]), !crc, "{len} bytes");
        }
    }
}
