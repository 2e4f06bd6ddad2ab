//! The control port's messages as bytes: postcard, and COBS around it where the bytes are a stream.
//!
//! COBS is decoded as the bytes come, and encoded from a whole message, with the parts of `cobs` that have no path to a
//! panic. postcard's own way to both has one.

use core::fmt;

use cobs::{DecodeResult, DecoderState};
use serde::Serialize;
use serde::de::DeserializeOwned;

/// The longest message in postcard format, in bytes.
pub const MAX_MESSAGE: usize = 288;

/// Bytes that COBS and the zero add to a message of any kind at most.
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
    /// Whether bytes behind the last field are passed over, as fields that a later version has added. A host does so, to
    /// learn what it can from a newer adapter. The adapter does not: a host that says more than is understood would take
    /// for done what is not.
    const MAY_GROW: bool;

    /// How many numbers the messages of older versions lack at their end.
    const SINCE_OLDER: &'static [usize];

    /// Whether older versions lack numbers at the end of this message.
    fn has_grown(&self) -> bool;

    /// The sequence number in a message in postcard format, also where the rest of it cannot be read. `None` if there is
    /// none.
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

/// Writes whatever it is to the front of `out` in postcard format, and returns its length.
pub(crate) fn write<T: Serialize>(value: &T, out: &mut [u8]) -> Result<usize, NoRoom> {
    let room = out.len();
    match postcard::to_slice(value, out) {
        Ok(bytes) => Ok(bytes.len()),
        Err(_) => Err(NoRoom { room }),
    }
}

/// Writes `message` to the front of `out` as it goes over USB, the zero at its end included, and returns its length.
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

/// Writes a message in postcard format to the front of `out` as it goes over USB, and returns its length.
pub(crate) fn add_cobs(bytes: &[u8], out: &mut [u8]) -> Result<usize, NoRoom> {
    let no_room = NoRoom { room: out.len() };
    let len = cobs::try_encode(bytes, out).map_err(|_| no_room)?;
    *out.get_mut(len).ok_or(no_room)? = 0;
    Ok(len.saturating_add(1))
}

