//! The exchanges of an Alpha1 and of its servos (document and servo manual).

use super::frame::{ACT, acknowledgement, header};
use super::{Alpha1, Expect, MAX_FRAME, Outcome, ServoAnswer, ServoId};
use crate::correlation::{Correlation, Effect, InfoOf, RequestInfo, ResponseTiming};
use crate::time::Duration;

/// Commands to a servo, in frames FA AF (servo manual).
pub(super) mod command {
    pub(crate) const MOVE: u8 = 0x01;
    pub(crate) const READ_ANGLES: u8 = 0x02;
    pub(crate) const LED: u8 = 0x04;
    pub(crate) const CHANGE_ID: u8 = 0xCD;
    pub(crate) const SET_OFFSET: u8 = 0xD2;
    pub(crate) const READ_OFFSET: u8 = 0xD4;
    pub(crate) const ALL: &[u8] = &[MOVE, READ_ANGLES, LED, CHANGE_ID, SET_OFFSET, READ_OFFSET];
}

/// Commands to a servo, in frames FC CF.
pub(super) mod version_command {
    pub(crate) const READ: u8 = 0x01;
    pub(crate) const BOOT_LOADER: u8 = 0x02;
    pub(super) const ALL: &[u8] = &[READ, BOOT_LOADER];
}

/// The byte in place of an angle that switches the motor off.
pub(super) const NO_ANGLE: u8 = 0xFF;

/// Maximum time to a servo's answer (servo manual).
const SERVO_TURNAROUND: Duration = Duration::from_micros(400);

/// The key of a response.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Key {
    /// The robot's response in this row of the document, by its first byte.
    Row(u8),
    /// A servo's response in the row FA or FC.
    Servo {
        /// The first byte.
        row: u8,
        /// The servo's id.
        id: u8,
    },
    /// A servo's single byte.
    Acknowledgement {
        /// The servo's id.
        id: u8,
    },
    /// A servo's response to a change of its id. Success comes from the new id. The id in a failure is not documented.
    ChangeId {
        /// The old id.
        from: u8,
        /// The new id.
        to: u8,
    },
}

impl Correlation for Alpha1 {
    type Key = Key;

    fn request(&self, frame: &[u8]) -> Option<InfoOf<Self>> {
        let &[row, _, ref data @ ..] = frame else {
            return None;
        };
        // A missing byte of a short frame does not affect the result.
        let [first, second, third, fourth] = [0, 1, 2, 3].map(|at| data.get(at).copied().unwrap_or(0));
        // The document gives no times. Quick requests use the robot's memory; slow ones wait for its SD card, USB or
        // Bluetooth.
        let (quick, slow) = (Duration::from_millis(100), Duration::from_millis(1_000));
        let robot = |effect, longest, turnaround| RequestInfo {
            key: Key::Row(row),
            expect: Expect::Responses(None),
            response: Some(ResponseTiming { longest, turnaround }),
            effect,
        };
        let servo = |key, answer, effect| RequestInfo {
            key,
            expect: Expect::Responses(answer),
            response: Some(ResponseTiming {
                longest: 10,
                turnaround: SERVO_TURNAROUND,
            }),
            effect,
        };
        let by_id = Key::Servo { row, id: first };
        Some(match (row, second) {
            (header::HARDWARE_VERSION, _) => robot(Effect::Read, MAX_FRAME as u16, quick),
            (header::SERVO_STATES, _) => robot(Effect::Read, 8, quick),
            (header::FIRMWARE_VERSION, _) => robot(Effect::Read, 15, quick),
            (header::STOP, _) => robot(Effect::Setting, 4, quick),
            // A frame of the robot's Bluetooth protocol has the same header.
            (header::ACT, _) if first == ACT => robot(Effect::Motion, 10, quick),
            (header::ACT, _) => robot(Effect::Setting, MAX_FRAME as u16, quick),
            (header::PLAY, _) => robot(Effect::Motion, 4, slow),
            (header::OFFSET_TOOL | header::USB_TYPE, _) => robot(Effect::Setting, 4, slow),
            (header::SERVO, command::MOVE | command::LED) => {
                let effect = match (second, third) {
                    (command::LED, _) => Effect::Setting,
                    (_, NO_ANGLE) => Effect::Torque,
                    _ => Effect::Motion,
                };
                // A request to all servos is not acknowledged.
                let servo = ServoId::new(first).ok();
                RequestInfo {
                    key: Key::Acknowledgement { id: first },
                    expect: Expect::Responses(servo.map(ServoAnswer::Acknowledgement)),
                    response: servo.map(|_| ResponseTiming {
                        longest: 1,
                        turnaround: SERVO_TURNAROUND,
                    }),
                    effect,
                }
            }
            // The servo switches its motor off to answer.
            (header::SERVO, command::READ_ANGLES) => servo(by_id, Some(ServoAnswer::Angles), Effect::Torque),
            (header::SERVO, command::CHANGE_ID) => {
                let key = Key::ChangeId {
                    from: first,
                    to: fourth,
                };
                servo(key, Some(ServoAnswer::IdChanged), Effect::Setting)
            }
            (header::SERVO, command::SET_OFFSET) => servo(by_id, Some(ServoAnswer::OffsetSet), Effect::Setting),
            (header::SERVO, command::READ_OFFSET) => servo(by_id, Some(ServoAnswer::Offset), Effect::Read),
            (header::SERVO_VERSION, version_command::READ) => servo(by_id, Some(ServoAnswer::Version), Effect::Read),
            (header::SERVO | header::SERVO_VERSION, _) => servo(by_id, None, Effect::Setting),
            _ => return None,
        })
    }

    fn is_response_to(&self, key: Key, frame: &[u8]) -> bool {
        const SUCCESS: u8 = Outcome::Success as u8;
        match (key, frame) {
            (Key::Acknowledgement { id }, &[byte]) => {
                ServoId::new(id).is_ok_and(|servo| acknowledgement(servo) == byte)
            }
            (Key::Servo { row, id }, &[first, _, from, ..]) => (first, from) == (row, id) && !self.is_request(frame),
            (Key::ChangeId { from, to }, &[header::SERVO, _, id, status, _, was, ..]) => match status {
                SUCCESS => (id, was) == (to, from),
                _ => (id == from || id == to) && !self.is_request(frame),
            },
            // A request never has the length of a response, except for the hardware version, whose count is never 0 in
            // a response.
            (Key::Row(row), &[first, _, third, ..]) => {
                first == row
                    && match row {
                        header::HARDWARE_VERSION => third > 0,
                        header::SERVO_STATES => frame.len() == 8,
                        header::FIRMWARE_VERSION => frame.len() == 15,
                        header::ACT => third == ACT && frame.len() == 10,
                        header::STOP | header::PLAY | header::OFFSET_TOOL | header::USB_TYPE => frame.len() == 4,
                        _ => false,
                    }
            }
            _ => false,
        }
    }

    /// A robot's request is no frame in the direction of its responses: only those to servos come back whole.
    fn is_request(&self, frame: &[u8]) -> bool {
        match *frame {
            [header::SERVO, _, _, command, ..] => command::ALL.contains(&command),
            [header::SERVO_VERSION, _, _, command, ..] => version_command::ALL.contains(&command),
            _ => false,
        }
    }
}
