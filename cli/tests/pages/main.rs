//! The built program against the repository's pages. The published package has neither pages nor these tests.
#![cfg(unix)]
#![forbid(unsafe_code)]

// The program's other tests use the other items.
#[allow(dead_code)]
#[path = "../program/common/mod.rs"]
mod common;

mod block;
mod can;
mod examples;
mod update;
mod world;
