//! Servos on one wire.

use armwire::alpha1::{Alpha1, MAX_FRAME, Response, ServoId, ServoRequest};
use armwire::messages::Messages;
use armwire::time::Instant;

use super::servo::Servo;

#[derive(Debug)]
pub(super) struct Chain(Vec<Servo>);

impl Chain {
    /// Released servos with these ids.
    pub(super) fn new(ids: impl IntoIterator<Item = ServoId>) -> Self {
        Self(ids.into_iter().map(Servo::new).collect())
    }

    pub(super) fn servos(&self) -> &[Servo] {
        &self.0
    }

    pub(super) fn servos_mut(&mut self) -> &mut [Servo] {
        &mut self.0
    }

    /// Lets every servo that is meant obey, and returns what is then on the wire, if anything is.
    ///
    /// Two servos with one id answer at once, and the wire is low whenever one of them pulls it low: what arrives is
    /// what both say, bit by bit.
    pub(super) fn obey(&mut self, now: Instant, request: &ServoRequest) -> Option<Vec<u8>> {
        let answers = self.0.iter_mut().filter_map(|servo| servo.obey(now, request));
        answers.map(|answer| encode(&Response::Servo(answer))).reduce(and)
    }
}

/// Two answers at once.
fn and(mut wire: Vec<u8>, other: Vec<u8>) -> Vec<u8> {
    wire.iter_mut().zip(other).for_each(|(wire, other)| *wire &= other);
    wire
}

/// The bytes of a response.
pub(super) fn encode(response: &Response<'_>) -> Vec<u8> {
    let mut out = [0; MAX_FRAME];
    let len = Alpha1
        .encode_response(response, None, &mut out)
        .expect("every response fits the longest frame");
    out[..len].to_vec()
}
