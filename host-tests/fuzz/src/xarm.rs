//! Arbitrary messages of xArm.

use armwire::xarm::{
    Answer, Direction, Frame, HEADER, Key, ProtocolId, Raw, Request, Response, RotationRadius, SerialsText, State,
    TorqueSource, VersionText, XArm,
};
use armwire_host_tests::reference::{self, Piece};

use crate::subject::{converted, request_bytes, response_bytes};
use crate::{AnyResponse, Result, Subject, Unstructured};

impl Subject for XArm {
    const PADDING: Option<u8> = None;

    fn any_protocol(u: &mut Unstructured<'_>) -> Result<Self> {
        let protocol = *u.choose(&[ProtocolId::Private, ProtocolId::Supervised])?;
        Ok(Self { protocol })
    }

    fn any_request<'a>(u: &mut Unstructured<'a>) -> Result<Request<'a>> {
        u.arbitrary()
    }

    fn any_response<'a>(u: &mut Unstructured<'a>) -> Result<AnyResponse<'a, Self>> {
        let (response, transaction) = u.arbitrary()?;
        let to = match response {
            Response::ModbusRefused { function, .. } => Some((0, function.number())),
            Response::Reply { reply, .. } => Some((Self::any_protocol(u)?.protocol as u16, reply.register())),
            _ => None,
        };
        Ok(AnyResponse {
            response,
            to: to.map(|(protocol, register)| Key {
                transaction,
                protocol,
                register,
            }),
            expect: Direction::Responses,
        })
    }

    fn check_values(&response: &Response<'_>) {
        let types = converted(Answer::<()>::try_from(response))
            + converted(Answer::<Raw<'_>>::try_from(response))
            + converted(Answer::<RotationRadius>::try_from(response))
            + converted(Answer::<SerialsText<'_>>::try_from(response))
            + converted(Answer::<TorqueSource>::try_from(response))
            + converted(Answer::<VersionText<'_>>::try_from(response));
        let has_value = matches!(response, Response::Reply { state, .. } if !state.contains(State::INVALID));
        assert_eq!(types, usize::from(has_value));
    }

    fn any_expect(u: &mut Unstructured<'_>) -> Result<Direction> {
        u.choose(&[Direction::Requests, Direction::Responses]).copied()
    }

    fn any_frame(self, u: &mut Unstructured<'_>, expect: Direction) -> Result<Vec<u8>> {
        match expect {
            Direction::Requests => Self::any_request(u).map(|request| request_bytes(self, &request)),
            Direction::Responses => Self::any_response(u).map(|any| response_bytes(self, &any.response, any.to)),
        }
    }

    fn reference(line: &[u8], expect: Direction) -> Vec<Piece> {
        reference::xarm::decode(line, expect)
    }

    fn rewrite(bytes: &[u8]) -> Vec<u8> {
        let frame = Frame::parse(bytes).expect("it is a frame");
        assert_eq!(frame.body.len() + HEADER, bytes.len());
        reference::xarm::frame(frame.transaction, frame.protocol, frame.body)
    }
}
