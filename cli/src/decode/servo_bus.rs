//! The servo bus of an Alpha1: requests and answers on one wire, told apart by their order and content.

use armwire::alpha1::{Alpha1, Expect, Key, Outcome, ServoAnswer};
use armwire::correlation::Correlation;

use super::meaning::{Meaning, Sender, meaning};
use super::recording::Reading;
use crate::args::Speaker;

/// The rows of servos, by the first byte of a frame.
const SERVO: u8 = 0xFA;
const SERVO_VERSION: u8 = 0xFC;
/// The statuses of an answer: no command to a servo has these values.
const OUTCOMES: [u8; 2] = [Outcome::Success as u8, Outcome::Failure as u8];

/// A reading of the bus. A servo does not repeat its request: the last request determines what an answer means.
#[derive(Default)]
pub(super) struct ServoBus {
    /// Key and expected answer of the last request.
    request: Option<(Key, ServoAnswer)>,
}

impl Reading for ServoBus {
    type Arm = Alpha1;

    fn expect(&self) -> Expect {
        Expect::Responses(self.request.map(|(_, answer)| answer))
    }

    fn from(&self) -> Option<Speaker> {
        None
    }

    fn meaning(&mut self, frame: &[u8]) -> Meaning {
        match *frame {
            // It is acknowledged once.
            [_] => {
                let acknowledged = meaning(&Alpha1, frame, self.expect(), Sender::Known(Speaker::Arm));
                self.request = None;
                acknowledged
            }
            [SERVO | SERVO_VERSION, _, _, status, ..] if OUTCOMES.contains(&status) => self.answer(frame),
            [SERVO | SERVO_VERSION, ..] => {
                self.request = Alpha1.request(frame).and_then(|info| match info.expect {
                    Expect::Responses(answer) => Some((info.key, answer?)),
                    Expect::Requests => None,
                });
                meaning(&Alpha1, frame, Expect::Requests, Sender::Known(Speaker::Host))
            }
            _ => meaning(&Alpha1, frame, Expect::Responses(None), Sender::Known(Speaker::Arm)),
        }
    }
}

impl ServoBus {
    /// The meaning of a servo's answer in a frame.
    fn answer(&self, frame: &[u8]) -> Meaning {
        let is_expected = self.request.is_some_and(|(key, _)| Alpha1.is_response_to(key, frame));
        // The frame of a version names itself.
        if is_expected || frame.first() == Some(&SERVO_VERSION) {
            return meaning(&Alpha1, frame, self.expect(), Sender::Known(Speaker::Arm));
        }
        let id = frame.get(2).copied().unwrap_or_default();
        let reason = format!("an answer of servo {id}, ambiguous: its request is not before it");
        Meaning::unknown(Some(Speaker::Arm), reason)
    }
}