/// Reads a message in postcard format, which `bytes` is all of; but a [`FromAdapter`](crate::control::FromAdapter) may have fields of a later version at
/// its end, which are passed over.
///
/// # Errors
///
/// [`Malformed`] if it is no message of this version.
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
        Err(reason) if T::MAY_GROW => match read_older(bytes, T::SINCE_OLDER).filter(T::has_grown) {
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

/// Reads a value of an older version, which lacks so many numbers at its end: they are 0. `None` if `bytes` are not exactly that.
pub(crate) fn read_older<T: DeserializeOwned>(bytes: &[u8], since_older: &[usize]) -> Option<T> {
    // With a zero behind it, a number that was cut would be read as a smaller one.
    bytes.last().filter(|last| **last < 0x80)?;
    let mut completed = [0; MAX_MESSAGE];
    completed.get_mut(..bytes.len())?.copy_from_slice(bytes);
    since_older.iter().find_map(|missing| {
        let len = bytes.len().saturating_add(*missing);
        match read(completed.get(..len)?) {
            Ok((value, [])) => Some(value),
            _ => None,
        }
    })
}

/// Reads whatever it is in postcard format from the front of `bytes`, and returns what is behind it, too.
pub(crate) fn read<T: DeserializeOwned>(bytes: &[u8]) -> Result<(T, &[u8]), Reason> {
    postcard::take_from_bytes(bytes).map_err(|error| match error {
        postcard::Error::DeserializeUnexpectedEnd => Reason::EndsEarly,
        _ => Reason::Unknown,
    })
}

/// Finds the messages in a stream of bytes: each is COBS-encoded and ends with a zero byte.
///
/// What cannot be read ends at the next zero byte, and costs nothing behind it. Zeros between messages mean nothing, so
/// that either end can begin with one.
///
/// `N` is the longest message in postcard format that it takes, in bytes.
///
/// ```
/// use armwire_bridge::control::{FromHost, MAX_MESSAGE, Reader, Reason, Request};
///
/// let mut reader = Reader::<MAX_MESSAGE>::new();
/// let mut packet = &[5, 1, 2, 0, 3, 7, 0, 3, 8, 6, 0, 3, 9][..];
/// let mut heard = Vec::new();
/// while !packet.is_empty() {
///     packet = reader.push(packet);
///     heard.extend(reader.next::<FromHost>());
/// }
/// let [Err(garbage), Err(cut), Ok(message)] = heard[..] else { panic!() };
/// assert_eq!((garbage.reason, cut.reason), (Reason::NotCobs, Reason::NotCobs));
/// assert_eq!(message, FromHost { sequence: 8, request: Request::GetCounters });
/// assert!(reader.next::<FromHost>().is_none()); // the last one has not ended
/// ```
#[derive(Debug)]
pub struct Reader<const N: usize> {
    cobs: DecoderState,
    /// What was decoded of the message, in the first `len`.
    bytes: [u8; N],
    len: usize,
    state: State,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    /// Bytes are being taken, and those of this message that do not fit are not.
    Reading {
        too_long: bool,
    },
    Ended(Result<(), Reason>),
}

impl<const N: usize> Reader<N> {
    /// One that has seen nothing.
    pub const fn new() -> Self {
        Self {
            cobs: DecoderState::Idle,
            bytes: [0; N],
            len: 0,
            state: State::Reading { too_long: false },
        }
    }

    /// Takes bytes up to the end of a message, and returns those behind it. As long as that message has not been taken
    /// with [`next`](Self::next), it takes no more.
    pub fn push<'a>(&mut self, bytes: &'a [u8]) -> &'a [u8] {
        let mut rest = bytes.iter();
        while let State::Reading { too_long } = self.state
            && let Some(&byte) = rest.next()
        {
            self.feed(byte, too_long);
        }
        rest.as_slice()
    }

    /// The message that has ended, or why it cannot be read. `None` if none has.
    #[allow(
        clippy::should_implement_trait,
        reason = "an iterator cannot be asked for a type of message"
    )]
    pub fn next<T: Message>(&mut self) -> Option<Result<T, Malformed>> {
        let State::Ended(result) = self.state else { return None };
        let bytes = self.bytes.get(..self.len).unwrap_or_default();
        let message = match result {
            Ok(()) => decode(bytes),
            Err(reason) => Err(Malformed {
                // What is no COBS may begin anywhere.
                sequence: T::sequence(bytes).filter(|_| reason != Reason::NotCobs),
                reason,
            }),
        };
        self.clear();
        Some(message)
    }

    /// Forgets what it has taken: the stream begins anew.
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

/// A message that does not fit where it was to be written.
///
/// ```
/// use armwire_bridge::control::{FromHost, NoRoom, Request, encode};
///
/// let message = FromHost { sequence: 7, request: Request::GetCounters };
/// let error = encode(&message, &mut [0; 1]).unwrap_err();
/// assert_eq!(error, NoRoom { room: 1 });
/// assert_eq!(error.to_string(), "the message is longer than the 1 bytes there are for it");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NoRoom {
    /// How many bytes there were for it.
    pub room: usize,
}

impl fmt::Display for NoRoom {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "the message is longer than the {} bytes there are for it", self.room)
    }
}

impl core::error::Error for NoRoom {}

/// Bytes that are no message of this version, nor a longer one of a later version.
///
/// ```
/// use armwire_bridge::control::{Malformed, Reason};
///
/// let malformed = Malformed { sequence: Some(7), reason: Reason::Surplus { bytes: 2 } };
/// assert_eq!(malformed.to_string(), "message 7 has 2 bytes too many");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Malformed {
    /// The message's sequence number, if that much could be read.
    pub sequence: Option<u8>,
    /// What is wrong with it.
    pub reason: Reason,
}

/// Why bytes are no message of this version.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Reason {
    /// They are not COBS-encoded.
    NotCobs,
    /// The message is longer than the reader takes.
    TooLong {
        /// What it takes, in bytes.
        max: usize,
    },
    /// The message ends before all of its fields were there.
    EndsEarly,
    /// A field has a value that it cannot have.
    Unknown,
    /// There is more behind the last field of a message from a host.
    Surplus {
        /// How many bytes.
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
            Self::Unknown => f.write_str("has a value that is not known"),
            Self::Surplus { bytes } => write!(f, "has {bytes} bytes too many"),
        }
    }
}

impl core::error::Error for Malformed {}

#[cfg(test)]
mod tests;
