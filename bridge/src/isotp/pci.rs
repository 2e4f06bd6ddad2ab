//! The protocol control information in a frame's first bytes (ISO 15765-2:2016, section 9.6).

use super::{Ignored, SeparationTime};
use crate::can::MAX_CLASSIC;

/// The type of a frame, in the high four bits of its first byte.
pub(super) const FIRST: u8 = 0x10;
/// See [`FIRST`].
pub(super) const CONSECUTIVE: u8 = 0x20;
/// See [`FIRST`].
pub(super) const FLOW_CONTROL: u8 = 0x30;

/// Flow status: continue to send, up to the block size.
pub(super) const CONTINUE: u8 = 0;
/// Flow status: wait for another flow control frame.
pub(super) const WAIT: u8 = 1;
/// Flow status: there is no room for the PDU.
pub(super) const OVERFLOW: u8 = 2;

/// The longest PDU whose length is in the first byte of a single frame.
pub(super) const MAX_SHORT_SINGLE: usize = 7;
/// The longest PDU in a single frame of 64 bytes.
pub(super) const MAX_FD_SINGLE: usize = 62;
/// The longest PDU whose length is in the first two bytes of a first frame.
pub(super) const MAX_SHORT_FIRST: u32 = 4095;

/// A frame that is well-formed by itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Pci<'a> {
    /// A whole PDU.
    Single(&'a [u8]),
    /// The start of a PDU of `len` bytes, always more than `data` has.
    First { len: u32, data: &'a [u8] },
    /// The next bytes of a PDU, followed by padding in its last frame.
    Consecutive { number: u8, data: &'a [u8] },
    /// A receiver's flow control.
    FlowControl {
        status: u8,
        block_size: u8,
        st_min: SeparationTime,
    },
}

/// Decodes a frame.
pub(super) fn parse(frame: &[u8]) -> Result<Pci<'_>, Ignored> {
    let short = |expected| Ignored::Short {
        expected,
        got: frame.len(),
    };
    let &[type_and_low, ref rest @ ..] = frame else {
        return Err(short(1));
    };
    let low = type_and_low & 0x0F;
    match (type_and_low & 0xF0, rest) {
        (0, []) => Err(short(2)),
        (0, _) => single(frame.len(), low, rest),
        (FIRST, &[low_byte, ref rest @ ..]) if frame.len() >= MAX_CLASSIC => {
            first(frame.len(), u16::from_be_bytes([low, low_byte]), rest)
        }
        (FIRST, _) => Err(short(MAX_CLASSIC)),
        (CONSECUTIVE, data) => Ok(Pci::Consecutive { number: low, data }),
        (FLOW_CONTROL, &[block_size, st_min, ..]) => Ok(Pci::FlowControl {
            status: low,
            block_size,
            st_min: SeparationTime::from_byte(st_min),
        }),
        (FLOW_CONTROL, _) => Err(short(3)),
        (other, _) => Err(Ignored::UnknownType { got: other >> 4 }),
    }
}

/// The length of the PDU that begins in a frame, and its first bytes. `None` for any other frame.
pub(crate) fn beginning(frame: &[u8]) -> Option<(usize, &[u8])> {
    match parse(frame).ok()? {
        Pci::Single(pdu) => Some((pdu.len(), pdu)),
        Pci::First { len, data } => Some((len as usize, data)),
        Pci::Consecutive { .. } | Pci::FlowControl { .. } => None,
    }
}

/// A frame longer than a classic one has a 0 in place of the length, and the length in its second byte.
fn single(frame_len: usize, low: u8, rest: &[u8]) -> Result<Pci<'_>, Ignored> {
    let (len, data) = match rest {
        _ if frame_len <= MAX_CLASSIC => (low, rest),
        &[len, ref data @ ..] if low == 0 => (len, data),
        _ => return Err(Ignored::NotEscaped { got: low }),
    };
    match data.get(..usize::from(len)) {
        Some(data) if len > 0 => Ok(Pci::Single(data)),
        _ => Err(Ignored::PduLength {
            min: 1,
            max: data.len() as u32,
            got: u32::from(len),
        }),
    }
}

/// `len` must not fit in a single frame of this size. A length of more than 12 bits is in the four bytes after a length
/// of 0.
fn first(frame_len: usize, len: u16, rest: &[u8]) -> Result<Pci<'_>, Ignored> {
    let (min, max, len, data) = match (len, rest) {
        (0, &[a, b, c, d, ref data @ ..]) => (MAX_SHORT_FIRST + 1, u32::MAX, u32::from_be_bytes([a, b, c, d]), data),
        _ => {
            let min = if frame_len > MAX_CLASSIC {
                frame_len - 1
            } else {
                MAX_CLASSIC
            };
            (min as u32, MAX_SHORT_FIRST, u32::from(len), rest)
        }
    };
    if len < min {
        return Err(Ignored::PduLength { min, max, got: len });
    }
    Ok(Pci::First { len, data })
}
