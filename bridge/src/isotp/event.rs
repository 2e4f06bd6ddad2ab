//! What an endpoint has to say.

use core::fmt;

use armwire::time::Duration;

/// What happened. What succeeds in sending is no event: [`is_sending`](super::Endpoint::is_sending) says so.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Event {
    /// A PDU is whole: [`received`](super::Endpoint::received) has it.
    Received,
    /// A PDU was not taken. If it would have taken more than one frame, its sender is told.
    Refused(Refused),
    /// A PDU was given up in the middle.
    Failed(Error),
    /// A frame changed nothing, as the standard has it.
    Ignored(Ignored),
}

/// What came of one call: nothing, one event, or two when a frame ended one PDU and began another.
///
/// ```
/// # use armwire_bridge::Instant;
/// # use armwire_bridge::can::Id;
/// # use armwire_bridge::isotp::{Config, Endpoint, Error, Event, Link};
/// # let mut endpoint = Endpoint::<64, 64>::new(Config::new(Link::Classic, Id::new(0x610).unwrap()));
/// let mut events = endpoint.receive(&[0x10, 20, 1, 2, 3, 4, 5, 6], Instant::ZERO);
/// assert_eq!(events.next(), None);
/// let mut events = endpoint.receive(&[0x01, 7], Instant::ZERO);
/// assert_eq!(events.next(), Some(Event::Failed(Error::Interrupted { expected: 20, got: 6 })));
/// assert_eq!(events.next(), Some(Event::Received));
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[must_use]
pub struct Events {
    pub(super) first: Option<Event>,
    pub(super) second: Option<Event>,
}

impl Iterator for Events {
    type Item = Event;

    fn next(&mut self) -> Option<Event> {
        self.first.take().or_else(|| self.second.take())
    }
}

/// Why a PDU was given up. The names in brackets are those of the standard (ISO 15765-2:2016, 8.3.7).
///
/// ```
/// use armwire_bridge::isotp::Error;
///
/// let error = Error::WrongSequenceNumber { expected: 3, got: 4 };
/// assert_eq!(error.to_string(), "receiving: consecutive frame 3 was expected, 4 came");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Error {
    /// Sending: a frame did not leave in time (N_TIMEOUT_A).
    NotTransmitted {
        /// How long it was waited for.
        waited: Duration,
        /// The length of the PDU.
        len: usize,
        /// The bytes of it that were handed over, those that have not left included.
        handed: usize,
    },
    /// Sending: flow control did not come in time (N_TIMEOUT_Bs).
    NoFlowControl {
        /// How long it was waited for.
        waited: Duration,
    },
    /// Sending: the receiver said too often in a row that it is not ready (N_WFT_OVRN).
    TooManyWaits {
        /// How often it may say so.
        max: u8,
    },
    /// Sending: the receiver has no room for the PDU (N_BUFFER_OVFLW).
    Overflow {
        /// The length of the PDU.
        len: usize,
    },
    /// Sending: flow control came with a status that there is not (N_INVALID_FS).
    InvalidFlowStatus {
        /// The status; 0, 1 and 2 are expected.
        got: u8,
    },
    /// Receiving: a consecutive frame did not come in time (N_TIMEOUT_Cr).
    NoConsecutiveFrame {
        /// How long it was waited for.
        waited: Duration,
        /// The bytes the PDU was to have.
        expected: usize,
        /// The bytes that came.
        got: usize,
    },
    /// Receiving: a consecutive frame is missing or came twice (N_WRONG_SN).
    WrongSequenceNumber {
        /// The number that was next.
        expected: u8,
        /// The number that came.
        got: u8,
    },
    /// Receiving: another PDU began (N_UNEXP_PDU).
    Interrupted {
        /// The bytes the PDU was to have.
        expected: usize,
        /// The bytes that had come.
        got: usize,
    },
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::NotTransmitted { waited, len, handed } => write!(
                f,
                "sending: a frame did not leave in {} µs, with {handed} of {len} bytes handed over",
                waited.as_micros()
            ),
            Self::NoFlowControl { waited } => write!(f, "sending: no flow control in {} µs", waited.as_micros()),
            Self::TooManyWaits { max } => write!(f, "sending: the receiver asked to wait more than {max} times"),
            Self::Overflow { len } => write!(f, "sending: the receiver has no room for {len} bytes"),
            Self::InvalidFlowStatus { got } => write!(f, "sending: flow status is {got}, must be 0..=2"),
            Self::NoConsecutiveFrame { waited, expected, got } => write!(
                f,
                "receiving: no consecutive frame in {} µs after {got} of {expected} bytes",
                waited.as_micros()
            ),
            Self::WrongSequenceNumber { expected, got } => {
                write!(f, "receiving: consecutive frame {expected} was expected, {got} came")
            }
            Self::Interrupted { expected, got } => {
                write!(f, "receiving: another PDU began after {got} of {expected} bytes")
            }
        }
    }
}

