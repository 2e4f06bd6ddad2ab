//! The bytes of a Ling frame (document section 1).
//!
//! ```text
//!   0     1        2         3       4 .. 4+n    4+n       5+n
//! +----+---------+----------+------+-----------+----------+------+
//! | AA | command | function | n    | data      | checksum | FF   |
//! +----+---------+----------+------+-----------+----------+------+
//! ```
//!
//! The checksum is the low byte of CRC-32/ISO-HDLC over `command .. data`. "Command + function + length + data" in the
//! document means concatenation: only then are its examples correct.
//!
//! The document and the vendor's software have one request with length 0 and one data byte ([`SELF_CHECK`]). Exactly
//! this sequence of bytes is accepted; the length of any other frame must match. The sequence is unambiguous: with
//! length 0, the fifth byte would be the checksum, C8.

#[cfg(feature = "small-crc")]
use crc::NoTable;
#[cfg(not(feature = "small-crc"))]
use crc::Table;
use crc::{CRC_32_ISO_HDLC, Crc};

use super::Ling;
use crate::error::at_most;
use crate::framing::{Framing, LONGEST_VOID, Length, Reason, Scan, verify, write};
use crate::{BufferTooShort, EncodeError};

/// Maximum number of data bytes in a frame.
///
/// The document's longest message has 28. The length field allows 255, but every false header would then delay up to
/// 257 bytes of valid frames; 64 leaves room for new messages, and delays at most 66.
pub const MAX_DATA: usize = 64;

/// Bytes of a frame that are not data.
pub const OVERHEAD: usize = 6;

/// The longest frame, in bytes.
pub const MAX_FRAME: usize = MAX_DATA + OVERHEAD;

/// The self-check request as printed in the document: length 0 with one data byte, which the checksum covers.
pub const SELF_CHECK: [u8; 7] = [HEADER, 0xFE, 0x00, 0x00, 0xFE, 0x93, TAIL];

/// The request for the arm's kind and versions (section 2.1).
pub const READ_INFO: [u8; 7] = [HEADER, 0x01, 0x00, 0x01, 0xFE, 0x23, TAIL];

/// The request for the joints and the gripper (section 2.5).
pub const READ_JOINTS: [u8; 7] = [HEADER, 0x06, 0x00, 0x01, 0xFE, 0x9A, TAIL];

/// The request that switches the torque off (section 2.4). The arm may fall.
pub const TORQUE_OFF: [u8; 7] = [HEADER, 0x05, 0x00, 0x01, 0x00, 0x6F, TAIL];

/// The request that switches the torque on (section 2.4).
pub const TORQUE_ON: [u8; 7] = [HEADER, 0x05, 0x00, 0x01, 0x01, 0xF9, TAIL];

pub(super) const HEADER: u8 = 0xAA;

/// The index of the length byte.
const LENGTH: usize = 3;

/// The command of the arm's error frame. The document has none: the vendor's software does.
pub(super) const ERROR: u8 = 0xEE;

/// The data byte of requests without a value.
pub(super) const NO_VALUE: u8 = 0xFE;

/// The terminator: the last byte of every frame.
pub const TAIL: u8 = 0xFF;

/// The table of the checksum: 1 KiB, or none.
#[cfg(not(feature = "small-crc"))]
type CrcTable = Table<1>;
#[cfg(feature = "small-crc")]
type CrcTable = NoTable;

static CRC: Crc<u32, CrcTable> = Crc::<u32, CrcTable>::new(&CRC_32_ISO_HDLC);

/// The checksum of `body`, which is command, function, length and data.
///
/// ```
/// assert_eq!(armwire::ling::checksum(&[0x06, 0x00, 0x01, 0xFE]), 0x9A); // section 2.5
/// ```
pub fn checksum(body: &[u8]) -> u8 {
    CRC.checksum(body) as u8
}

/// A frame with valid header, length, checksum and terminator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Frame<'a> {
    /// Command (section 1.1).
    pub command: u8,
    /// Function within the command.
    pub function: u8,
    /// The data, 0 to [`MAX_DATA`] bytes.
    pub data: &'a [u8],
}

