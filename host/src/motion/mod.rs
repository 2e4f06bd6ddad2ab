//! The decisions of streamed motions: targets and readings in, moves out. No I/O and no clock.

pub(crate) mod axes;
pub mod engine;
pub mod follow;
pub(crate) mod goal;
pub mod replay;
pub mod trajectory;
