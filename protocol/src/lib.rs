//! Exact, allocation-free robot-arm protocols.
#![no_std]
#![forbid(unsafe_code)]

mod time;

pub use time::Micros;
