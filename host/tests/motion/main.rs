//! Replay, teleoperation and trajectories of virtual arms, in virtual time.
#![forbid(unsafe_code)]

mod follow;
mod replay;
mod trajectory;
mod world;
