//! The bytes of an xArm frame.
//!
//! ```text
//!   0      1      2      3      4      5      6        6 .. 6+n
//! +------+------+------+------+------+------+----------------------------------+
//! | transaction | protocol id | n           | register, [state], parameters    |
//! +------+------+------+------+------+------+----------------------------------+
//! ```
//!
//! The three numbers are big-endian. `n` is the number of bytes after it. Only responses have a state.
//!
//! | Protocol id | Body |
//! |---|---|
//! | 0 | that of standard Modbus TCP, which has the same header: unit, function, … |
//! | 1 | two zero bytes, transaction 0: a heartbeat ([`HEARTBEAT`]) |
//! | 2, 3 | register, [state], parameters |
//!
//! TCP neither loses nor inserts bytes, so the decoder does not resynchronise: an unknown protocol id breaks the
//! connection. The end of any other frame is known: a frame that is too short or too long, or a malformed heartbeat, is
//! skipped.

use super::{MAX_PARAMS, XArm};
use crate::BufferTooShort;
use crate::framing::{Framing, Reason, Scan, write};

/// Bytes before the body.
pub const HEADER: usize = 6;

/// The longest body, in bytes: register, state and parameters.
pub const MAX_BODY: usize = MAX_PARAMS + 2;

/// The longest frame, in bytes: that of Modbus TCP, which shares the connection.
pub const MAX_FRAME: usize = HEADER + MAX_BODY;

/// The heartbeat, the same in both directions. No other frame has protocol id 1.
pub const HEARTBEAT: [u8; 8] = [0, 0, 0, 1, 0, 2, 0, 0];

/// The protocol id of [`HEARTBEAT`].
pub(super) const HEARTBEAT_ID: u16 = 1;

/// The protocol id of standard Modbus TCP.
pub(super) const MODBUS_ID: u16 = 0;

/// The highest protocol id.
const LAST_ID: u16 = 3;

/// The sender of the frame: a response is at least a byte longer than a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Direction {
    /// The host.
    Requests,
    /// The arm.
    Responses,
}

/// The minimum and maximum of a frame's length field.
const fn lengths(protocol: u16, direction: Direction) -> (u16, u16) {
    match (protocol, direction) {
        (HEARTBEAT_ID, _) => (2, 2),
        (MODBUS_ID, _) | (_, Direction::Responses) => (2, MAX_BODY as u16),
        (_, Direction::Requests) => (1, MAX_PARAMS as u16 + 1),
    }
}

/// A frame with a valid header.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Frame<'a> {
    /// Transaction id, which a response copies from its request.
    pub transaction: u16,
    /// Protocol id, `0..=3`.
    pub protocol: u16,
    /// Register, state in responses, and parameters.
    pub body: &'a [u8],
}

/// Writes a frame whose body is in two parts.
pub(super) fn put(out: &mut [u8], transaction: u16, protocol: u16, body: [&[u8]; 2]) -> Result<usize, BufferTooShort> {
    let [start, end] = body;
    let len = start.len().saturating_add(end.len());
    let numbers = [transaction, protocol, len as u16].into_iter();
    write(
        out,
        numbers
            .flat_map(u16::to_be_bytes)
            .chain(start.iter().chain(end).copied()),
    )
}

/// A byte that breaks the stream.
const fn broken(offset: u8, expected: &'static [u8], got: u8) -> Scan {
    Scan::Broken(Reason::Byte { offset, expected, got })
}

impl<'a> Frame<'a> {
    /// Decodes a frame; `None` if its length field does not match the number of bytes.
    pub fn parse(bytes: &'a [u8]) -> Option<Self> {
        let (&[t1, t0, p1, p0, n1, n0], body) = bytes.split_first_chunk()?;
        let n = usize::from(u16::from_be_bytes([n1, n0]));
        (n > 0 && n == body.len()).then_some(Self {
            transaction: u16::from_be_bytes([t1, t0]),
            protocol: u16::from_be_bytes([p1, p0]),
            body,
        })
    }
}

impl Framing for XArm {
    const LOSSLESS: bool = true;
    type Expect = Direction;

    fn scan(&self, window: &[u8], direction: Direction) -> Scan {
        let Some((&[_, _, high], rest)) = window.split_first_chunk() else {
            return Scan::Need(3 - window.len());
        };
        if high != 0 {
            return broken(2, &[0], high);
        }
        let Some((&low, rest)) = rest.split_first() else {
            return Scan::Need(1);
        };
        if u16::from(low) > LAST_ID {
            return broken(3, &[0, 1, 2, 3], low);
        }
        let Some((&length, body)) = rest.split_first_chunk() else {
            return Scan::Need(2 - rest.len());
        };
        let protocol = u16::from(low);
        let (min, max) = lengths(protocol, direction);
        let got = u16::from_be_bytes(length);
        if !(min..=max).contains(&got) {
            return Scan::Noise(HEADER + usize::from(got), Reason::Length { min, max, got });
        }
        let got = usize::from(got);
        if let Some(missing @ 1..) = got.checked_sub(body.len()) {
            return Scan::Need(missing);
        }
        if protocol == HEARTBEAT_ID
            && let Some((offset, (&got, _))) = (0..)
                .zip(window.iter().zip(&HEARTBEAT))
                .find(|(_, (got, byte))| got != byte)
        {
            let expected = &[0];
            return Scan::Noise(HEARTBEAT.len(), Reason::Byte { offset, expected, got });
        }
        Scan::Frame(HEADER + got)
    }

    fn terminator(&self, _direction: Direction) -> Option<u8> {
        None
    }

    fn shortest(&self, direction: Direction) -> usize {
        match direction {
            Direction::Requests => HEADER + 1,
            Direction::Responses => HEADER + 2,
        }
    }

    fn requests(&self) -> Direction {
        Direction::Requests
    }

    fn unsolicited(&self) -> Direction {
        Direction::Responses
    }
}
