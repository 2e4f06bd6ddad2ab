//! An arm on a line, for tests.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use armwire::ling::{JointState, Ling, MAX_FRAME, MotionStatus, PerServo, Request, Response, Stroke};
use armwire::messages::Messages;

use crate::error::Error;
use crate::error::text::Text;
use crate::ports::line::{Line, Names, Reception};

/// An arm's answer with all joints at this position.
pub(super) fn joints(ticks: u16) -> Vec<u8> {
    let response = Response::Joints(JointState {
        joints: [ticks; 6],
        gripper: 0,
        status: MotionStatus::Idle,
    });
    let mut out = [0; MAX_FRAME];
    let n = Ling.encode_response(&response, None, &mut out).unwrap();
    out[..n].to_vec()
}

/// The arm's answer to a fence.
pub(super) fn fence_answer(request: &Request) -> Option<Vec<u8>> {
    let response = match request {
        Request::ReadStroke => Response::Stroke(Stroke::Mm50),
        Request::ReadTemperatures => Response::Temperatures(PerServo::Leader([30; 6])),
        Request::ReadVelocities => Response::Velocities(PerServo::Leader([0; 6])),
        _ => return None,
    };
    let mut out = [0; MAX_FRAME];
    let n = Ling.encode_response(&response, None, &mut out).unwrap();
    Some(out[..n].to_vec())
}

/// An arm that gives each request an answer, by how many there were. It answers fences, and does not count them.
pub(super) struct Answering {
    answer: fn(u16) -> Vec<u8>,
    pub(super) answers: VecDeque<Vec<u8>>,
    pub(super) requests: u16,
    pub(super) answers_fences: bool,
}

impl Answering {
    pub(super) fn new(answer: fn(u16) -> Vec<u8>) -> Arc<Mutex<Self>> {
        Arc::new(Mutex::new(Self {
            answer,
            answers: VecDeque::new(),
            requests: 0,
            answers_fences: true,
        }))
    }
}

impl Line for Arc<Mutex<Answering>> {
    fn name(&self) -> &str {
        "fake"
    }

    fn read(&mut self, buf: &mut [u8], _: Duration) -> Result<usize, Error> {
        let answer = self.lock().unwrap().answers.pop_front().unwrap_or_default();
        buf[..answer.len()].copy_from_slice(&answer);
        Ok(answer.len())
    }

    fn write(&mut self, bytes: &[u8]) -> Result<usize, Error> {
        let arm = &mut *self.lock().unwrap();
        let request = Ling.parse_request(bytes).ok().filter(|_| arm.answers_fences);
        let fence = request.and_then(|request| fence_answer(&request));
        let answer = fence.unwrap_or_else(|| {
            arm.requests += 1;
            (arm.answer)(arm.requests)
        });
        arm.answers.push_back(answer);
        Ok(bytes.len())
    }

    fn hint(&self, _: Reception, _: Names) -> Text {
        unreachable!("it answers")
    }
}
