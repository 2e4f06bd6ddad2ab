//! What is measured: for each protocol, clean streams of one frame again and again, and what takes them in.
//!
//! Each function returns how many frames came out, all of them down to typed values. Every peer gets its stream in the
//! same way: in chunks of so many bytes, none longer.

pub mod arms;
pub mod others;

/// How many frames a clean stream has.
pub const FRAMES: usize = 1000;

/// One frame again and again.
pub fn repeated(frame: &[u8]) -> Vec<u8> {
    frame.repeat(FRAMES)
}
