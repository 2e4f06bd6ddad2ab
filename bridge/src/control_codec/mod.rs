//! The control port's messages as bytes: postcard, with COBS around it on byte streams.
//!
//! COBS is decoded byte by byte and encoded from a whole message, by the parts of `cobs` that have no path to a panic.
//! postcard's own COBS functions have one.

use core::fmt;

use cobs::{DecodeResult, DecoderState};
use serde::Serialize;
use serde::de::DeserializeOwned;

/// The longest message in postcard format, in bytes.
pub const MAX_MESSAGE: usize = 303;

/// Maximum overhead of COBS and the zero terminator, for a message of any kind.
pub(crate) const COBS: usize = 4;

/// A message on the control port: [`FromHost`](crate::control::FromHost) and [`FromAdapter`](crate::control::FromAdapter).
///
/// ```
/// use armwire_bridge::control::{FromAdapter, FromHost, Message};
///
/// assert_eq!(FromHost::sequence(&[7, 99, 1, 2, 3]), Some(7));
/// assert_eq!(FromAdapter::sequence(&[0, 7, 99, 1, 2, 3]), Some(7));
/// assert_eq!(FromAdapter::sequence(&[1, 7, 99, 1, 2, 3]), None); // an event
/// ```
pub trait Message: Serialize + DeserializeOwned {
    /// Accepts bytes after the last field, as later versions add them. A host accepts them, to read the known part of a
    /// newer adapter's message. The adapter does not: it would confirm a request of which it ignored a part.
    const MAY_GROW: bool;

    /// Maximum count of numbers that a message of an older version lacks at its end.
    const MAX_MISSING: usize;

    /// Returns true if an older version of this message lacks this many numbers at its end. A flag is a number.
    fn may_lack(&self, numbers: usize) -> bool;

    /// The sequence number of a message in postcard format, even if the rest is not readable. `None` if it has none.
    fn sequence(bytes: &[u8]) -> Option<u8>;
}

/// Writes `message` to the front of `out` in postcard format, for one ISO-TP PDU, and returns its length.
///
/// # Errors
///
/// [`NoRoom`] if `out` is too short; never with [`MAX_MESSAGE`] bytes.
///
/// ```
/// use armwire_bridge::control::{FromHost, MAX_MESSAGE, Request, decode, encode};
///
/// let message = FromHost { sequence: 7, request: Request::GetCounters };
/// let mut pdu = [0; MAX_MESSAGE];
/// let len = encode(&message, &mut pdu).unwrap();
/// assert_eq!(pdu[..len], [7, 6]);
/// assert_eq!(decode(&pdu[..len]), Ok(message));
/// ```
pub fn encode<T: Message>(message: &T, out: &mut [u8]) -> Result<usize, NoRoom> {
    write(message, out)
}

/// Writes any value to the front of `out` in postcard format, and returns its length.
pub(crate) fn write<T: Serialize>(value: &T, out: &mut [u8]) -> Result<usize, NoRoom> {
    let room = out.len();
    match postcard::to_slice(value, out) {
        Ok(bytes) => Ok(bytes.len()),
        Err(_) => Err(NoRoom { room }),
    }
}

/// Writes `message` to the front of `out` as sent over USB, including the zero terminator, and returns its length.
///
/// # Errors
///
/// [`NoRoom`] if `out` is too short; never with [`MAX_COBS`](crate::control::MAX_COBS) bytes.
///
/// ```
/// use armwire_bridge::control::{FromHost, MAX_COBS, Request, encode_cobs};
///
/// let message = FromHost { sequence: 7, request: Request::GetCounters };
/// let mut out = [0; MAX_COBS];
/// let len = encode_cobs(&message, &mut out).unwrap();
/// assert_eq!(out[..len], [3, 7, 6, 0]);
/// ```
pub fn encode_cobs<T: Message>(message: &T, out: &mut [u8]) -> Result<usize, NoRoom> {
    let mut scratch = [0; MAX_MESSAGE];
    let len = encode(message, &mut scratch)?;
    add_cobs(scratch.get(..len).unwrap_or_default(), out)
}

/// Writes a message in postcard format to the front of `out` as sent over USB, and returns its length.
pub(crate) fn add_cobs(bytes: &[u8], out: &mut [u8]) -> Result<usize, NoRoom> {
    let no_room = NoRoom { room: out.len() };
    let len = cobs::try_encode(bytes, out).map_err(|_| no_room)?;
    *out.get_mut(len).ok_or(no_room)? = 0;
    Ok(len.saturating_add(1))
}

