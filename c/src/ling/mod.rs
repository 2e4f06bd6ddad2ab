//! Ling / Alicia-D: six joints and a gripper on a UART of 1 Mbaud.

pub mod client;
pub mod device;
pub mod message;
