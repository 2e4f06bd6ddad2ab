//! A virtual Alpha1 robot, and its servos on a separate bus.
//!
//! [`Alpha1Robot`] is the controller: it executes requests, plays actions and forwards servo requests. [`ServoBus`] has
//! servos only. [`Servo`] is one servo of either.

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

/// Number of servos in an Alpha1.
pub const SERVOS: usize = armwire::alpha1::INSTALLED;
