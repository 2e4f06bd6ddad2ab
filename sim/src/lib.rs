//! Virtual arms, and the line between them and a host, for tests and for any serial program.
#![forbid(unsafe_code)]

pub mod ling;
pub mod serial;
