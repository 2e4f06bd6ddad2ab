//! Ling / Alicia-D: six joints and a gripper on a 1 Mbaud UART.

pub mod arrival;
pub mod client;
pub mod device;
pub mod message;
pub mod read_back;
pub mod stop;
