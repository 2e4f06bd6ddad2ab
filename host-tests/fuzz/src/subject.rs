//! A protocol under test.

use core::fmt::Debug;

use armwire::alpha1::{self, Alpha1};
use armwire::ling::legacy::{self, Legacy};
use armwire::ling::{self, Ling};
use armwire::messages::Messages;
use armwire::xarm::{self, XArm};
use armwire_host_tests::reference::Piece;

use crate::{Result, Unstructured};

/// A response, and what its bytes depend on besides.
#[derive(Clone, Copy)]
pub struct AnyResponse<'a, P: Messages> {
    /// The response.
    pub response: P::Response<'a>,
    /// The answered request.
    pub to: Option<P::Key>,
    /// The expectation for its decoding.
    pub expect: P::Expect,
}

/// A protocol, and how arbitrary messages of it are made.
pub trait Subject: Messages + Copy + Default + Debug {
    /// True if the host sends requests.
    const HAS_REQUESTS: bool = true;

    /// The byte that fills the room between frames.
    const FILL: Option<u8>;

    /// The protocol in any of the ways in which it writes.
    fn any_protocol(_u: &mut Unstructured<'_>) -> Result<Self> {
        Ok(Self::default())
    }

    /// Any request; an error of a protocol that has none.
    fn any_request<'a>(u: &mut Unstructured<'a>) -> Result<Self::Request<'a>>;

    /// Any response.
    fn any_response<'a>(u: &mut Unstructured<'a>) -> Result<AnyResponse<'a, Self>>;

    /// Anything that a reader may know about a line.
    fn any_expect(u: &mut Unstructured<'_>) -> Result<Self::Expect>;

    /// A frame on a line of which this is known, unless none can be made of what is left.
    fn any_frame(self, u: &mut Unstructured<'_>, expect: Self::Expect) -> Result<Vec<u8>>;

    /// The pieces of a line with silence behind it, by a decoder written from the documents alone.
    fn reference(line: &[u8], expect: Self::Expect) -> Vec<Piece>;

    /// Takes the frame apart and writes it anew.
    fn rewrite(frame: &[u8]) -> Vec<u8>;
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

/// The bytes of a response.
pub fn response_bytes<P: Messages>(protocol: P, any: &AnyResponse<'_, P>) -> Vec<u8> {
    let mut out = vec![0; ROOM];
    let n = protocol
        .encode_response(&any.response, any.to, &mut out)
        .expect("there is room for the longest frame");
    out.truncate(n);
    out
}

/// Room for every frame.
pub const ROOM: usize = 260;

/// Something that holds of every protocol.
pub trait Check {
    /// The check for this input. Too short an input is skipped.
    fn check<P: Subject, const N: usize>(u: &mut Unstructured<'_>) -> Result<()>;
}

/// Checks it of the protocol that the first byte of the input names.
pub fn check<C: Check>(input: &[u8]) {
    let mut u = Unstructured::new(input);
    let _ = match u.arbitrary::<u8>().map(|protocol| protocol % 4) {
        Ok(0) => C::check::<Ling, { ling::MAX_FRAME }>(&mut u),
        Ok(1) => C::check::<Legacy, { legacy::MAX_FRAME }>(&mut u),
        Ok(2) => C::check::<Alpha1, { alpha1::MAX_FRAME }>(&mut u),
        _ => C::check::<XArm, { xarm::MAX_FRAME }>(&mut u),
    };
}
