//! A virtual Alpha1 robot, and its servos on a bus of their own.
//!
//! [`Alpha1Robot`] is the controller: it hears requests, obeys, plays actions, and passes on what is for its servos.
//! [`ServoBus`] is servos alone. [`Servo`] is one servo in either.

mod action;
mod bus;
mod chain;
mod port;
mod robot;
mod servo;
#[cfg(test)]
mod tests;

pub use crate::serial::Counters;
pub use bus::{BusConfig, ServoBus};
pub use robot::{Alpha1Robot, RobotConfig};
pub use servo::Servo;

/// Servos of an Alpha1.
pub const SERVOS: usize = 16;
