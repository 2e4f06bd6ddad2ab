//! An xArm's line whose frames have one mark, or none, in both directions: their numbers tell them apart.

use std::collections::VecDeque;

use armwire::correlation::Correlation;
use armwire::messages::Messages;
use armwire::xarm::{Direction, Key, Response, State, XArm};

use super::meaning::{Meaning, Sender, meaning};
use super::recording::Reading;
use crate::args::Speaker;

/// Maximum number of requests that wait for their answers.
const MAX_REQUESTS: usize = 16;

/// A reading of the line, whose first frame is the host's. An answer has the number and the register of its request, and
/// a state. Nothing else tells both apart: an answer without parameters may be equal to its request.
#[derive(Default)]
pub(super) struct XArmLine {
    /// The requests without an answer.
    requests: VecDeque<(Key, Vec<u8>)>,
    /// The last request that has one.
    answered: Option<Key>,
    /// An answer differs from its request: both directions are there.
    has_answers: bool,
    /// Number of frames that may be the other sender's.
    uncertain: u64,
    /// The answers have a mark of their own.
    is_marked: bool,
}

impl Reading for XArmLine {
    type Arm = XArm;

    fn expect(&self) -> Direction {
        Direction::Requests
    }

    fn from(&self) -> Option<Speaker> {
        Some(Speaker::Host)
    }

    fn meaning(&mut self, frame: &[u8]) -> Meaning {
        if self.is_marked {
            return self.request(frame);
        }
        let answers = |(key, _): &(Key, Vec<u8>)| XArm::PRIVATE.is_response_to(*key, frame);
        if let Some(at) = self.requests.iter().position(answers)
            && may_be_answer(frame)
            && let Some((key, request)) = self.requests.remove(at)
        {
            self.answered = Some(key);
            self.has_answers |= request != frame;
            if self.has_answers {
                return meaning(&XArm::PRIVATE, frame, Direction::Responses, Sender::Known(Speaker::Arm));
            }
            return self.uncertain(frame);
        }
        if self
            .answered
            .is_some_and(|key| XArm::PRIVATE.is_response_to(key, frame))
            && may_be_answer(frame)
        {
            return self.uncertain(frame);
        }
        if let Some(info) = XArm::PRIVATE.request(frame).filter(|info| info.response.is_some()) {
            self.requests.push_back((info.key, frame.to_vec()));
        }
        if self.requests.len() > MAX_REQUESTS
            && let Some((_, request)) = self.requests.pop_front()
        {
            self.uncertain += u64::from(self.has_answers && may_be_answer(&request));
        }
        self.request(frame)
    }

    fn uncertain(&self) -> u64 {
        let answers = self.requests.iter().filter(|(_, request)| may_be_answer(request));
        self.uncertain + if self.has_answers { answers.count() as u64 } else { 0 }
    }

    fn trust_mark(&mut self) {
        self.is_marked = !self.has_answers;
    }
}

impl XArmLine {
    fn request(&self, frame: &[u8]) -> Meaning {
        meaning(&XArm::PRIVATE, frame, self.expect(), Sender::Marked(Speaker::Host))
    }

    /// The meaning of a request that may be an answer.
    fn uncertain(&mut self, frame: &[u8]) -> Meaning {
        self.uncertain += 1;
        let request = self.request(frame);
        let text = format!("{}, or an answer", request.text);
        Meaning { text, ..request }
    }
}

/// Returns true if a frame is an answer by its content. Only some bits of a state have a meaning.
fn may_be_answer(frame: &[u8]) -> bool {
    let known = State::INVALID | State::NOT_READY | State::WARNING | State::ERROR;
    match XArm::PRIVATE.parse_response(frame, Direction::Responses) {
        Ok(Response::Reply { state, .. }) => state.0 & !known.0 == 0,
        Ok(_) => true,
        Err(_) => false,
    }
}
