//! Arbitrary messages of Ling's older generation.

use armwire::ling::legacy::{
    Firmware, Frame, GripperState, JointState, Legacy, MAX_DATA, OVERHEAD, Request, Response, parity,
};
use armwire::{BufferTooShort, EncodeError};
use armwire_host_tests::reference::{self, Piece};

use crate::subject::response_bytes;
use crate::{Result, Subject, Unstructured};

impl Subject for Legacy {
    const HAS_REQUESTS: bool = false;
    const FILL: Option<u8> = None;

    fn any_request(_u: &mut Unstructured<'_>) -> Result<Request> {
        Err(arbitrary::Error::IncorrectFormat)
    }

    fn any_response(u: &mut Unstructured<'_>) -> Result<(Response, ())> {
        let firmware = *u.choose(&[Firmware::V5, Firmware::V6_0])?;
        let response = match u.arbitrary()? {
            true => Response::Joints(JointState {
                firmware,
                servos: u.arbitrary()?,
            }),
            false => Response::Gripper(GripperState {
                firmware,
                id: u.arbitrary()?,
                servo: u.arbitrary()?,
                potentiometer: u.arbitrary()?,
                sync_button: u.arbitrary()?,
                attitude_button: u.arbitrary()?,
            }),
        };
        Ok((response, ()))
    }

    fn any_expect(_u: &mut Unstructured<'_>) -> Result<()> {
        Ok(())
    }

    fn any_frame(u: &mut Unstructured<'_>, (): ()) -> Result<Vec<u8>> {
        if u.arbitrary()? {
            return Self::any_response(u).map(|(response, ())| response_bytes::<Self>(&response));
        }
        let command = u.arbitrary()?;
        let len = u.int_in_range(0..=MAX_DATA)?;
        let data = u.bytes(len.min(u.len()))?;
        Ok(written(command, data))
    }

    fn reference(line: &[u8], (): ()) -> Vec<Piece> {
        reference::decode(line, reference::legacy::look)
    }

    fn wire_len(frame: Frame<'_>) -> usize {
        frame.data.len() + OVERHEAD
    }

    /// The crate never writes one that is no message, so this does.
    fn encode_frame(frame: Frame<'_>, (): (), out: &mut [u8]) -> Result<usize, EncodeError> {
        let bytes = written(frame.command, frame.data);
        let (needed, got) = (bytes.len(), out.len());
        let too_short = EncodeError::BufferTooShort(BufferTooShort { needed, got });
        out.get_mut(..needed).ok_or(too_short)?.copy_from_slice(&bytes);
        Ok(needed)
    }
}

fn written(command: u8, data: &[u8]) -> Vec<u8> {
    [&[0xAA, command, data.len() as u8], data, &[parity(data), 0xFF]].concat()
}
