//! Tests of the Cortex-M4 against its manual, and against an independent emulator.

mod board;
mod exceptions;
mod instructions;
mod lockstep;
mod memory;
mod timing;
