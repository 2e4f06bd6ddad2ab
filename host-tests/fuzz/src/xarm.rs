//! Arbitrary messages of xArm.

use armwire::EncodeError;
use armwire::xarm::{
    Command, Direction, Frame, HEADER, Header, Joint, MAX_PARAMS, ModbusFunction, ProtocolId, Raw, Register, Reply,
    Request, Response, RotationRadius, SerialsText, State, TEXT, TorqueSource, VersionText, XArm,
};
use armwire_host_tests::reference::xarm::Speaker;
use armwire_host_tests::reference::{self, Piece};

use crate::subject::{request_bytes, response_bytes};
use crate::{Result, Subject, Unstructured};

fn any_header(u: &mut Unstructured<'_>) -> Result<Header> {
    Ok(Header {
        transaction: u.arbitrary()?,
        protocol: *u.choose(&[ProtocolId::Private, ProtocolId::Supervised])?,
    })
}

/// A register that is not typed.
fn any_raw(u: &mut Unstructured<'_>) -> Result<Raw> {
    let register = u.arbitrary()?;
    let register = if Register::from_code(register).is_some() {
        0xF0
    } else {
        register
    };
    let len = u.int_in_range(0..=MAX_PARAMS)?;
    let params = u.bytes(len.min(u.len()))?;
    Ok(Raw::new(register, params).expect("it is not typed and not too long"))
}

fn any_text(u: &mut Unstructured<'_>) -> Result<[u8; TEXT]> {
    let mut text = [0; TEXT];
    let given = u.bytes(TEXT.min(u.len()))?;
    text[..given.len()].copy_from_slice(given);
    Ok(text)
}

impl Subject for XArm {
    const FILL: Option<u8> = None;

    fn any_request(u: &mut Unstructured<'_>) -> Result<Request> {
        let command = match u.int_in_range(0..=8)? {
            0 => return Ok(Request::Heartbeat),
            1 => Command::ReadVersion,
            2 => Command::ReadSerials,
            3 => Command::ReloadDynamics,
            4 => Command::ReadTorqueSource,
            5 => Command::ReadRotationRadius(Joint::new(u.int_in_range(1..=7)?).expect("in range")),
            6 => Command::Shutdown,
            7 => Command::Reboot,
            _ => Command::Raw(any_raw(u)?),
        };
        let header = any_header(u)?;
        Ok(Request::Call { header, command })
    }

    fn any_response(u: &mut Unstructured<'_>) -> Result<(Response, Direction)> {
        let reply = match u.int_in_range(0..=8)? {
            0 => return Ok((Response::Heartbeat, Direction::Responses)),
            1 => {
                let refused = Response::ModbusRefused {
                    transaction: u.arbitrary()?,
                    unit: u.arbitrary()?,
                    function: ModbusFunction::new(u.int_in_range(0..=127)?).expect("in range"),
                };
                return Ok((refused, Direction::Responses));
            }
            2 => Reply::empty(u.arbitrary()?),
            3 => Reply::Version(VersionText(any_text(u)?)),
            4 => Reply::Serials(SerialsText(any_text(u)?)),
            5 => Reply::TorqueSource(*u.choose(&[TorqueSource::Torque, TorqueSource::Current])?),
            6 => Reply::RotationRadius(RotationRadius {
                millimetres: f32::from_bits(u.arbitrary()?),
            }),
            7 => Reply::SystemControl(u.arbitrary()?),
            _ => Reply::Raw(any_raw(u)?),
        };
        let response = Response::Reply {
            header: any_header(u)?,
            state: State(u.arbitrary()?),
            reply,
        };
        Ok((response, Direction::Responses))
    }

    fn any_expect(u: &mut Unstructured<'_>) -> Result<Direction> {
        u.choose(&[Direction::Requests, Direction::Responses]).copied()
    }

    fn any_frame(u: &mut Unstructured<'_>, expect: Direction) -> Result<Vec<u8>> {
        match expect {
            Direction::Requests => Self::any_request(u).map(|request| request_bytes::<Self>(&request)),
            Direction::Responses => Self::any_response(u).map(|(response, _)| response_bytes::<Self>(&response)),
        }
    }

    fn reference(line: &[u8], expect: Direction) -> Vec<Piece> {
        let speaker = match expect {
            Direction::Requests => Speaker::Host,
            Direction::Responses => Speaker::Arm,
        };
        reference::xarm::decode(line, speaker)
    }

    fn wire_len(frame: Frame<'_>) -> usize {
        frame.body.len() + HEADER
    }

    fn encode_frame(frame: Frame<'_>, expect: Direction, out: &mut [u8]) -> Result<usize, EncodeError> {
        frame.encode(expect, out)
    }
}
