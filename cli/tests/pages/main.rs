//! The built program against files of the repository, such as its pages. The published package has neither these files
//! nor these tests.
#![cfg(unix)]
#![forbid(unsafe_code)]

// The program's other tests use the other items.
#[allow(dead_code)]
#[path = "../program/common/mod.rs"]
mod common;

mod block;
mod can;
mod effects;
mod examples;
mod joints;
mod lost_answer;
mod silence;
mod update;
mod world;
