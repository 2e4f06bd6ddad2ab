//! Arbitrary messages of Ling.

use armwire::ling::{
    ForceFeedback, Frame, Info, JointState, Ling, MAX_DATA, MAX_FRAME, ModeReply, ModeState, OVERHEAD, PerServo,
    Request, Response, SELF_CHECK, SelfCheck, Stroke,
};
use armwire::messages::Messages;
use armwire_host_tests::reference::{self, Piece};

use crate::subject::{any_bytes, converted, request_bytes, response_bytes};
use crate::{AnyResponse, Result, Subject, Unstructured};

impl Subject for Ling {
    const PADDING: Option<u8> = None;

    fn any_request<'a>(u: &mut Unstructured<'a>) -> Result<Request> {
        u.arbitrary()
    }

    fn any_response<'a>(u: &mut Unstructured<'a>) -> Result<AnyResponse<'a, Self>> {
        Ok(AnyResponse {
            response: u.arbitrary()?,
            to: None,
            expect: (),
        })
    }

    fn check_values(&response: &Response) {
        let types = converted(Info::try_from(response))
            + converted(JointState::try_from(response))
            + converted(PerServo::<u8>::try_from(response))
            + converted(PerServo::<u16>::try_from(response))
            + converted(SelfCheck::try_from(response))
            + converted(ModeReply::try_from(response))
            + converted(ModeState::try_from(response))
            + converted(ForceFeedback::try_from(response))
            + converted(Stroke::try_from(response));
        assert_eq!(types, 1);
    }

    fn any_expect(_u: &mut Unstructured<'_>) -> Result<()> {
        Ok(())
    }

    fn any_frame(self, u: &mut Unstructured<'_>, (): ()) -> Result<Vec<u8>> {
        match u.int_in_range(0..=2)? {
            0 => Self::any_request(u).map(|request| request_bytes(self, &request)),
            1 => Self::any_response(u).map(|any| response_bytes(self, &any.response, None)),
            _ => {
                let (command, function) = u.arbitrary()?;
                Ok(reference::ling::frame(command, function, any_bytes(u, MAX_DATA)?))
            }
        }
    }

    fn reference(line: &[u8], (): ()) -> Vec<Piece> {
        reference::decode(line, reference::ling::scan)
    }

    fn rewrite(bytes: &[u8]) -> Vec<u8> {
        let frame = Frame::parse(bytes).expect("it is a frame");
        assert_eq!(frame.data.len() + OVERHEAD, bytes.len());
        // One frame has a different encoding: its length field is 0.
        let request = Ling.parse_request(bytes);
        match frame.data {
            [data] if request == Ok(Request::SelfCheck) && *data == SELF_CHECK[4] => SELF_CHECK.to_vec(),
            _ => {
                let mut out = [0; MAX_FRAME];
                let len = frame.encode(&mut out).expect("it was read");
                out[..len].to_vec()
            }
        }
    }
}
