//! The protocol of the sensor: `5A JOINT LEN DATA SUM ED`. A request has no data, an answer the angle, low byte first.

use core::fmt;

use armwire::correlation::{Correlation, Effect, InfoOf, RequestInfo, ResponseTiming};
use armwire::framing::{Framing, Reason, Scan, verify, write};
use armwire::messages::Messages;
use armwire::time::Duration;
use armwire::{BufferTooShort, Cause, EncodeError, MessageId, OutOfRange, ParseError};

/// The longest frame, in bytes.
pub const MAX_FRAME: usize = 7;
/// The number of joints, which count from 1.
pub const JOINTS: u8 = 6;
/// The largest angle, in tenths of a degree.
pub const MAX_ANGLE: u16 = 3599;

/// The protocol.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sensor;

/// A request: the angle of a joint, 1 to [`JOINTS`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Read {
    pub joint: u8,
}

/// An answer: the angle of a joint in tenths of a degree, 0 to [`MAX_ANGLE`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Angle {
    pub joint: u8,
    pub tenths: u16,
}

impl fmt::Display for Read {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "read joint {}", self.joint)
    }
}

impl fmt::Display for Angle {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "joint {} at {}.{}°", self.joint, self.tenths / 10, self.tenths % 10)
    }
}

const HEADER: u8 = 0x5A;
const END: u8 = 0xED;

/// The low byte of the sum of all bytes between header and sum.
fn sum(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0, |sum, byte| sum.wrapping_add(*byte))
}

/// Writes a frame.
fn put(out: &mut [u8], joint: u8, data: &[u8]) -> Result<usize, BufferTooShort> {
    let covered = [joint, data.len() as u8].into_iter().chain(data.iter().copied());
    let sum = covered.clone().fold(0, u8::wrapping_add);
    write(out, [HEADER].into_iter().chain(covered).chain([sum, END]))
}

impl Framing for Sensor {
    // No frame ends with a zero.
    const VOID: Option<usize> = Some(MAX_FRAME);
    type Expect = ();

    fn scan(&self, window: &[u8], (): ()) -> Scan {
        match *window {
            [HEADER, _, len @ (0 | 2), ..] => verify(window, 5 + usize::from(len), 1, sum, END),
            [] | [HEADER] | [HEADER, _] => Scan::Need(5 - window.len()),
            _ => Scan::Noise(1, Reason::Stray),
        }
    }

    fn terminator(&self, (): ()) -> Option<u8> {
        Some(END)
    }

    fn shortest(&self, (): ()) -> usize {
        5
    }

    fn requests(&self) {}

    fn unsolicited(&self) {}
}

impl Correlation for Sensor {
    /// The joint.
    type Key = u8;

    fn request(&self, frame: &[u8]) -> Option<InfoOf<Self>> {
        let [_, key, 0, ..] = *frame else { return None };
        let (longest, turnaround) = (MAX_FRAME as u16, Duration::from_millis(2));
        let response = Some(ResponseTiming { longest, turnaround });
        Some(RequestInfo {
            key,
            expect: (),
            response,
            effect: Effect::Read,
        })
    }

    fn is_response_to(&self, joint: u8, frame: &[u8]) -> bool {
        matches!(*frame, [_, of, 2, ..] if of == joint)
    }

    fn is_request(&self, frame: &[u8]) -> bool {
        matches!(frame, [_, _, 0, ..])
    }
}

impl Messages for Sensor {
    type Request<'a> = Read;
    type Response<'a> = Angle;
    type EncodeError = EncodeError;

    fn encode_request(&self, request: &Read, out: &mut [u8]) -> Result<usize, EncodeError> {
        match request.joint {
            joint @ 1..=JOINTS => Ok(put(out, joint, &[])?),
            joint => Err(OutOfRange::new("joint", "", joint.into(), 1, JOINTS.into()).into()),
        }
    }

    fn parse_request(&self, frame: &[u8]) -> Result<Read, ParseError> {
        match *frame {
            [_, joint, 0, ..] => Ok(Read { joint }),
            _ => Err(ParseError::NO_FRAME),
        }
    }

    fn encode_response(&self, angle: &Angle, _: Option<u8>, out: &mut [u8]) -> Result<usize, BufferTooShort> {
        put(out, angle.joint, &angle.tenths.to_le_bytes())
    }

    fn parse_response(&self, frame: &[u8], (): ()) -> Result<Angle, ParseError> {
        let [_, joint, 2, low, high, ..] = *frame else {
            return Err(ParseError::NO_FRAME);
        };
        let tenths = u16::from_le_bytes([low, high]);
        if tenths > MAX_ANGLE {
            let error = OutOfRange::new("angle", "tenths of a degree", tenths.into(), 0, MAX_ANGLE.into());
            let (message, cause) = (MessageId::Command(joint), Cause::Value { offset: 0, error });
            return Err(ParseError { message, cause });
        }
        Ok(Angle { joint, tenths })
    }
}
