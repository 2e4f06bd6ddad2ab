//! The line of an arm, for tests.

use std::mem;
use std::time::Duration;

use armwire::ling::{JOINTS, JointState, Ling, MAX_FRAME, MotionStatus, PerServo, Request, Response, Stroke};
use armwire::messages::Messages;
use armwire::{Device, DeviceEvent};

use crate::error::Error;
use crate::error::text::Text;
use crate::ports::line::{Line, Names, Reception};

/// A line that passes each write, of whole requests, to a function. The bytes that it returns are the next to be read.
pub(super) struct FakeLine<F> {
    answer: F,
    arm: Device<Ling, MAX_FRAME>,
    answers: Vec<u8>,
}

impl<F: FnMut(&[u8]) -> Result<Vec<u8>, Error> + Send + 'static> FakeLine<F> {
    pub(super) fn boxed(answer: F) -> Box<dyn Line> {
        Box::new(Self {
            answer,
            arm: Device::new(Ling),
            answers: Vec::new(),
        })
    }
}

impl<F: FnMut(&[u8]) -> Result<Vec<u8>, Error> + Send> Line for FakeLine<F> {
    fn name(&self) -> &str {
        "fake"
    }

    fn read(&mut self, buf: &mut [u8], _: Duration) -> Result<usize, Error> {
        let answers = mem::take(&mut self.answers);
        buf[..answers.len()].copy_from_slice(&answers);
        Ok(answers.len())
    }

    fn write(&mut self, bytes: &[u8]) -> Result<usize, Error> {
        self.answers.extend((self.answer)(bytes)?);
        assert!(self.arm.receive(bytes).is_empty());
        // The rest of a frame is noise then.
        self.arm.idle();
        while let Some(event) = self.arm.poll() {
            assert!(matches!(event, DeviceEvent::Request { .. }), "{event:?}");
        }
        Ok(bytes.len())
    }

    fn hint(&self, _: Reception, _: Names) -> Text {
        Text::default()
    }
}

/// The answer of an arm that holds its pose. Empty for requests that are not read.
pub(super) fn holding(request: &[u8]) -> Vec<u8> {
    let response = match Ling.parse_request(request) {
        Ok(Request::ReadJoints) => Response::Joints(JointState {
            joints: [2048; JOINTS],
            gripper: 500,
            status: MotionStatus::Locked,
        }),
        // Fences.
        Ok(Request::ReadStroke) => Response::Stroke(Stroke::Mm50),
        Ok(Request::ReadTemperatures) => Response::Temperatures(PerServo::Follower([30; 10])),
        Ok(Request::ReadVelocities) => Response::Velocities(PerServo::Follower([0; 10])),
        _ => return Vec::new(),
    };
    frame(&response)
}

/// The frame of a response.
pub(super) fn frame(response: &Response) -> Vec<u8> {
    let mut out = [0; MAX_FRAME];
    let n = Ling.encode_response(response, None, &mut out).unwrap();
    out[..n].to_vec()
}
