//! Requests to a Ling arm, in bytes.

use armwire::ling::{GripperSpeed, JOINTS, Ling, MAX_FRAME, Move, Opening, Position, Request, Speed};
use armwire::messages::Messages;

/// The frame of a request.
pub fn frame(request: Request) -> Vec<u8> {
    let mut bytes = [0; MAX_FRAME];
    let len = Ling
        .encode_request(&request, &mut bytes)
        .expect("every request has room in MAX_FRAME bytes");
    bytes[..len].to_vec()
}

/// A move of all joints to the centre, with the gripper closed.
pub fn motion() -> Vec<u8> {
    frame(Request::Move(Move {
        joints: [(Position::CENTRE, Speed::MAX); JOINTS],
        gripper: (Opening::CLOSED, GripperSpeed(1_000)),
    }))
}