impl core::error::Error for Error {}

/// Why a PDU was not taken.
///
/// ```
/// use armwire_bridge::isotp::Refused;
///
/// assert_eq!(Refused::TooLong { max: 300, got: 4_095 }.to_string(), "a PDU of 4095 bytes, there is room for 300");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Refused {
    /// The PDU before it has not been released.
    Occupied {
        /// Its length in bytes.
        got: u32,
    },
    /// It is longer than any that the endpoint takes.
    TooLong {
        /// The longest, in bytes.
        max: usize,
        /// Its length in bytes.
        got: u32,
    },
}

impl fmt::Display for Refused {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Occupied { got } => write!(f, "a PDU of {got} bytes, the one before it was not taken yet"),
            Self::TooLong { max, got } => write!(f, "a PDU of {got} bytes, there is room for {max}"),
        }
    }
}

impl core::error::Error for Refused {}

/// Why a frame changed nothing.
///
/// ```
/// use armwire_bridge::isotp::Ignored;
///
/// assert_eq!(Ignored::Short { expected: 3, got: 1 }.to_string(), "a frame of 1 bytes, must have 3 or more");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Ignored {
    /// The frame is shorter than what it says it is.
    Short {
        /// The fewest bytes it must have.
        expected: usize,
        /// The bytes it has.
        got: usize,
    },
    /// A consecutive frame is longer than the first frame was.
    Long {
        /// The most bytes it may have.
        expected: usize,
        /// The bytes it has.
        got: usize,
    },
    /// A single or first frame announces a PDU too short for it, or a longer one than it holds.
    PduLength {
        /// The shortest it may announce, in bytes.
        min: u32,
        /// The longest it may announce, in bytes.
        max: u32,
        /// The length it announces.
        got: u32,
    },
    /// A single frame of more than 8 bytes has a length in its first byte.
    NotEscaped {
        /// The length; 0 is expected.
        got: u8,
    },
    /// Neither single, first, consecutive nor flow control frame.
    UnknownType {
        /// Its type; 0, 1, 2 and 3 are expected.
        got: u8,
    },
    /// A consecutive frame that nobody waits for.
    UnexpectedConsecutive {
        /// Its sequence number.
        got: u8,
    },
    /// A flow control frame that nobody waits for.
    UnexpectedFlowControl {
        /// Its flow status.
        got: u8,
    },
}

impl fmt::Display for Ignored {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Short { expected, got } => write!(f, "a frame of {got} bytes, must have {expected} or more"),
            Self::Long { expected, got } => write!(f, "a frame of {got} bytes, must have {expected} or less"),
            Self::PduLength { min, max, got } => write!(f, "announces {got} bytes, must be {min}..={max}"),
            Self::NotEscaped { got } => write!(f, "a length of {got} in the first of more than 8 bytes, must be 0"),
            Self::UnknownType { got } => write!(f, "a frame of type {got}, must be 0..=3"),
            Self::UnexpectedConsecutive { got } => write!(f, "consecutive frame {got}, none was expected"),
            Self::UnexpectedFlowControl { got } => write!(f, "flow control with status {got}, none was expected"),
        }
    }
}

/// Why a PDU cannot be sent.
///
/// ```
/// use armwire_bridge::isotp::SendError;
///
/// assert_eq!(SendError::TooLong { max: 300, got: 301 }.to_string(), "a PDU of 301 bytes, must have 1..=300");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum SendError {
    /// Another is being sent. Nothing was changed.
    Busy,
    /// It has no bytes. There is no such PDU.
    Empty,
    /// It is longer than any that the endpoint sends.
    TooLong {
        /// The longest, in bytes.
        max: usize,
        /// Its length in bytes.
        got: usize,
    },
}

impl fmt::Display for SendError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Busy => f.write_str("another PDU is being sent"),
            Self::Empty => f.write_str("a PDU without bytes, must have 1 or more"),
            Self::TooLong { max, got } => write!(f, "a PDU of {got} bytes, must have 1..={max}"),
        }
    }
}

impl core::error::Error for SendError {}
