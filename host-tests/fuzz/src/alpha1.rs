//! Arbitrary messages of Alpha1.

use armwire::alpha1::{
    Alpha1, Expect, FirmwareVersion, Frame, Outcome, Request, Response, ServoAnswer, ServoResponse, ServoStates, Text,
};
use armwire::framing::{Framing, Scan};
use armwire_host_tests::reference::{self, Piece};

use crate::subject::{converted, request_bytes, response_bytes};
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

/// A response, perhaps this expected answer of a servo.
fn any_response_with<'a>(u: &mut Unstructured<'a>, answer: Option<ServoAnswer>) -> Result<Response<'a>> {
    match answer {
        Some(answer) if u.arbitrary()? => any_servo_response(u, answer).map(Response::Servo),
        _ => u.arbitrary(),
    }
}

impl Subject for Alpha1 {
    const PADDING: Option<u8> = Some(0);

    fn any_request<'a>(u: &mut Unstructured<'a>) -> Result<Request<'a>> {
        u.arbitrary()
    }

    fn any_response<'a>(u: &mut Unstructured<'a>) -> Result<AnyResponse<'a, Self>> {
        let answer = match Self::any_expect(u)? {
            Expect::Requests => None,
            Expect::Responses(answer) => answer,
        };
        Ok(AnyResponse {
            response: any_response_with(u, answer)?,
            to: None,
            expect: Expect::Responses(answer),
        })
    }

    fn check_values(&response: &Response<'_>) {
        let types = converted(FirmwareVersion::try_from(response))
            + converted(Outcome::try_from(response))
            + converted(ServoResponse::try_from(response))
            + converted(ServoStates::try_from(response))
            + converted(Text::try_from(response));
        // Some results of a servo are an outcome, too.
        let is_servo = matches!(response, Response::Servo(_));
        assert!((1..=1 + usize::from(is_servo)).contains(&types));
    }

    fn any_expect(u: &mut Unstructured<'_>) -> Result<Expect> {
        Ok(match u.int_in_range(0..=2)? {
            0 => Expect::Requests,
            1 => Expect::Responses(None),
            _ => Expect::Responses(Some(any_answer(u)?)),
        })
    }

    fn any_frame(self, u: &mut Unstructured<'_>, expect: Expect) -> Result<Vec<u8>> {
        let answer = match expect {
            Expect::Requests => return Self::any_request(u).map(|request| request_bytes(self, &request)),
            Expect::Responses(answer) => answer,
        };
        let bytes = response_bytes(self, &any_response_with(u, answer)?, None);
        // A single byte that may begin a header is an answer only if no header follows.
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
            Frame::Message { command, data } => reference::alpha1::frame(command, data),
            Frame::Byte(byte) => vec![byte],
        }
    }
}
