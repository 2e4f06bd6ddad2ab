//! The boards that run the adapter: what differs between boards with the same chip.
//!
//! The firmware, the program that builds it, and its tests have their boards from [`BOARDS`]. `docs/boards.md` has the
//! sources of these facts, and the wiring.
#![no_std]
#![forbid(unsafe_code)]

mod board;
mod list;

pub use board::{Board, CanPins, Chip, Led, Pin, Port, Uart};
pub use list::BOARDS;

#[cfg(test)]
mod tests;