/// Decodes a message in postcard format that takes up all of `bytes`. A [`FromAdapter`](crate::control::FromAdapter)
/// may have trailing fields of a later version, which are skipped.
///
/// # Errors
///
/// [`Malformed`] if `bytes` are no message of this version.
///
/// ```
/// use armwire_bridge::control::{FromHost, Reason, decode};
///
/// let malformed = decode::<FromHost>(&[7, 99, 1, 2, 3]).unwrap_err();
/// assert_eq!((malformed.sequence, malformed.reason), (Some(7), Reason::Unknown));
/// ```
pub fn decode<T: Message>(bytes: &[u8]) -> Result<T, Malformed> {
    let reason = match read(bytes) {
        Ok((message, rest)) if rest.is_empty() || T::MAY_GROW => return Ok(message),
        Ok((_, rest)) => Reason::Surplus { bytes: rest.len() },
        Err(reason) if T::MAY_GROW => match read_older(bytes, T::MAX_MISSING, T::may_lack) {
            Some(message) => return Ok(message),
            None => reason,
        },
        Err(reason) => reason,
    };
    Err(Malformed {
        sequence: T::sequence(bytes),
        reason,
    })
}

/// Decodes a value of an older version. It lacks up to `max_missing` numbers at its end, as many as it `may_lack`,
/// which become 0. `None` if `bytes` do not match.
pub(crate) fn read_older<T: DeserializeOwned>(
    bytes: &[u8],
    max_missing: usize,
    may_lack: impl Fn(&T, usize) -> bool,
) -> Option<T> {
    // With a zero appended, a truncated number would be read as a smaller one.
    bytes.last().filter(|last| **last < 0x80)?;
    let mut completed = [0; MAX_MESSAGE];
    completed.get_mut(..bytes.len())?.copy_from_slice(bytes);
    (1..=max_missing).find_map(|missing| {
        let len = bytes.len().saturating_add(missing);
        match read(completed.get(..len)?) {
            Ok((value, [])) => Some(value).filter(|value| may_lack(value, missing)),
            _ => None,
        }
    })
}

/// Decodes any value in postcard format from the front of `bytes`, and returns the bytes after it, too.
pub(crate) fn read<T: DeserializeOwned>(bytes: &[u8]) -> Result<(T, &[u8]), Reason> {
    postcard::take_from_bytes(bytes).map_err(|error| match error {
        postcard::Error::DeserializeUnexpectedEnd => Reason::EndsEarly,
        _ => Reason::Unknown,
    })
}

/// Finds the messages in a stream of bytes: each is COBS-encoded and ends with a zero byte.
///
/// A malformed message ends at the next zero byte and does not affect the following ones. Zeros between messages are
/// ignored: either end may begin with one.
///
/// `N` is the maximum length of a message in postcard format, in bytes.
///
/// ```
/// use armwire_bridge::control::{FromHost, MAX_MESSAGE, Reader, Reason, Request};
///
/// let mut reader = Reader::<MAX_MESSAGE>::new();
/// let mut packet = &[5, 1, 2, 0, 3, 7, 0, 3, 8, 6, 0, 3, 9][..];
/// let mut received = Vec::new();
/// while !packet.is_empty() {
///     packet = reader.push(packet);
///     received.extend(reader.next::<FromHost>());
/// }
/// let [Err(garbage), Err(cut), Ok(message)] = received[..] else { panic!() };
/// assert_eq!((garbage.reason, cut.reason), (Reason::NotCobs, Reason::NotCobs));
/// assert_eq!(message, FromHost { sequence: 8, request: Request::GetCounters });
/// assert!(reader.next::<FromHost>().is_none()); // the last one has not ended
/// ```
#[derive(Debug)]
pub struct Reader<const N: usize> {
    cobs: DecoderState,
    /// The decoded bytes of the message, in the first `len`.
    bytes: [u8; N],
    len: usize,
    state: State,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    /// Bytes are decoded; bytes of this message that do not fit are dropped.
    Reading {
        too_long: bool,
    },
    Ended(Result<(), Reason>),
}

impl<const N: usize> Reader<N> {
    /// An empty reader.
    pub const fn new() -> Self {
        Self {
            cobs: DecoderState::Idle,
            bytes: [0; N],
            len: 0,
            state: State::Reading { too_long: false },
        }
    }

