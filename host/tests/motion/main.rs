//! Replay and teleoperation with virtual arms, in virtual time.
#![forbid(unsafe_code)]

mod follow;
mod replay;
mod world;
