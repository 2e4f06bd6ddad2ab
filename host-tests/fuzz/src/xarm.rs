//! Arbitrary messages of xArm.

use armwire::xarm::{Direction, Frame, HEADER, Key, ProtocolId, Request, Response, XArm};
use armwire_host_tests::reference::{self, Piece};

use crate::subject::{request_bytes, response_bytes};
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
