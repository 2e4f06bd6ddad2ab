//! The exchanges of an xArm.

use super::frame::{HEARTBEAT_ID, MODBUS_ID};
use super::{Direction, Frame, MAX_FRAME, ModbusFunction, XArm};
use crate::correlation::{Correlation, Effect, InfoOf, RequestInfo, ResponseTiming};
use crate::time::Duration;

/// The key of a response: the values that identify its request.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Key {
    /// Transaction id. A client counts `1..=65535`; an arm echoes any value, including 0.
    pub transaction: u16,
    /// Protocol id, `0..=3`.
    pub protocol: u16,
    /// The register; in standard Modbus the function.
    pub register: u8,
}

impl Key {
    /// The key of the request in this frame.
    fn of_request(frame: Frame<'_>) -> Option<Self> {
        let register = match (frame.protocol, frame.body) {
            (MODBUS_ID, [_unit, function, ..]) => *function,
            (_, [register, ..]) => *register,
            _ => return None,
        };
        Some(Self {
            transaction: frame.transaction,
            protocol: frame.protocol,
            register,
        })
    }
}

impl Correlation for XArm {
    const HAS_TRANSACTION_ID: bool = true;
    type Key = Key;

    fn request(&self, frame: &[u8]) -> Option<InfoOf<Self>> {
        let frame = Frame::parse(frame)?;
        let key = Key::of_request(frame)?;
        // The document gives no times. The vendor's package waits 2 s for a read or a setting, and 10 s for a move.
        let (quick, slow) = (Duration::from_millis(2_000), Duration::from_millis(10_000));
        let (effect, turnaround) = match (frame.protocol, key.register) {
            (HEARTBEAT_ID, _) => (Effect::Setting, None),
            (MODBUS_ID, _) => (Effect::Setting, Some(quick)),
            (_, 1 | 2 | 5 | 6) => (Effect::Read, Some(quick)),
            (_, 4 | 10) => (Effect::Setting, Some(quick)),
            _ => (Effect::Setting, Some(slow)),
        };
        Some(RequestInfo {
            key,
            expect: Direction::Responses,
            response: turnaround.map(|turnaround| ResponseTiming {
                longest: MAX_FRAME as u16,
                turnaround,
            }),
            effect,
        })
    }

    fn is_response_to(&self, key: Key, frame: &[u8]) -> bool {
        let Some(frame) = Frame::parse(frame) else {
            return false;
        };
        (frame.transaction, frame.protocol) == (key.transaction, key.protocol)
            && match frame.body {
                [_unit, function, ..] if key.protocol == MODBUS_ID => {
                    ModbusFunction::of_byte(*function).number() == key.register
                }
                [register, ..] => key.protocol != HEARTBEAT_ID && *register == key.register,
                [] => false,
            }
    }

    fn stamp(&self, frame: &mut [u8], number: u16) {
        // A heartbeat has no number.
        if let Some((id, [0, protocol, ..])) = frame.split_first_chunk_mut()
            && u16::from(*protocol) != HEARTBEAT_ID
        {
            *id = number.to_be_bytes();
        }
    }
}
