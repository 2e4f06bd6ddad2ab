//! Common parts of the fuzz targets: arbitrary messages of every protocol, lines of bytes, and the decoded items.
//!
//! `docs/fuzzing.md` describes the property of each target and how to run them.
#![forbid(unsafe_code)]

mod accounts;
pub mod adapter;
mod alpha1;
mod config;
mod legacy;
pub mod line;
mod ling;
mod subject;
mod xarm;

pub use arbitrary::{Arbitrary, Result, Unstructured};
pub use config::any_good_config;
pub use subject::{AnyResponse, Check, ROOM, Subject, check, request_bytes, response_bytes};
