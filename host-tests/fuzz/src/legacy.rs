//! Arbitrary messages of Ling's older generation.

use armwire::ling::legacy::{Frame, Legacy, MAX_DATA, OVERHEAD, Request, parity};
use armwire_host_tests::reference::{self, Piece};

use crate::subject::response_bytes;
use crate::{AnyResponse, Result, Subject, Unstructured};

impl Subject for Legacy {
    const HAS_REQUESTS: bool = false;
    const FILL: Option<u8> = None;

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
            return Self::any_response(u).map(|any| response_bytes(self, &any));
        }
        let command = u.arbitrary()?;
        let len = u.int_in_range(0..=MAX_DATA)?;
        let data = u.bytes(len.min(u.len()))?;
        Ok(written(command, data))
    }

    fn reference(line: &[u8], (): ()) -> Vec<Piece> {
        reference::decode(line, reference::legacy::scan)
    }

    fn rewrite(bytes: &[u8]) -> Vec<u8> {
        let frame = Frame::parse(bytes).expect("it is a frame");
        assert_eq!(frame.data.len() + OVERHEAD, bytes.len());
        written(frame.command, frame.data)
    }
}

fn written(command: u8, data: &[u8]) -> Vec<u8> {
    [&[0xAA, command, data.len() as u8], data, &[parity(data), 0xFF]].concat()
}
