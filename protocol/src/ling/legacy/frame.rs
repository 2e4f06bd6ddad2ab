//! The bytes of a frame of the older generation.
//!
//! ```text
//!   0     1         2      3 .. 3+n    3+n      4+n
//! +----+---------+------+-----------+--------+------+
//! | AA | command | n    | data      | parity | FF   |
//! +----+---------+------+-----------+--------+------+
//! ```
//!
//! The parity is the sum of the data bytes modulo 2: 00 or 01. It is a weak check: it depends only on the lowest bit of
//! each data byte, misses seven in eight single-bit errors in the data, and does not cover command and length. The
//! values are good enough for display, not for a control loop.

use super::Legacy;
use crate::BufferTooShort;
use crate::correlation::{Correlation, InfoOf};
use crate::framing::{Framing, LONGEST_VOID, Scan, verify, write};
use crate::ling::frame::{HEADER, TAIL, data_len};

/// Maximum number of data bytes in a frame.
///
/// The longest known frame has 21. The vendor's ROS drivers accept frames of up to 64 bytes, and so does this crate.
pub const MAX_DATA: usize = 59;

/// Bytes of a frame that are not data.
pub const OVERHEAD: usize = 5;

/// The longest frame, in bytes.
pub const MAX_FRAME: usize = MAX_DATA + OVERHEAD;

/// The sum of the data bytes modulo 2: 0 or 1.
///
/// ```
/// assert_eq!(armwire::ling::legacy::parity(&[0x01, 0x03, 0x08]), 0);
/// assert_eq!(armwire::ling::legacy::parity(&[]), 0);
/// ```
pub fn parity(data: &[u8]) -> u8 {
    data.iter().fold(0, |sum, byte| sum ^ byte) & 1
}

/// A frame with valid header, length, parity and terminator.
///
/// It has no public encoder, because such an arm has no known requests. A virtual arm encodes its messages with a
/// [`Device`](crate::Device).
///
/// ```
/// use armwire::decoder::Decoder;
/// use armwire::ling::legacy::{Frame, Legacy, MAX_FRAME};
///
/// let mut decoder = Decoder::<Legacy, MAX_FRAME>::new();
/// assert!(decoder.push(&[0xAA, 0x0A, 0x03, 0x05, 0x04, 0x13, 0x00, 0xFF]).is_empty());
/// let frame = decoder.next(&Legacy, ()).and_then(|item| Frame::parse(item.bytes)).unwrap();
/// assert_eq!((frame.command, frame.data), (0x0A, &[5, 4, 19][..]));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Frame<'a> {
    /// Command.
    pub command: u8,
    /// The data, 0 to [`MAX_DATA`] bytes.
    pub data: &'a [u8],
}

impl Frame<'_> {
    /// Writes a frame whose data is within the maximum.
    pub(super) fn put(&self, out: &mut [u8]) -> Result<usize, BufferTooShort> {
        let bytes = [HEADER, self.command, self.data.len() as u8].into_iter();
        write(
            out,
            bytes.chain(self.data.iter().copied()).chain([parity(self.data), TAIL]),
        )
    }
}

impl<'a> Frame<'a> {
    /// Decodes a frame. `bytes` must be a frame according to [`scan`](Framing::scan).
    pub fn parse(bytes: &'a [u8]) -> Option<Self> {
        match bytes {
            [HEADER, command, _, data @ .., _, TAIL] => Some(Self {
                command: *command,
                data,
            }),
            _ => None,
        }
    }
}

impl Framing for Legacy {
    const VOID: Option<usize> = Some(LONGEST_VOID);
    type Expect = ();

    fn scan(&self, window: &[u8], (): ()) -> Scan {
        match data_len(window, 2, MAX_DATA) {
            Ok(len) => verify(window, len + OVERHEAD, 3, parity, TAIL),
            Err(verdict) => verdict,
        }
    }

    fn terminator(&self, (): ()) -> Option<u8> {
        Some(TAIL)
    }

    fn shortest(&self, (): ()) -> usize {
        OVERHEAD
    }

    fn requests(&self) {}

    fn unsolicited(&self) {}
}

/// Nothing is sent to such an arm: no frame is an answer.
impl Correlation for Legacy {
    type Key = ();

    fn request(&self, _frame: &[u8]) -> Option<InfoOf<Self>> {
        None
    }

    fn is_response_to(&self, (): (), _frame: &[u8]) -> bool {
        false
    }
}
