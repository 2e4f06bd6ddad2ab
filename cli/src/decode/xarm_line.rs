//! An xArm's line whose frames have one mark, or none, in both directions: their numbers tell them apart.

use std::collections::VecDeque;

use armwire::correlation::Correlation;
use armwire::messages::Messages;
use armwire::xarm::{Direction, Key, Response, State, XArm};

use super::meaning::{Meaning, Sender, meaning};
use super::recording::Reading;
use crate::args::Speaker;

/// Maximum number of frames that wait for another one with their number.
const MAX_WAITING: usize = 8;

/// A reading of the line. An answer has the number and the register of its request, and a state. Nothing else tells
/// both apart: an answer without parameters may be equal to its request.
pub(super) struct XArmLine {
    /// The sender of the first frame, and of each with a new number.
    from: Speaker,
    /// The frames of that sender without another one.
    waiting: VecDeque<(Key, Vec<u8>)>,
    /// The last request that has an answer.
    answered: Option<Key>,
    /// An answer differs from its request: both directions are there.
    has_answers: bool,
    /// Number of frames that may be the other sender's.
    uncertain: u64,
    /// The other direction has a mark of its own.
    is_marked: bool,
}

impl XArmLine {
    pub(super) fn new(from: Speaker) -> Self {
        Self {
            from,
            waiting: VecDeque::new(),
            answered: None,
            has_answers: false,
            uncertain: 0,
            is_marked: false,
        }
    }

    /// The meaning of a frame of the first one's sender.
    fn own(&self, frame: &[u8]) -> Meaning {
        meaning(&XArm::PRIVATE, frame, self.expect(), Sender::Marked(self.from))
    }

    /// The meaning of such a frame that may be the other sender's.
    fn uncertain(&mut self, frame: &[u8]) -> Meaning {
        self.uncertain += 1;
        let own = self.own(frame);
        let text = format!("{}; its direction is uncertain", own.text);
        Meaning { text, ..own }
    }
}

impl Reading for XArmLine {
    type Arm = XArm;

    fn expect(&self) -> Direction {
        match self.from {
            Speaker::Host => Direction::Requests,
            Speaker::Arm => Direction::Responses,
        }
    }

    fn from(&self) -> Option<Speaker> {
        Some(self.from)
    }

    fn meaning(&mut self, frame: &[u8]) -> Meaning {
        if self.is_marked {
            return self.own(frame);
        }
        let answers = |(key, _): &(Key, Vec<u8>)| XArm::PRIVATE.is_response_to(*key, frame);
        if let Some(at) = self.waiting.iter().position(answers)
            && may_be_answer(frame)
            && let Some((key, request)) = self.waiting.remove(at)
        {
            self.answered = Some(key);
            self.has_answers |= self.from == Speaker::Host && request != frame;
            if self.has_answers {
                // The line keeps the order: the requests before this one have no answer any more.
                for (_, older) in self.waiting.drain(..at) {
                    self.uncertain += u64::from(may_be_answer(&older));
                }
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
            self.waiting.push_back((info.key, frame.to_vec()));
        }
        if self.waiting.len() > MAX_WAITING
            && let Some((_, request)) = self.waiting.pop_front()
        {
            self.uncertain += u64::from(self.has_answers && may_be_answer(&request));
        }
        self.own(frame)
    }

    fn uncertain(&self) -> u64 {
        let answers = self.waiting.iter().filter(|(_, request)| may_be_answer(request));
        self.uncertain + if self.has_answers { answers.count() as u64 } else { 0 }
    }

    fn trust_mark(&mut self) {
        self.is_marked = !self.has_answers;
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