    /// Consumes bytes up to the end of a message, and returns the rest. It consumes no more until that message was
    /// taken by [`next`](Self::next).
    pub fn push<'a>(&mut self, bytes: &'a [u8]) -> &'a [u8] {
        let mut rest = bytes.iter();
        while let State::Reading { too_long } = self.state
            && let Some(&byte) = rest.next()
        {
            self.feed(byte, too_long);
        }
        rest.as_slice()
    }

    /// The message that has ended, or the reason why it is malformed. `None` if none has ended.
    #[allow(
        clippy::should_implement_trait,
        reason = "the message type is a parameter of each call"
    )]
    pub fn next<T: Message>(&mut self) -> Option<Result<T, Malformed>> {
        let State::Ended(result) = self.state else { return None };
        let bytes = self.bytes.get(..self.len).unwrap_or_default();
        let message = match result {
            Ok(()) => decode(bytes),
            Err(reason) => Err(Malformed {
                // Invalid COBS has no reliable beginning.
                sequence: T::sequence(bytes).filter(|_| reason != Reason::NotCobs),
                reason,
            }),
        };
        self.clear();
        Some(message)
    }

    /// Resets the state, for the start of a new stream.
    pub const fn clear(&mut self) {
        self.cobs = DecoderState::Idle;
        self.len = 0;
        self.state = State::Reading { too_long: false };
    }

    fn feed(&mut self, byte: u8, too_long: bool) {
        match self.cobs.feed(byte) {
            Ok(DecodeResult::NoData) => {}
            Ok(DecodeResult::DataContinue(byte)) => match self.bytes.get_mut(self.len) {
                Some(place) => {
                    *place = byte;
                    self.len = self.len.saturating_add(1);
                }
                None => self.state = State::Reading { too_long: true },
            },
            Ok(DecodeResult::DataComplete) if too_long => self.state = State::Ended(Err(Reason::TooLong { max: N })),
            Ok(DecodeResult::DataComplete) => self.state = State::Ended(Ok(())),
            Err(_) => self.state = State::Ended(Err(Reason::NotCobs)),
        }
    }
}

impl<const N: usize> Default for Reader<N> {
    fn default() -> Self {
        Self::new()
    }
}

/// The destination is too short for a message.
///
/// ```
/// use armwire_bridge::control::{FromHost, NoRoom, Request, encode};
///
/// let message = FromHost { sequence: 7, request: Request::GetCounters };
/// let error = encode(&message, &mut [0; 1]).unwrap_err();
/// assert_eq!(error, NoRoom { room: 1 });
/// assert_eq!(error.to_string(), "the message does not fit into 1 bytes");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NoRoom {
    /// Size of the destination, in bytes.
    pub room: usize,
}

impl fmt::Display for NoRoom {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "the message does not fit into {} bytes", self.room)
    }
}

impl core::error::Error for NoRoom {}

/// Bytes that are no message of this version, nor an extended one of a later version.
///
/// ```
/// use armwire_bridge::control::{Malformed, Reason};
///
/// let malformed = Malformed { sequence: Some(7), reason: Reason::Surplus { bytes: 2 } };
/// assert_eq!(malformed.to_string(), "message 7 has 2 surplus bytes");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Malformed {
    /// The message's sequence number, if it could be read.
    pub sequence: Option<u8>,
    /// The reason.
    pub reason: Reason,
}

/// The reason why bytes are no message of this version.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Reason {
    /// Invalid COBS.
    NotCobs,
    /// The message is longer than the reader's maximum.
    TooLong {
        /// The maximum, in bytes.
        max: usize,
    },
    /// The message ends before its last field.
    EndsEarly,
    /// A field has an invalid value.
    Unknown,
    /// A message from a host has bytes after its last field.
    Surplus {
        /// Number of bytes.
        bytes: usize,
    },
}

impl fmt::Display for Malformed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.sequence {
            Some(sequence) => write!(f, "message {sequence} {}", self.reason),
            None => write!(f, "a message {}", self.reason),
        }
    }
}

impl fmt::Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotCobs => f.write_str("is not COBS-encoded"),
            Self::TooLong { max } => write!(f, "is longer than {max} bytes"),
            Self::EndsEarly => f.write_str("ends too early"),
            Self::Unknown => f.write_str("has an unknown value"),
            Self::Surplus { bytes } => write!(f, "has {bytes} surplus bytes"),
        }
    }
}

impl core::error::Error for Malformed {}

#[cfg(test)]
mod tests;
