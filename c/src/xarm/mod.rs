//! UFACTORY xArm: up to seven joints, on TCP port 502.

pub mod client;
pub mod device;
pub mod message;
