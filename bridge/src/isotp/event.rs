//! Events and errors of an endpoint.

use core::fmt;

use armwire::time::Duration;

/// An event of an endpoint. A successful transfer has none: [`is_sending`](super::Endpoint::is_sending) becomes false.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Event {
    /// A PDU is complete: [`received`](super::Endpoint::received) returns it.
    Received,
    /// A PDU was refused. Its sender is notified if the PDU needs more than one frame.
    Refused(RefusedPdu),
    /// A transfer was aborted.
    Failed(Error),
    /// A frame was ignored, as the standard requires.
    Ignored(Ignored),
}

/// The events of one call: none, one, or two if a frame ended one PDU and began another.
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

/// The reason for an aborted transfer. The standard's names (ISO 15765-2:2016, 8.3.7) are in brackets.
///
/// ```
/// use armwire_bridge::isotp::Error;
///
/// let error = Error::WrongSequenceNumber { expected: 3, got: 4 };
/// assert_eq!(error.to_string(), "receiving: expected consecutive frame 3, got 4");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Error {
    /// Sending: a frame did not leave in time (N_TIMEOUT_A).
    NotTransmitted {
        /// The timeout.
        waited: Duration,
        /// The length of the PDU.
        len: usize,
        /// The number of bytes handed over, including those that have not left.
        handed: usize,
    },
    /// Sending: flow control did not arrive in time (N_TIMEOUT_Bs).
    NoFlowControl {
        /// The timeout.
        waited: Duration,
    },
    /// Sending: the receiver sent too many consecutive WAIT frames (N_WFT_OVRN).
    TooManyWaits {
        /// The maximum.
        max: u8,
    },
    /// Sending: the receiver has no room for the PDU (N_BUFFER_OVFLW).
    Overflow {
        /// The length of the PDU.
        len: usize,
    },
    /// Sending: flow control has an invalid status (N_INVALID_FS).
    InvalidFlowStatus {
        /// The status; 0, 1 and 2 are valid.
        got: u8,
    },
    /// Receiving: a consecutive frame did not arrive in time (N_TIMEOUT_Cr).
    NoConsecutiveFrame {
        /// The timeout.
        waited: Duration,
        /// The length of the PDU.
        expected: usize,
        /// The number of bytes received.
        got: usize,
    },
    /// Receiving: a consecutive frame is missing or arrived twice (N_WRONG_SN).
    WrongSequenceNumber {
        /// The expected number.
        expected: u8,
        /// The received number.
        got: u8,
    },
    /// Receiving: another PDU began (N_UNEXP_PDU).
    Interrupted {
        /// The length of the PDU.
        expected: usize,
        /// The number of bytes received.
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
            Self::TooManyWaits { max } => write!(f, "sending: the receiver requested to wait more than {max} times"),
            Self::Overflow { len } => write!(f, "sending: the receiver has no room for {len} bytes"),
            Self::InvalidFlowStatus { got } => write!(f, "sending: flow status is {got}, must be 0..=2"),
            Self::NoConsecutiveFrame { waited, expected, got } => write!(
                f,
                "receiving: no consecutive frame in {} µs after {got} of {expected} bytes",
                waited.as_micros()
            ),
            Self::WrongSequenceNumber { expected, got } => {
                write!(f, "receiving: expected consecutive frame {expected}, got {got}")
            }
            Self::Interrupted { expected, got } => {
                write!(f, "receiving: another PDU began after {got} of {expected} bytes")
            }
        }
    }
}

impl core::error::Error for Error {}

/// The reason for a refused PDU.
///
/// ```
/// use armwire_bridge::isotp::RefusedPdu;
///
/// assert_eq!(RefusedPdu::TooLong { max: 300, got: 4_095 }.to_string(), "a PDU of 4095 bytes, at most 300 fit");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum RefusedPdu {
    /// The previous PDU has not been released.
    Occupied {
        /// Its length in bytes.
        got: u32,
    },
    /// The PDU is longer than the endpoint's maximum.
    TooLong {
        /// The maximum, in bytes.
        max: usize,
        /// Its length in bytes.
        got: u32,
    },
}

impl fmt::Display for RefusedPdu {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Occupied { got } => write!(f, "a PDU of {got} bytes, but the previous one was not released"),
            Self::TooLong { max, got } => write!(f, "a PDU of {got} bytes, at most {max} fit"),
        }
    }
}

impl core::error::Error for RefusedPdu {}

/// The reason why a frame was ignored.
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
    /// The frame is too short for its type.
    Short {
        /// The minimum length, in bytes.
        expected: usize,
        /// The frame's length, in bytes.
        got: usize,
    },
    /// A consecutive frame is longer than the first frame was.
    Long {
        /// The maximum length, in bytes.
        expected: usize,
        /// The frame's length, in bytes.
        got: usize,
    },
    /// The length in a single or first frame does not fit the frame: it is too small for the type, or larger than the
    /// frame.
    PduLength {
        /// The minimum, in bytes.
        min: u32,
        /// The maximum, in bytes.
        max: u32,
        /// The length in the frame, in bytes.
        got: u32,
    },
    /// A single frame of more than 8 bytes has a length in its first byte.
    NotEscaped {
        /// The length; 0 is expected.
        got: u8,
    },
    /// The frame is no single, first, consecutive or flow control frame.
    UnknownType {
        /// Its type; 0, 1, 2 and 3 are valid.
        got: u8,
    },
    /// A consecutive frame arrived outside of a transfer.
    UnexpectedConsecutive {
        /// Its sequence number.
        got: u8,
    },
    /// A flow control frame arrived while none was expected.
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

/// The reason why a PDU cannot be sent.
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
    /// Another PDU is being sent. Nothing was changed.
    Busy,
    /// The PDU is empty. ISO-TP has no empty PDU.
    Empty,
    /// The PDU is longer than the endpoint's maximum.
    TooLong {
        /// The maximum, in bytes.
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
