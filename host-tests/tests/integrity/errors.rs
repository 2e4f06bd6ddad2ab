//! Transmission errors of a frame, each kind exhaustively.

use strum::{Display, VariantArray};

/// A kind of error, displayed as in the tables.
#[derive(Clone, Copy, Debug, Display, PartialEq, Eq, VariantArray)]
pub(crate) enum Kind {
    /// Any one bit is flipped.
    #[strum(to_string = "one bit flipped")]
    OneBit,
    /// Any two bits are flipped.
    #[strum(to_string = "two bits flipped")]
    TwoBits,
    /// Two bits with a distance of at most seven are flipped, and any bits between them. The order is that of a UART:
    /// the lowest bit of a byte first.
    #[strum(to_string = "burst of 2 to 8 bits")]
    Burst,
    /// Any one byte has any other value.
    #[strum(to_string = "one byte replaced")]
    OtherByte,
    /// Any one byte is missing.
    #[strum(to_string = "one byte lost")]
    LostByte,
    /// Any one byte is duplicated.
    #[strum(to_string = "one byte duplicated")]
    ByteTwice,
    /// Any byte is inserted anywhere, including before and after the frame.
    #[strum(to_string = "one byte inserted")]
    ExtraByte,
    /// The frame ends after any number of bytes, at least one.
    #[strum(to_string = "truncated")]
    CutShort,
}

impl Kind {
    /// Calls `visit` with the frame under each error of this kind.
    pub(crate) fn each(self, frame: &[u8], mut visit: impl FnMut(&[u8])) {
        let (bytes, bits) = (frame.len(), 8 * frame.len());
        match self {
            Self::OneBit => (0..bits).for_each(|bit| visit(&flipped(frame, [bit]))),
            Self::TwoBits => {
                for first in 0..bits {
                    (first + 1..bits).for_each(|second| visit(&flipped(frame, [first, second])));
                }
            }
            Self::Burst => {
                for first in 0..bits {
                    for last in first + 1..bits.min(first + 8) {
                        for between in 0..1_u32 << (last - first - 1) {
                            let inner = (first + 1..last).filter(|bit| between >> (bit - first - 1) & 1 == 1);
                            visit(&flipped(frame, inner.chain([first, last])));
                        }
                    }
                }
            }
            Self::OtherByte => {
                for at in 0..bytes {
                    for byte in (0..=255).filter(|&byte| byte != frame[at]) {
                        let mut frame = frame.to_vec();
                        frame[at] = byte;
                        visit(&frame);
                    }
                }
            }
            Self::LostByte => (0..bytes).for_each(|at| visit(&[&frame[..at], &frame[at + 1..]].concat())),
            Self::ByteTwice => (0..bytes).for_each(|at| visit(&[&frame[..=at], &frame[at..]].concat())),
            Self::ExtraByte => {
                for at in 0..=bytes {
                    (0..=255).for_each(|byte| visit(&[&frame[..at], &[byte], &frame[at..]].concat()));
                }
            }
            Self::CutShort => (1..bytes).for_each(|len| visit(&frame[..len])),
        }
    }
}

/// The frame with these bits flipped; bit 0 is the lowest of the first byte.
fn flipped(frame: &[u8], bits: impl IntoIterator<Item = usize>) -> Vec<u8> {
    let mut frame = frame.to_vec();
    for bit in bits {
        frame[bit / 8] ^= 1 << (bit % 8);
    }
    frame
}
