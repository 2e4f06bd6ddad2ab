//! Arbitrary messages of xArm.

use armwire::xarm::{
    Direction, Frame, HEADER, Joint, Key, MAX_PARAMS, ModbusFunction, ProtocolId, Raw, Register, Reply, Request,
    Response, RotationRadius, SerialsText, State, TorqueSource, VersionText, XArm,
};
use armwire_host_tests::reference::xarm::Speaker;
use armwire_host_tests::reference::{self, Piece};

use crate::subject::{request_bytes, response_bytes};
use crate::{Result, Said, Subject, Unstructured};

/// A register that is not typed.
fn any_raw<'a>(u: &mut Unstructured<'a>) -> Result<Raw<'a>> {
    let register = u.arbitrary()?;
    let register = if Register::from_code(register).is_some() {
        0xF0
    } else {
        register
    };
    Ok(Raw::new(register, any_params(u, 0)?).expect("it is not typed and not too long"))
}

/// At least so many bytes of parameters, unless there are fewer.
fn any_params<'a>(u: &mut Unstructured<'a>, least: usize) -> Result<&'a [u8]> {
    let len = u.int_in_range(least..=MAX_PARAMS)?;
    u.bytes(len.min(u.len().max(least)))
}

impl Subject for XArm {
    const FILL: Option<u8> = None;

    fn any_protocol(u: &mut Unstructured<'_>) -> Result<Self> {
        let protocol = *u.choose(&[ProtocolId::Private, ProtocolId::Supervised])?;
        Ok(Self { protocol })
    }

    fn any_request<'a>(u: &mut Unstructured<'a>) -> Result<Request<'a>> {
        Ok(match u.int_in_range(0..=8)? {
            0 => Request::Heartbeat,
            1 => Request::ReadVersion,
            2 => Request::ReadSerials,
            3 => Request::ReloadDynamics,
            4 => Request::ReadTorqueSource,
            5 => Request::ReadRotationRadius(Joint::new(u.int_in_range(1..=7)?).expect("in range")),
            6 => Request::Shutdown,
            7 => Request::Reboot,
            _ => Request::Raw(any_raw(u)?),
        })
    }

    fn any_response<'a>(u: &mut Unstructured<'a>) -> Result<Said<'a, Self>> {
        let said = |response, to| Said {
            response,
            to,
            expect: Direction::Responses,
        };
        let reply = match u.int_in_range(0..=8)? {
            0 => return Ok(said(Response::Heartbeat, None)),
            1 => {
                let (transaction, unit) = u.arbitrary()?;
                let function = ModbusFunction::new(u.int_in_range(0..=127)?).expect("in range");
                let to = Key {
                    transaction,
                    protocol: 0,
                    register: function.number(),
                };
                return Ok(said(Response::ModbusRefused { unit, function }, Some(to)));
            }
            2 => Reply::empty(u.arbitrary()?),
            3 => Reply::Version(VersionText(any_params(u, 1)?)),
            4 => Reply::Serials(SerialsText(any_params(u, 1)?)),
            5 => Reply::TorqueSource(*u.choose(&[TorqueSource::Torque, TorqueSource::Current])?),
            6 => Reply::RotationRadius(RotationRadius {
                millimetres: f32::from_bits(u.arbitrary()?),
            }),
            7 => Reply::SystemControl(u.arbitrary()?),
            _ => Reply::Raw(any_raw(u)?),
        };
        let state = State(u.arbitrary()?);
        let to = Key {
            transaction: u.arbitrary()?,
            protocol: Self::any_protocol(u)?.protocol as u16,
            register: reply.register(),
        };
        Ok(said(Response::Reply { state, reply }, Some(to)))
    }

    fn any_expect(u: &mut Unstructured<'_>) -> Result<Direction> {
        u.choose(&[Direction::Requests, Direction::Responses]).copied()
    }

    fn any_frame(self, u: &mut Unstructured<'_>, expect: Direction) -> Result<Vec<u8>> {
        match expect {
            Direction::Requests => Self::any_request(u).map(|request| request_bytes(self, &request)),
            Direction::Responses => Self::any_response(u).map(|said| response_bytes(self, &said)),
        }
    }

    fn reference(line: &[u8], expect: Direction) -> Vec<Piece> {
        let speaker = match expect {
            Direction::Requests => Speaker::Host,
            Direction::Responses => Speaker::Arm,
        };
        reference::xarm::decode(line, speaker)
    }

    fn rewrite(bytes: &[u8]) -> Vec<u8> {
        let frame = Frame::parse(bytes).expect("it is a frame");
        assert_eq!(frame.body.len() + HEADER, bytes.len());
        xarm_frame(frame)
    }
}

/// The bytes of a frame.
pub fn xarm_frame(frame: Frame<'_>) -> Vec<u8> {
    let numbers = [frame.transaction, frame.protocol, frame.body.len() as u16].map(u16::to_be_bytes);
    [numbers.as_flattened(), frame.body].concat()
}