impl Frame<'_> {
    /// Writes the frame at the front of `out` and returns its length in bytes.
    ///
    /// # Errors
    ///
    /// [`EncodeError`] if `out` is shorter than the frame, or the data longer than [`MAX_DATA`].
    ///
    /// ```
    /// use armwire::ling::Frame;
    ///
    /// let mut out = [0; 100];
    /// let frame = Frame { command: 0x05, function: 0x00, data: &[1] };
    /// assert_eq!(frame.encode(&mut out), Ok(7));
    /// assert_eq!(out[..7], [0xAA, 0x05, 0x00, 0x01, 0x01, 0xF9, 0xFF]);
    ///
    /// let error = frame.encode(&mut out[..6]).unwrap_err();
    /// assert_eq!(error.to_string(), "the message takes 7 bytes, the buffer has 6");
    /// let error = Frame { data: &[0; 65], ..frame }.encode(&mut out).unwrap_err();
    /// assert_eq!(error.to_string(), "data is 65 bytes, must be 0..=64");
    /// ```
    pub fn encode(&self, out: &mut [u8]) -> Result<usize, EncodeError> {
        at_most("data", "bytes", self.data.len(), MAX_DATA as u16)?;
        Ok(self.put(out)?)
    }

    /// Writes a frame whose data is within the maximum.
    pub(super) fn put(&self, out: &mut [u8]) -> Result<usize, BufferTooShort> {
        let head = [self.command, self.function, self.data.len() as u8];
        let mut crc = CRC.digest();
        crc.update(&head);
        crc.update(self.data);
        let data = head.into_iter().chain(self.data.iter().copied());
        let bytes = [HEADER].into_iter().chain(data);
        write(out, bytes.chain([crc.finalize() as u8, TAIL]))
    }
}

impl<'a> Frame<'a> {
    /// Decodes a frame. `bytes` must be a frame according to [`scan`](Framing::scan). For any other bytes the result is
    /// unspecified.
    pub fn parse(bytes: &'a [u8]) -> Option<Self> {
        match bytes {
            [_, command, function, _, data @ .., _, _] => Some(Self {
                command: *command,
                function: *function,
                data,
            }),
            _ => None,
        }
    }
}

/// The length field at this offset, at most `max`; or the verdict on a window without a valid length.
pub(super) fn data_len(window: &[u8], offset: usize, max: usize) -> Result<usize, Scan> {
    if window.first() != Some(&HEADER) {
        let stray = window.iter().position(|&byte| byte == HEADER);
        return Err(match stray.unwrap_or(window.len()) {
            0 => Scan::Need(1),
            n => Scan::Noise(n, Reason::Stray),
        });
    }
    match window.get(offset).copied() {
        Some(len) if usize::from(len) <= max => Ok(len.into()),
        Some(len) => {
            let (min, max, got) = (0, max as u16, len.into());
            Err(Scan::Noise(1, Reason::Length { min, max, got }))
        }
        None => Err(Scan::Need((offset + 1).saturating_sub(window.len()))),
    }
}

impl Framing for Ling {
    const VOID: Option<usize> = Some(LONGEST_VOID);
    type Expect = ();

    fn scan(&self, window: &[u8], (): ()) -> Scan {
        let len = match data_len(window, LENGTH, MAX_DATA) {
            Ok(len) => len,
            Err(verdict) => return verdict,
        };
        let total = match window {
            [_, 0xFE, 0x00, 0x00, 0xFE, ..] => SELF_CHECK.len(),
            _ => len + OVERHEAD,
        };
        verify(window, total, 1, checksum, TAIL)
    }

    fn terminator(&self, (): ()) -> Option<u8> {
        Some(TAIL)
    }

    fn length(&self, (): ()) -> Option<Length> {
        Some(Length {
            header: HEADER,
            at: LENGTH,
            max: MAX_DATA as u8,
            overhead: OVERHEAD,
        })
    }

    fn shortest(&self, (): ()) -> usize {
        OVERHEAD
    }

    fn requests(&self) {}

    fn unsolicited(&self) {}
}

/// Decodes a known number of little-endian words.
pub(super) fn words<const N: usize>(data: &[u8]) -> [u16; N] {
    let mut words = [0; N];
    for (word, bytes) in words.iter_mut().zip(data.as_chunks().0) {
        *word = u16::from_le_bytes(*bytes);
    }
    words
}

/// Writes words little-endian.
pub(super) fn put_words(data: &mut [u8], words: &[u16]) {
    for (bytes, word) in data.as_chunks_mut().0.iter_mut().zip(words) {
        *bytes = word.to_le_bytes();
    }
}
