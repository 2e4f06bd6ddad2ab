//! Servos on one wire.

use armwire::alpha1::{Alpha1, MAX_FRAME, Response, ServoId, ServoRequest};
use armwire::messages::Messages;
use armwire::time::Instant;

use super::servo::Servo;

#[derive(Debug)]
pub(super) struct Chain(Vec<Servo>);

impl Chain {
    /// Creates released servos with these ids.
    pub(super) fn new(ids: impl IntoIterator<Item = ServoId>) -> Self {
        Self(ids.into_iter().map(Servo::new).collect())
    }

    pub(super) fn servos(&self) -> &[Servo] {
        &self.0
    }

    pub(super) fn servos_mut(&mut self) -> &mut [Servo] {
        &mut self.0
    }

    /// Executes a request in every addressed servo. Returns the bytes on the wire, if any servo answers.
    ///
    /// Two servos with the same id answer at the same time. A low bit of either pulls the wire low, so the result is
    /// the AND of both answers.
    pub(super) fn execute(&mut self, now: Instant, request: &ServoRequest) -> Option<Vec<u8>> {
        let answers = self.0.iter_mut().filter_map(|servo| servo.execute(now, request));
        answers.map(|answer| encode(&Response::Servo(answer))).reduce(and)
    }
}

/// Combines two simultaneous answers.
fn and(mut wire: Vec<u8>, other: Vec<u8>) -> Vec<u8> {
    wire.iter_mut().zip(other).for_each(|(wire, other)| *wire &= other);
    wire
}

/// Encodes a response.
pub(super) fn encode(response: &Response<'_>) -> Vec<u8> {
    let mut out = [0; MAX_FRAME];
    let len = Alpha1
        .encode_response(response, None, &mut out)
        .expect("every response fits the longest frame");
    out[..len].to_vec()
}
