//! Frames in bytes.

use std::fmt::Debug;

use armwire::ling::{GripperSpeed, JOINTS, Ling, Move, Opening, Position, Request, Speed};
use armwire::messages::Messages;
use armwire_bridge::control::MAX_FRAME;

/// The frame that `encode` writes into a buffer for the longest frame of any arm.
///
/// # Panics
///
/// If it fails.
pub fn encoded<E: Debug>(encode: impl FnOnce(&mut [u8]) -> Result<usize, E>) -> Vec<u8> {
    let mut bytes = vec![0; MAX_FRAME];
    let len = encode(&mut bytes).expect("a valid frame");
    bytes.truncate(len);
    bytes
}

/// The frame of a request to a Ling arm.
pub fn frame(request: Request) -> Vec<u8> {
    encoded(|bytes| Ling.encode_request(&request, bytes))
}

/// A move of all joints to the centre, with the gripper closed.
pub fn motion() -> Vec<u8> {
    frame(Request::Move(Move {
        joints: [(Position::CENTRE, Speed::MAX); JOINTS],
        gripper: (Opening::CLOSED, GripperSpeed(1_000)),
    }))
}
