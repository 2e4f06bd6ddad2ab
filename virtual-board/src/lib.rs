//! A virtual board: the shipped firmware image on a modelled STM32F405RG, with a USB host and an arm at its edges.
#![forbid(unsafe_code)]

mod board;
pub mod latency;
pub mod line;
mod machine;
mod otg;
pub mod report;
#[cfg(unix)]
pub mod serve;
mod stm32f405;
mod time;
mod trace;
pub mod usb;

pub use board::{Config, Error, Uart, Usb, VirtualBoard};
pub use line::Arm;
pub use stm32f405::Reenabled;
pub use time::Nanos;
