//! Arbitrary messages of Ling.

use armwire::ling::{
    Frame, GripperSpeed, Info, JointState, Ling, MAX_DATA, MAX_FRAME, Move, OVERHEAD, Opening, PerServo, Position,
    Request, Response, SELF_CHECK, SelfCheck, SerialNumber, Speed, Stroke, TemperatureLimit, Torque, Version,
};
use armwire::messages::Messages;
use armwire_host_tests::reference::{self, Piece};

use crate::subject::{request_bytes, response_bytes};
use crate::{Result, Said, Subject, Unstructured};

const STROKES: [Stroke; 3] = [Stroke::Mm50, Stroke::Mm75, Stroke::Mm100];

/// Any move that can be said.
pub fn any_move(u: &mut Unstructured<'_>) -> Result<Move> {
    let mut joints = [(Position::CENTRE, Speed::MAX); 6];
    for (position, speed) in &mut joints {
        *position = Position::new(u.int_in_range(0..=Position::MAX.ticks())?).expect("in range");
        *speed = Speed::new(u.int_in_range(0..=Speed::MAX.ticks_per_second())?).expect("in range");
    }
    let opening = Opening::new(u.int_in_range(0..=1000)?).expect("in range");
    let gripper = (opening, GripperSpeed(u.arbitrary()?));
    Ok(Move { joints, gripper })
}

impl Subject for Ling {
    const FILL: Option<u8> = None;

    fn any_request<'a>(u: &mut Unstructured<'a>) -> Result<Request> {
        Ok(match u.int_in_range(0..=11)? {
            0 => Request::ReadJoints,
            1 => Request::ReadInfo,
            2 => Request::SetZero,
            3 => Request::SetStroke(*u.choose(&STROKES)?),
            4 => Request::ReadStroke,
            5 => Request::SetTorque(Torque::Off),
            6 => Request::SetTorque(Torque::On),
            7 => Request::ReadTemperatures,
            8 => Request::SetTemperatureLimit(
                TemperatureLimit::new(*u.choose(&[0, 70, 80, 253, 255])?).expect("in range"),
            ),
            9 => Request::ReadVelocities,
            10 => Request::Move(any_move(u)?),
            _ => Request::SelfCheck,
        })
    }

    fn any_response<'a>(u: &mut Unstructured<'a>) -> Result<Said<'a, Self>> {
        let response = match u.int_in_range(0..=7)? {
            0 => Response::Joints(JointState {
                joints: u.arbitrary()?,
                gripper: u.arbitrary()?,
                status: u.arbitrary::<u8>()?.into(),
            }),
            1 => Response::Info(Info {
                serial: SerialNumber(u.arbitrary()?),
                hardware: Version(u.arbitrary()?),
                firmware: Version(u.arbitrary()?),
            }),
            2 => Response::Stroke(*u.choose(&STROKES)?),
            3 => Response::Temperatures(PerServo::Leader(u.arbitrary()?)),
            4 => Response::Temperatures(PerServo::Follower(u.arbitrary()?)),
            5 => Response::Velocities(PerServo::Leader(u.arbitrary()?)),
            6 => Response::Velocities(PerServo::Follower(u.arbitrary()?)),
            _ => Response::SelfCheck(SelfCheck(u.arbitrary()?)),
        };
        Ok(Said {
            response,
            to: None,
            expect: (),
        })
    }

    fn any_expect(_u: &mut Unstructured<'_>) -> Result<()> {
        Ok(())
    }

    fn any_frame(self, u: &mut Unstructured<'_>, (): ()) -> Result<Vec<u8>> {
        match u.int_in_range(0..=2)? {
            0 => Self::any_request(u).map(|request| request_bytes(self, &request)),
            1 => Self::any_response(u).map(|said| response_bytes(self, &said)),
            _ => {
                let (command, function) = u.arbitrary()?;
                let len = u.int_in_range(0..=MAX_DATA)?;
                let data = u.bytes(len.min(u.len()))?;
                let mut out = vec![0; data.len() + OVERHEAD];
                let frame = Frame {
                    command,
                    function,
                    data,
                };
                frame.encode(&mut out).expect("it is not too long");
                Ok(out)
            }
        }
    }

    fn reference(line: &[u8], (): ()) -> Vec<Piece> {
        reference::decode(line, reference::ling::look)
    }

    fn rewrite(bytes: &[u8]) -> Vec<u8> {
        let frame = Frame::parse(bytes).expect("it is a frame");
        assert_eq!(frame.data.len() + OVERHEAD, bytes.len());
        // One frame is not written as all others: its length field is 0.
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
