//! Arbitrary messages of Alpha1.

use armwire::alpha1::{Alpha1, Expect, Frame, Request, Response, ServoAnswer, ServoResponse, checksum};
use armwire::framing::{Framing, Scan};
use armwire_host_tests::reference::{self, Piece};

use crate::subject::{request_bytes, response_bytes};
use crate::{AnyResponse, Result, Subject, Unstructured};

fn any_answer(u: &mut Unstructured<'_>) -> Result<ServoAnswer> {
    Ok(match u.int_in_range(0..=5)? {
        0 => ServoAnswer::Acknowledgement(u.arbitrary()?),
        1 => ServoAnswer::Angles,
        2 => ServoAnswer::IdChanged,
        3 => ServoAnswer::OffsetSet,
        4 => ServoAnswer::Offset,
        _ => ServoAnswer::Version,
    })
}

/// An answer of a servo to this expectation.
fn any_servo_response(u: &mut Unstructured<'_>, answer: ServoAnswer) -> Result<ServoResponse> {
    if let ServoAnswer::Acknowledgement(servo) = answer {
        return Ok(ServoResponse::Acknowledged(servo));
    }
    let (servo, outcome) = u.arbitrary()?;
    Ok(match answer {
        ServoAnswer::Angles => ServoResponse::Angles {
            servo,
            outcome,
            target: u.arbitrary()?,
            actual: u.arbitrary()?,
        },
        ServoAnswer::IdChanged => ServoResponse::IdChanged {
            servo,
            outcome,
            was: u.arbitrary()?,
        },
        ServoAnswer::OffsetSet | ServoAnswer::Acknowledgement(_) => ServoResponse::OffsetSet { servo, outcome },
        ServoAnswer::Offset => ServoResponse::Offset {
            servo,
            outcome,
            thirds: u.arbitrary()?,
        },
        ServoAnswer::Version => ServoResponse::Version {
            servo,
            outcome,
            version: u.arbitrary()?,
        },
    })
}

impl Subject for Alpha1 {
    const FILL: Option<u8> = Some(0);

    fn any_request<'a>(u: &mut Unstructured<'a>) -> Result<Request<'a>> {
        u.arbitrary()
    }

    fn any_response<'a>(u: &mut Unstructured<'a>) -> Result<AnyResponse<'a, Self>> {
        let expect = Self::any_expect(u)?;
        let (response, expect) = match expect {
            Expect::Responses(Some(answer)) if u.arbitrary()? => {
                (Response::Servo(any_servo_response(u, answer)?), expect)
            }
            Expect::Responses(_) => (u.arbitrary()?, expect),
            Expect::Requests => (u.arbitrary()?, Expect::Responses(None)),
        };
        Ok(AnyResponse {
            response,
            to: None,
            expect,
        })
    }

    fn any_expect(u: &mut Unstructured<'_>) -> Result<Expect> {
        Ok(match u.int_in_range(0..=2)? {
            0 => Expect::Requests,
            1 => Expect::Responses(None),
            _ => Expect::Responses(Some(any_answer(u)?)),
        })
    }

    fn any_frame(self, u: &mut Unstructured<'_>, expect: Expect) -> Result<Vec<u8>> {
        let response = match expect {
            Expect::Requests => return Self::any_request(u).map(|request| request_bytes(self, &request)),
            Expect::Responses(Some(answer)) if u.arbitrary()? => Response::Servo(any_servo_response(u, answer)?),
            Expect::Responses(_) => u.arbitrary()?,
        };
        let any = AnyResponse {
            response,
            to: None,
            expect,
        };
        let bytes = response_bytes(self, &any);
        // A single byte that begins a header too is an answer only where what follows does not make it one.
        match self.scan(&bytes, expect) == Scan::Frame(bytes.len()) {
            true => Ok(bytes),
            false => Err(arbitrary::Error::IncorrectFormat),
        }
    }

    fn reference(line: &[u8], expect: Expect) -> Vec<Piece> {
        reference::decode(line, |bytes| reference::alpha1::scan(bytes, expect))
    }

    fn rewrite(bytes: &[u8]) -> Vec<u8> {
        match Frame::parse(bytes).expect("it is a frame") {
            Frame::Message {
                command,
                data: [status],
            } if bytes.len() == 4 => vec![command, command.rotate_left(4), *status, 0xED],
            Frame::Message { command, data } => alpha1_message(command, data),
            Frame::Byte(byte) => vec![byte],
        }
    }
}

/// A frame with a checksum.
pub fn alpha1_message(command: u8, data: &[u8]) -> Vec<u8> {
    [&[command, command.rotate_left(4)], data, &[checksum(data), 0xED]].concat()
}
