//! Arbitrary messages of Ling's older generation.

use armwire::ling::legacy::{Frame, Legacy, MAX_DATA, OVERHEAD, Request};
use armwire_host_tests::reference::{self, Piece};

use crate::subject::{any_bytes, response_bytes};
use crate::{AnyResponse, Result, Subject, Unstructured};

impl Subject for Legacy {
    const HAS_REQUESTS: bool = false;
    const PADDING: Option<u8> = None;

    fn any_request<'a>(_u: &mut Unstructured<'a>) -> Result<Request> {
        Err(arbitrary::Error::IncorrectFormat)
    }

    fn any_response<'a>(u: &mut Unstructured<'a>) -> Result<AnyResponse<'a, Self>> {
        Ok(AnyResponse {
            response: u.arbitrary()?,
            to: None,
            expect: (),
        })
    }

    fn any_expect(_u: &mut Unstructured<'_>) -> Result<()> {
        Ok(())
    }

    fn any_frame(self, u: &mut Unstructured<'_>, (): ()) -> Result<Vec<u8>> {
        if u.arbitrary()? {
            return Self::any_response(u).map(|any| response_bytes(self, &any.response, None));
        }
        let command = u.arbitrary()?;
        Ok(reference::legacy::frame(command, any_bytes(u, MAX_DATA)?))
    }

    fn reference(line: &[u8], (): ()) -> Vec<Piece> {
        reference::decode(line, reference::legacy::scan)
    }

    fn rewrite(bytes: &[u8]) -> Vec<u8> {
        let frame = Frame::parse(bytes).expect("it is a frame");
        assert_eq!(frame.data.len() + OVERHEAD, bytes.len());
        reference::legacy::frame(frame.command, frame.data)
    }
}
