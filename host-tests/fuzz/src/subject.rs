//! A protocol under test.

use core::fmt::Debug;

use armwire::alpha1::{self, Alpha1};
use armwire::ling::legacy::{self, Legacy};
use armwire::ling::{self, Ling};
use armwire::xarm::{self, XArm};
use armwire::{EncodeError, Protocol};
use armwire_host_tests::reference::Piece;

use crate::{Result, Unstructured};

/// A protocol, and how arbitrary messages of it are made.
pub trait Subject: Protocol<Expect: Debug + PartialEq> {
    /// Whether there is anything that the host says.
    const HAS_REQUESTS: bool = true;

    /// The byte that fills the room between frames.
    const FILL: Option<u8>;

    /// Any request; an error of a protocol that has none.
    fn any_request(u: &mut Unstructured<'_>) -> Result<Self::Request>;

    /// Any response, and what it must be expected as.
    fn any_response(u: &mut Unstructured<'_>) -> Result<(Self::Response, Self::Expect)>;

    /// Anything that a reader may know about a line.
    fn any_expect(u: &mut Unstructured<'_>) -> Result<Self::Expect>;

    /// A frame on a line of which this is known, unless none can be made of what is left.
    fn any_frame(u: &mut Unstructured<'_>, expect: Self::Expect) -> Result<Vec<u8>>;

    /// What a decoder that is written from the documents alone makes of a line that is silent afterwards.
    fn reference(line: &[u8], expect: Self::Expect) -> Vec<Piece>;

    /// How many bytes a frame is on the wire.
    fn wire_len(frame: Self::Frame<'_>) -> usize;

    /// Writes the frame anew.
    fn encode_frame(frame: Self::Frame<'_>, expect: Self::Expect, out: &mut [u8]) -> Result<usize, EncodeError>;
}

/// The bytes of a request.
pub fn request_bytes<P: Protocol>(request: &P::Request) -> Vec<u8> {
    let mut out = vec![0; P::MAX_FRAME];
    let n = P::encode_request(request, &mut out).expect("there is room for the longest frame");
    out.truncate(n);
    out
}

/// The bytes of a response.
pub fn response_bytes<P: Protocol>(response: &P::Response) -> Vec<u8> {
    let mut out = vec![0; P::MAX_FRAME];
    let n = P::encode_response(response, &mut out).expect("there is room for the longest frame");
    out.truncate(n);
    out
}

/// Something that holds of every protocol.
pub trait Check {
    /// Whether it does, of this input. Too short an input is none.
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
