//! UBTECH Alpha1: a humanoid of 16 servos, and the servos on their own bus.

pub mod client;
pub mod device;
pub mod message;
