//! Virtual arms, and the line between them and a host, for tests and for any serial program.
//!
//! | Module | What it is |
//! |---|---|
//! | [`serial`] | the seam: a device at the far end of a serial line |
//! | [`ling`] | a Ling arm |
//! | [`faults`] | a line that drops, corrupts, repeats, delays and makes up bytes |
//! | [`wire`] | a host and a device on a line in virtual time |
//! | `pty`, `serve` | a device on a pseudo-terminal in real time (Unix) |
#![forbid(unsafe_code)]

pub mod faults;
pub mod ling;
#[cfg(unix)]
pub mod pty;
pub mod serial;
#[cfg(unix)]
pub mod serve;
pub mod wire;
