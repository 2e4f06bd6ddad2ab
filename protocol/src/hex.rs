//! Frames written in hex, for the unit tests.

extern crate std;

use std::vec::Vec;

/// The bytes of `text`, in hex.
pub(crate) fn hex(text: &str) -> Vec<u8> {
    text.split_whitespace()
        .map(|byte| u8::from_str_radix(byte, 16).unwrap())
        .collect()
}
