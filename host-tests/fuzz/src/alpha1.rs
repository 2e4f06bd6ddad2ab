//! Arbitrary messages of Alpha1.

use armwire::alpha1::{
    Action, Address, Alpha1, Angle, Expect, FirmwareVersion, Frame, Interval, Led, MAX_TEXT, MoveTime, Offset,
    OffsetTool, Outcome, Request, Response, ServoAnswer, ServoId, ServoRequest, ServoResponse, ServoStates, Text,
    UsbType, checksum,
};
use armwire::framing::{Framing, Scan};
use armwire_host_tests::reference::alpha1::Speaker;
use armwire_host_tests::reference::{self, Piece};

use crate::subject::{request_bytes, response_bytes};
use crate::{Result, Said, Subject, Unstructured};

fn any_servo(u: &mut Unstructured<'_>) -> Result<ServoId> {
    Ok(ServoId::new(u.int_in_range(1..=240)?).expect("in range"))
}

fn any_address(u: &mut Unstructured<'_>) -> Result<Address> {
    Ok(match u.arbitrary()? {
        true => Address::All,
        false => Address::One(any_servo(u)?),
    })
}

fn any_angle(u: &mut Unstructured<'_>) -> Result<Angle> {
    Ok(Angle::new(u.int_in_range(0..=240)?).expect("in range"))
}

fn any_text<'a>(u: &mut Unstructured<'a>) -> Result<Text<'a>> {
    let len = u.int_in_range(0..=MAX_TEXT)?;
    let text = u.bytes(len.min(u.len()))?;
    Ok(Text::new(text).expect("it is not too long"))
}

fn any_outcome(u: &mut Unstructured<'_>) -> Result<Outcome> {
    u.choose(&[Outcome::Success, Outcome::Failure]).copied()
}

fn any_action(u: &mut Unstructured<'_>) -> Result<Action> {
    let mut angles = [None; 20];
    for angle in &mut angles {
        *angle = match u.arbitrary()? {
            true => Some(any_angle(u)?),
            false => None,
        };
    }
    Ok(Action {
        angles,
        time: MoveTime::new(u.arbitrary()?),
        interval: Interval::new(u.arbitrary()?),
    })
}

fn any_servo_request(u: &mut Unstructured<'_>) -> Result<ServoRequest> {
    Ok(match u.int_in_range(0..=7)? {
        0 => ServoRequest::Move {
            to: any_address(u)?,
            angle: any_angle(u)?,
            time: MoveTime::new(u.arbitrary()?),
            lock: Interval::new(u.arbitrary()?),
        },
        1 => ServoRequest::Release(any_address(u)?),
        2 => ServoRequest::SetLed {
            to: any_address(u)?,
            led: Led(u.arbitrary()?),
        },
        3 => ServoRequest::ReadAngles(any_servo(u)?),
        4 => ServoRequest::ChangeId {
            from: any_servo(u)?,
            to: any_servo(u)?,
        },
        5 => ServoRequest::SetOffset(any_servo(u)?, Offset::new(u.int_in_range(-90..=90)?).expect("in range")),
        6 => ServoRequest::ReadOffset(any_servo(u)?),
        _ => ServoRequest::ReadVersion(any_servo(u)?),
    })
}

fn any_robot_response<'a>(u: &mut Unstructured<'a>) -> Result<Response<'a>> {
    Ok(match u.int_in_range(0..=7)? {
        0 => Response::HardwareVersion(any_text(u)?),
        1 => Response::ServoStates(ServoStates(u.arbitrary()?)),
        2 => Response::Stopped(any_outcome(u)?),
        3 => Response::FirmwareVersion(FirmwareVersion {
            outcome: any_outcome(u)?,
            text: u.arbitrary()?,
        }),
        4 => Response::Acted(any_outcome(u)?),
        5 => Response::OffsetTool(any_outcome(u)?),
        6 => Response::UsbType(any_outcome(u)?),
        _ => Response::Playing(any_outcome(u)?),
    })
}

fn any_answer(u: &mut Unstructured<'_>) -> Result<ServoAnswer> {
    Ok(match u.int_in_range(0..=5)? {
        0 => ServoAnswer::Acknowledgement(any_servo(u)?),
        1 => ServoAnswer::Angles,
        2 => ServoAnswer::IdChanged,
        3 => ServoAnswer::OffsetSet,
        4 => ServoAnswer::Offset,
        _ => ServoAnswer::Version,
    })
}

/// What a servo says when this is expected of it.
fn any_servo_response(u: &mut Unstructured<'_>, answer: ServoAnswer) -> Result<ServoResponse> {
    if let ServoAnswer::Acknowledgement(servo) = answer {
        return Ok(ServoResponse::Acknowledged(servo));
    }
    let (servo, outcome) = (any_servo(u)?, any_outcome(u)?);
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
        Ok(match u.int_in_range(0..=8)? {
            0 => Request::ReadHardwareVersion,
            1 => Request::ReadServoStates,
            2 => Request::Stop,
            3 => Request::ReadFirmwareVersion,
            4 => Request::Act(any_action(u)?),
            5 => Request::SetOffsetTool(*u.choose(&[OffsetTool::Connect, OffsetTool::Disconnect])?),
            6 => Request::SetUsbType(*u.choose(&[UsbType::Disk, UsbType::SerialPort, UsbType::Hid])?),
            7 => Request::Play(any_text(u)?),
            _ => Request::Servo(any_servo_request(u)?),
        })
    }

    fn any_response<'a>(u: &mut Unstructured<'a>) -> Result<Said<'a, Self>> {
        let expect = Self::any_expect(u)?;
        let (response, expect) = match expect {
            Expect::Responses(Some(answer)) if u.arbitrary()? => {
                (Response::Servo(any_servo_response(u, answer)?), expect)
            }
            Expect::Responses(_) => (any_robot_response(u)?, expect),
            Expect::Requests => (any_robot_response(u)?, Expect::Responses(None)),
        };
        Ok(Said {
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
            Expect::Responses(_) => any_robot_response(u)?,
        };
        let said = Said {
            response,
            to: None,
            expect,
        };
        let bytes = response_bytes(self, &said);
        // A single byte that begins a header too is an answer only where what follows does not make it one.
        match self.scan(&bytes, expect) == Scan::Frame(bytes.len()) {
            true => Ok(bytes),
            false => Err(arbitrary::Error::IncorrectFormat),
        }
    }

    fn reference(line: &[u8], expect: Expect) -> Vec<Piece> {
        let speaker = match expect {
            Expect::Requests => Speaker::Host,
            Expect::Responses(Some(ServoAnswer::Acknowledgement(id))) => Speaker::Robot(Some(id.get())),
            Expect::Responses(_) => Speaker::Robot(None),
        };
        reference::decode(line, |bytes| reference::alpha1::look(bytes, speaker))
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
