//! Servos on one wire.

use armwire::alpha1::{Alpha1, MAX_FRAME, Request, Response, ServoId, ServoRequest};
use armwire::{Micros, Protocol};

use super::port::Counters;
use super::servo::Servo;

/// The version that a servo tells, as in the manual's example.
const VERSION: [u8; 4] = [0x41, 0x16, 0x51, 0x01];

#[derive(Debug)]
pub(super) struct Chain(Vec<Servo>);

impl Chain {
    /// Released servos with these ids, in the middle of the range of an Alpha1.
    pub(super) fn new(ids: impl IntoIterator<Item = ServoId>) -> Self {
        Self(ids.into_iter().map(|id| Servo::new(id, VERSION, 90)).collect())
    }

    pub(super) fn servos(&self) -> &[Servo] {
        &self.0
    }

    pub(super) fn servos_mut(&mut self) -> &mut [Servo] {
        &mut self.0
    }

    /// Lets every servo that is meant obey, and returns what is then on the wire.
    ///
    /// Two servos with one id answer at once, and the wire is low whenever one of them pulls it low: what arrives is what
    /// both say, bit by bit.
    pub(super) fn obey(&mut self, now: Micros, request: &ServoRequest, counters: &mut Counters) -> Option<Vec<u8>> {
        let answers = self.0.iter_mut().filter_map(|servo| servo.obey(now, request));
        let wire = answers.map(|answer| encode(&Response::Servo(answer))).reduce(and);
        let wanted = Alpha1::reply(&Request::Servo(*request)).is_some();
        counters.refused += u64::from(wanted && wire.is_none());
        wire
    }
}

/// Two answers at once.
fn and(mut wire: Vec<u8>, other: Vec<u8>) -> Vec<u8> {
    wire.iter_mut().zip(other).for_each(|(wire, other)| *wire &= other);
    wire
}

/// The bytes of a response.
pub(super) fn encode(response: &Response) -> Vec<u8> {
    let mut out = [0; MAX_FRAME];
    // Every response fits.
    let len = Alpha1::encode_response(response, &mut out).unwrap_or(0);
    out[..len].to_vec()
}
