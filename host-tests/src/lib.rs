//! Tests that cross crates, and their common code.
#![forbid(unsafe_code)]

pub mod adapter;
#[cfg(feature = "image")]
pub mod image;
pub mod page;
pub mod random;
pub mod reference;
pub mod weight;

/// The example in the README compiles.
#[cfg(doctest)]
#[doc = include_str!("../../README.md")]
pub struct Readme;
