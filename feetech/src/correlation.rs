//! The answers of requests.

use armwire::correlation::{Correlation, Effect, InfoOf, RequestInfo, ResponseTiming};
use armwire::time::Duration;

use crate::frame::code;
use crate::{BROADCAST, Expect, Feetech, MAX_ID, register};

/// The longest time of a servo for a request, besides its return delay. A guess.
const TURNAROUND: Duration = Duration::from_micros(100);

/// The key of an answer, which has neither its instruction nor its address.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Key {
    /// The servo.
    pub id: u8,
    /// The number of bytes that it was asked for.
    pub len: u8,
}

impl Feetech {
    /// The properties of a request to a servo that is the `nth` to answer, from 1, if it does.
    fn info(&self, key: Key, nth: u16, effect: Effect, is_answered: bool) -> InfoOf<Self> {
        let longest = (u16::from(key.len) + 6).saturating_mul(nth);
        let each = (self.return_delay + TURNAROUND).as_micros();
        let turnaround = Duration::from_micros(each.saturating_mul(nth.into()));
        RequestInfo {
            key,
            expect: Expect::Responses,
            response: is_answered.then_some(ResponseTiming { longest, turnaround }),
            effect,
        }
    }

    /// The properties of a read that is the `nth` answer.
    fn read(&self, key: Key, nth: u16) -> InfoOf<Self> {
        self.info(key, nth, Effect::Read, key.id <= MAX_ID)
    }

    /// The answers of a request, in their order: several to SYNC_READ, else at most one. A PING of [`BROADCAST`] has an
    /// unknown number of them, and counts as one.
    pub fn answers(&self, frame: &[u8]) -> impl Iterator<Item = InfoOf<Self>> {
        let (len, ids) = match *frame {
            [_, _, _, _, code::SYNC_READ, _, len, ref ids @ .., _] => (len, ids),
            _ => (0, &[][..]),
        };
        let reads = (1..).zip(ids).map(move |(nth, &id)| self.read(Key { id, len }, nth));
        let single = self.request(frame).filter(|_| ids.is_empty());
        let answers = single.into_iter().chain(reads);
        answers.filter(|info| info.response.is_some())
    }
}

/// The effect of a write. A write of a goal moves a servo, and switches its torque on.
fn effect(address: u8, data: &[u8]) -> Effect {
    let end = usize::from(address).saturating_add(data.len());
    let writes = |first: u8, behind: u8| address < behind && end > first.into();
    match data {
        _ if writes(register::GOAL_POSITION.address, register::TORQUE_LIMIT.address) => Effect::Motion,
        // It sets the offset.
        [128, ..] if address == register::TORQUE.address => Effect::Setting,
        _ if writes(register::TORQUE.address, register::ACCELERATION.address) => Effect::Torque,
        _ => Effect::Setting,
    }
}

impl Correlation for Feetech {
    type Key = Key;

    fn request(&self, frame: &[u8]) -> Option<InfoOf<Self>> {
        let [_, _, id, _, code, ref data @ .., _] = *frame else {
            return None;
        };
        let is_answered = self.acknowledges && id != BROADCAST && code != code::REBOOT;
        let change = |effect| self.info(Key { id, len: 0 }, 1, effect, is_answered);
        Some(match (code, data) {
            // The key matches no answer to a PING of all servos: each is of another id.
            (code::PING, _) => self.info(Key { id, len: 0 }, 1, Effect::Read, true),
            (code::READ, &[_, len]) => self.read(Key { id, len }, 1),
            (code::SYNC_READ, &[_, len, id, ..]) => self.read(Key { id, len }, 1),
            // That of the first servo: behind its data are ids.
            (code::SYNC_WRITE, &[address, len, _, ref data @ ..]) => {
                change(effect(address, data.get(..len.into()).unwrap_or(data)))
            }
            (code::WRITE, &[address, ref data @ ..]) => change(effect(address, data)),
            (code::ACTION, _) => change(Effect::Motion),
            (code::REBOOT, _) => change(Effect::Torque),
            _ => change(Effect::Setting),
        })
    }

    // A request can match: a ping is the answer of a servo with a voltage error.
    fn is_response_to(&self, key: Key, frame: &[u8]) -> bool {
        matches!(*frame, [_, _, id, len, ..] if id == key.id && u16::from(len) == u16::from(key.len) + 2)
    }

    fn echoes(&self) -> bool {
        self.echoes
    }
}
