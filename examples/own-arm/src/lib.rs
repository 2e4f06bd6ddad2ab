//! A protocol of one's own on the engine of `armwire`: an invented sensor that reports the angles of an arm's joints.
//! [The page](../../../docs/own-arm.md) explains each file.
#![no_std]
#![forbid(unsafe_code)]

pub mod call;
pub mod dma;
pub mod sensor;
pub mod virtual_sensor;
