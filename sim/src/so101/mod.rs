//! A virtual SO-101: six Feetech servos on one wire, which fail on order.
//!
//! Packets, registers and their ranges are those of [`armwire_feetech`]. What a real servo does beyond its documents is a
//! guess: docs/so101.md lists every guess, and its source.

mod bus;
mod config;
mod faults;
mod order;
mod plant;
mod servo;
#[cfg(test)]
mod tests;

pub use bus::So101;
pub use config::{Config, ConfigError};
pub use order::{Order, OrderError};
pub use servo::Servo;
