//! Typed requests and responses, in both directions.

use core::fmt::{self, Debug, Display};

use crate::correlation::Correlation;
use crate::{BufferTooShort, EncodeError, ParseError};

/// The messages of one kind of arm.
///
/// [`Client`](crate::Client) and [`Device`](crate::Device) use the same definitions and are tested against each other.
/// A message borrows its texts and parameters from its frame. [`Ling`](crate::ling::Ling) is an example.
pub trait Messages: Correlation {
    /// A message of the host. Its text contains every value with its unit, and text from outside escaped.
    type Request<'a>: Copy + PartialEq + Debug + Display;

    /// A message of the arm. Its text contains every value with its unit, and text from outside escaped.
    type Response<'a>: Copy + PartialEq + Debug + Display;

    /// The reason why a request cannot be written: [`BufferTooShort`] if each value fits its field by its type, otherwise
    /// [`EncodeError`].
    type EncodeError: Into<EncodeError> + Debug + Display;

    /// Reads with different keys that every arm of this kind answers, as frames. An arm answers in the order of its
    /// requests: the answer to such a *fence* shows that all earlier answers have arrived or are lost. Empty if answers
    /// have numbers, or if the order is unknown.
    const FENCES: &'static [&'static [u8]] = &[];

    /// Writes a request at the front of `out` and returns its length in bytes.
    ///
    /// # Errors
    ///
    /// [`BufferTooShort`] if `out` is too short, or that a value of the request does not fit its field.
    fn encode_request(&self, request: &Self::Request<'_>, out: &mut [u8]) -> Result<usize, Self::EncodeError>;

    /// Decodes a frame from the host.
    ///
    /// # Errors
    ///
    /// [`ParseError`] if it is not a request of this protocol, with the cause and its offset.
    fn parse_request<'a>(&self, frame: &'a [u8]) -> Result<Self::Request<'a>, ParseError>;

    /// Writes a response at the front of `out` and returns its length in bytes. `to` is the key of its request, which
    /// contains the number to repeat, if there is one; `None` for an unsolicited message.
    ///
    /// # Errors
    ///
    /// [`BufferTooShort`] if `out` is too short.
    fn encode_response(
        &self,
        response: &Self::Response<'_>,
        to: Option<Self::Key>,
        out: &mut [u8],
    ) -> Result<usize, BufferTooShort>;

    /// Decodes a frame from the arm. `expect` is the decoder's expectation: some answers do not identify their request.
    ///
    /// # Errors
    ///
    /// [`ParseError`] if it is not a response of this protocol, with the cause and its offset.
    fn parse_response<'a>(&self, frame: &'a [u8], expect: Self::Expect) -> Result<Self::Response<'a>, ParseError>;

    /// The data of a response after its documented fields, which [`parse_response`](Self::parse_response) accepts and
    /// does not interpret. Empty on a protocol whose responses have no more than those.
    fn extra<'a>(&self, _frame: &'a [u8]) -> &'a [u8] {
        &[]
    }
}

/// The error of a response that is converted into the value of another one. `R` is the protocol's response.
///
/// The exchange matches answers to requests by their bytes: a caller gets this error if it asks for a value that its
/// request does not read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct OtherAnswer<R> {
    /// The response.
    pub got: R,
}

impl<R: Display> Display for OtherAnswer<R> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "another answer: {}", self.got)
    }
}

impl<R: Debug + Display> core::error::Error for OtherAnswer<R> {}
