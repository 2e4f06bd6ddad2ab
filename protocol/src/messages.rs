//! Typed requests and responses, both ways.

use core::fmt::Debug;

use crate::dialect::Dialect;
use crate::{BufferTooShort, ParseError};

/// The messages of one kind of arm.
///
/// Both directions are here, so that a [`Client`](crate::Client) and a [`Device`](crate::Device) are made of the same
/// definitions and tested against each other. A message borrows its texts and parameters from its frame.
/// [`Ling`](crate::ling::Ling) is the one to read as an example.
pub trait Messages: Dialect {
    /// A message of the host.
    type Request<'a>: Copy + PartialEq + Debug;

    /// A message of the arm.
    type Response<'a>: Copy + PartialEq + Debug;

    /// Writes a request at the front of `out` and returns its length in bytes.
    ///
    /// # Errors
    ///
    /// [`BufferTooShort`] when `out` has no room for it.
    fn encode_request(&self, request: &Self::Request<'_>, out: &mut [u8]) -> Result<usize, BufferTooShort>;

    /// Reads a frame from the host.
    ///
    /// # Errors
    ///
    /// [`ParseError`] when it is no request of this protocol: what is wrong, and where.
    fn parse_request<'a>(&self, frame: &'a [u8]) -> Result<Self::Request<'a>, ParseError>;

    /// Writes a response at the front of `out` and returns its length in bytes. `to` is the key of the request that it
    /// answers, whose numbers it repeats where there are some; `None` for a message that answers nothing.
    ///
    /// # Errors
    ///
    /// [`BufferTooShort`] when `out` has no room for it.
    fn encode_response(
        &self,
        response: &Self::Response<'_>,
        to: Option<Self::Key>,
        out: &mut [u8],
    ) -> Result<usize, BufferTooShort>;

    /// Reads a frame from the arm, where `expect` is what was expected on the line: some answers do not say what they answer.
    ///
    /// # Errors
    ///
    /// [`ParseError`] when it is no response of this protocol: what is wrong, and where.
    fn parse_response<'a>(&self, frame: &'a [u8], expect: Self::Expect) -> Result<Self::Response<'a>, ParseError>;
}
