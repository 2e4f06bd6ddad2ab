//! The exchanges of a Ling arm (document section 2).

use super::frame::{ERROR, NO_VALUE};
use super::{Ling, MAX_FRAME};
use crate::correlation::{Correlation, Effect, InfoOf, RequestInfo, ResponseTiming};
use crate::time::Duration;

/// The longest known response on the wire: information, 24 data bytes.
const LONGEST: u16 = 30;

/// The self-check command.
const SELF_CHECK: u8 = 0xFE;

/// The key of a response: the bytes in common with its request.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Key {
    /// Command (section 1.1).
    pub command: u8,
    /// Function within the command.
    pub function: u8,
}

impl Correlation for Ling {
    type Key = Key;

    /// No document says so. An answer out of order is counted: see [`out_of_order`](crate::exchange::Exchange::out_of_order).
    fn keeps_order(&self) -> bool {
        true
    }

    fn request(&self, frame: &[u8]) -> Option<InfoOf<Self>> {
        let &[_, command, function, _, data, ..] = frame else {
            return None;
        };
        let (effect, longest) = match (command, function, data) {
            (0x01, 0x00, _) | (0x04, 0x0E, _) | (0x06, 0x00 | 0x02, _) => (Effect::Read, Some(LONGEST)),
            (0x06, 0x01, NO_VALUE) | (SELF_CHECK, 0x00, _) => (Effect::Read, Some(LONGEST)),
            (0x06, 0x03, _) => (Effect::Motion, None),
            (0x05, 0x00, _) => (Effect::Torque, None),
            // The motors may push the joints.
            (0x05, 0x01, 1) | (0x06, 0x20, 1) => (Effect::Motion, Some(MAX_FRAME as u16)),
            // In position mode again, the torque stays off.
            (0x05, 0x01, _) => (Effect::Torque, Some(MAX_FRAME as u16)),
            (0x06, 0x20, 0) => (Effect::Torque, Some(MAX_FRAME as u16)),
            (0x06, 0x20 | 0x24, NO_VALUE) => (Effect::Read, Some(MAX_FRAME as u16)),
            // Setting the zero position switches the torque off, too.
            (0x03, 0x00, _) | (0x04, _, _) | (0x06, 0x01, _) => (Effect::Setting, None),
            // A newer arm may answer it.
            _ => (Effect::Setting, Some(MAX_FRAME as u16)),
        };
        // The document gives no times. The vendor's software repeats a request after 200 ms. A self-check may query
        // each servo in turn.
        let turnaround = match command {
            SELF_CHECK => Duration::from_millis(500),
            _ => Duration::from_millis(50),
        };
        Some(RequestInfo {
            key: Key { command, function },
            expect: (),
            response: longest.map(|longest| ResponseTiming { longest, turnaround }),
            effect,
        })
    }

    /// An error frame is a response to every request, because it names none.
    fn is_response_to(&self, key: Key, frame: &[u8]) -> bool {
        let &[_, command, function, len, data, ..] = frame else {
            return false;
        };
        command == ERROR || (Key { command, function }) == key && !is_request(key, len, data)
    }

    fn is_request(&self, frame: &[u8]) -> bool {
        match *frame {
            [_, command, function, len, data, ..] => is_request(Key { command, function }, len, data),
            _ => false,
        }
    }
}

/// Returns true if a frame with this length byte and first data byte is a request. Requests have one data byte, which is
/// FE unless it sets a value.
fn is_request(key: Key, len: u8, data: u8) -> bool {
    match (key.command, key.function, len) {
        (ERROR, _, _) => false,
        (SELF_CHECK, 0x00, 0) | (0x05, 0x00, _) | (0x05, _, 1) | (0x06, 0x01 | 0x20, 1) | (0x06, 0x03, _) => true,
        (_, _, 1) => data == NO_VALUE,
        _ => false,
    }
}
