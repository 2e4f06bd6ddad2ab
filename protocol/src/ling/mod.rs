//! Ling / Alicia-D: six joints and a gripper on a 1 Mbaud UART.
//!
//! Sections are those of the *Ling Upper/Lower Machine Communication Protocol*, last modified on March 6, 2026.
//!
//! ```
//! use armwire::Protocol;
//! use armwire::ling::{Ling, Request, Torque};
//!
//! let mut out = [0; 8];
//! let n = Ling::encode_request(&Request::SetTorque(Torque::On), &mut out)?;
//! assert_eq!(out[..n], [0xAA, 0x05, 0x00, 0x01, 0x01, 0xF9, 0xFF]);
//! # Ok::<(), armwire::BufferTooShort>(())
//! ```

#[cfg(not(feature = "crc-table16"))]
mod crc;
#[cfg(feature = "async")]
mod driver;
mod frame;
pub mod legacy;
mod message;
#[cfg(test)]
mod tests;
mod value;

#[cfg(feature = "async")]
pub use driver::{Arm, CallError};
pub use frame::{Frame, MAX_DATA, MAX_FRAME, OVERHEAD, SELF_CHECK, TAIL, checksum};
pub use message::{Cause, GripperSpeed, Info, JointState, Move, ParseError, Request, Response, Torque};
pub use value::{
    JOINTS, Kind, MotionStatus, Opening, PerServo, Position, SelfCheck, SerialNumber, Speed, Stroke, TICKS_PER_TURN,
    TemperatureLimit, Version,
};

/// The Ling protocol: a name for [`Decoder`](crate::Decoder), [`Client`](crate::Client) and
/// [`Device`](crate::Device).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Ling {}
