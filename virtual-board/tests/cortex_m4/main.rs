//! The Cortex-M4 by its manual, and beside an independent emulator.

mod board;
mod exceptions;
mod instructions;
mod lockstep;
mod memory;
mod timing;
