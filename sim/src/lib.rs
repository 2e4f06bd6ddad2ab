//! Virtual arms, and the line between an arm and its host, for tests and for any serial program.
//!
//! | Module | Contents |
//! |---|---|
//! | [`serial`] | the interface of a device at the far end of a serial line |
//! | [`ling`] | a Ling arm |
//! | [`xarm`] | an xArm, and its server on TCP ports |
//! | [`alpha1`] | an Alpha1 robot, and its servos on a separate bus |
//! | [`so101`] | an SO-101: six Feetech servos on one wire |
//! | [`faults`] | a line that drops, corrupts, duplicates, delays and inserts bytes |
//! | [`wire`] | a host and a device on a line in virtual time |
//! | [`can`] | a frame on a CAN bus, and its duration |
//! | [`slcan`] | a CAN adapter on a serial port |
//! | [`pty`], [`serve`] | a device on a pseudo-terminal in real time; Windows has none |
#![forbid(unsafe_code)]

pub mod alpha1;
mod angle;
pub mod can;
pub mod faults;
pub mod ling;
pub mod pty;
pub mod serial;
pub mod serve;
pub mod slcan;
pub mod so101;
pub mod wire;
pub mod xarm;
