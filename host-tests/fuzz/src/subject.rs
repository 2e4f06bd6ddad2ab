//! A protocol under test.

use core::fmt::Debug;

use armwire::alpha1::{self, Alpha1};
use armwire::ling::legacy::{self, Legacy};
use armwire::ling::{self, Ling};
use armwire::messages::Messages;
use armwire::xarm::{self, XArm};
use armwire_host_tests::reference::Piece;

use crate::{Result, Unstructured};

/// A response, its request, and the expectation for its decoding.
#[derive(Clone, Copy)]
pub struct AnyResponse<'a, P: Messages> {
    /// The response.
    pub response: P::Response<'a>,
    /// The answered request.
    pub to: Option<P::Key>,
    /// The expectation for its decoding.
    pub expect: P::Expect,
}

/// A protocol with arbitrary messages.
pub trait Subject: Messages + Copy + Default + Debug {
    /// True if the host sends requests.
    const HAS_REQUESTS: bool = true;

    /// The byte of the padding between frames.
    const PADDING: Option<u8>;

    /// The protocol in any of its variants.
    fn any_protocol(_u: &mut Unstructured<'_>) -> Result<Self> {
        Ok(Self::default())
    }

    /// Any request. An error if the protocol has none.
    fn any_request<'a>(u: &mut Unstructured<'a>) -> Result<Self::Request<'a>>;

    fn any_response<'a>(u: &mut Unstructured<'a>) -> Result<AnyResponse<'a, Self>>;

    /// Checks that the response converts to the types of its value, and to no other.
    fn check_values(_response: &Self::Response<'_>) {}

    /// Any expectation of a decoder.
    fn any_expect(u: &mut Unstructured<'_>) -> Result<Self::Expect>;

    /// Any frame with this expectation. An error if the rest of the input is no frame.
    fn any_frame(self, u: &mut Unstructured<'_>, expect: Self::Expect) -> Result<Vec<u8>>;

    /// The items of a line with silence behind it, by a decoder written from the documents alone.
    fn reference(line: &[u8], expect: Self::Expect) -> Vec<Piece>;

    /// Parses the frame and encodes it again.
    fn rewrite(frame: &[u8]) -> Vec<u8>;
}

/// At most `max` bytes.
pub(crate) fn any_bytes<'a>(u: &mut Unstructured<'a>, max: usize) -> Result<&'a [u8]> {
    let len = u.int_in_range(0..=max)?;
    u.bytes(len.min(u.len()))
}

/// The bytes of a request.
pub fn request_bytes<P: Messages>(protocol: P, request: &P::Request<'_>) -> Vec<u8> {
    let mut out = vec![0; ROOM];
    let n = protocol
        .encode_request(request, &mut out)
        .expect("there is room for the longest frame");
    out.truncate(n);
    out
}

/// The bytes of a response to this request.
pub fn response_bytes<P: Messages>(protocol: P, response: &P::Response<'_>, to: Option<P::Key>) -> Vec<u8> {
    let mut out = vec![0; ROOM];
    let n = protocol
        .encode_response(response, to, &mut out)
        .expect("there is room for the longest frame");
    out.truncate(n);
    out
}

/// 1 if the value was converted. An error names the response.
pub(crate) fn converted<T, E: ToString>(value: core::result::Result<T, E>) -> usize {
    value.map_or_else(
        |error| {
            assert!(error.to_string().starts_with("another answer: "));
            0
        },
        |_| 1,
    )
}

/// Room for every frame.
pub const ROOM: usize = 260;

/// A property of every protocol.
pub trait Check {
    /// Checks the property for this input. An error if the input is too short.
    fn check<P: Subject, const N: usize>(u: &mut Unstructured<'_>) -> Result<()>;
}

/// Checks the property for the protocol that the first byte of the input selects.
pub fn check<C: Check>(input: &[u8]) {
    let mut u = Unstructured::new(input);
    let _ = match u.arbitrary::<u8>().map(|protocol| protocol % 4) {
        Ok(0) => C::check::<Ling, { ling::MAX_FRAME }>(&mut u),
        Ok(1) => C::check::<Legacy, { legacy::MAX_FRAME }>(&mut u),
        Ok(2) => C::check::<Alpha1, { alpha1::MAX_FRAME }>(&mut u),
        _ => C::check::<XArm, { xarm::MAX_FRAME }>(&mut u),
    };
}
