//! The engine of the page in `web/`: a host's session with a Ling arm, and a virtual arm behind a line with faults.
//!
//! | Module | Job |
//! |---|---|
//! | [`session`] | the conversation: identify, read in turn, move while an axis is held |
//! | [`jog`] | from held axes to targets |
//! | [`log`], [`describe`] | the bytes on the line as frames, noise, and text |
//! | [`counters`] | counters of the line, and answer times |
//! | [`virtual_arm`] | the arm of `armwire-sim` and its line |
//! | [`exports`] | the functions that the page calls |
//!
//! # The path of a byte
//!
//! To the arm: [`Session::transmit`](session::Session::transmit) writes a frame, and `engine.js` copies it from the output
//! buffer to a port. From the arm: a port passes a chunk to `engine.js`, which copies it to the input buffer and calls
//! `session_receive`. The [`Log`](log::Log) decodes it to rows, the `Client` to an answer. The port is the serial port or
//! the [`VirtualArm`](virtual_arm::VirtualArm), which uses the same two buffers.
#![deny(unsafe_code)]

pub mod counters;
pub mod describe;
pub mod exports;
pub mod jog;
pub mod log;
pub mod session;
pub mod virtual_arm;

#[cfg(target_family = "wasm")]
#[global_allocator]
static ALLOCATOR: lol_alloc::LockedAllocator<lol_alloc::FreeListAllocator> =
    lol_alloc::LockedAllocator::new(lol_alloc::FreeListAllocator::new());
