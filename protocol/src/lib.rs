//! Exact, allocation-free robot-arm protocols.
#![no_std]
#![forbid(unsafe_code)]

mod decoder;
mod error;
mod framing;
pub mod ling;
mod time;

pub use decoder::Decoder;
pub use error::{BufferTooShort, OutOfRange};
pub use framing::{Framing, Noise, Reason, Scan};
pub use time::Micros;
