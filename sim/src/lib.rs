//! Virtual arms, and the line between them and a host, for tests and for any serial program.
#![forbid(unsafe_code)]

pub mod ling;
#[cfg(unix)]
pub mod pty;
pub mod serial;
