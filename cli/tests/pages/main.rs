//! The repository's pages about the command, against the built program. The package has neither the pages nor these tests.
#![cfg(unix)]
#![forbid(unsafe_code)]

// The program's other tests use the rest of it.
#[allow(dead_code)]
#[path = "../program/common/mod.rs"]
mod common;

mod can;
mod readme;
mod update;
