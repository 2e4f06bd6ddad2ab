//! Replay with virtual arms, in virtual time.
#![forbid(unsafe_code)]

mod replay;
mod world;
