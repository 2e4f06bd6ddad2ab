//! UBTECH Alpha1: a humanoid of 16 servos on USB, and the servos on their own bus.
//!
//! Rows are those of *Alpha1 Series PC Communication Protocol*, V20151215, named by the first byte of their header.
//! What they leave to the servos' manual (*UBT-12HC User Manual*, V1.02) is here too. The robot's Bluetooth protocol is
//! another one: its frames are recognised, and passed over.
//!
//! ```
//! use core::time::Duration;
//!
//! use armwire::Protocol;
//! use armwire::alpha1::{Address, Alpha1, Angle, Interval, MAX_FRAME, MoveTime, Request, ServoId, ServoRequest};
//!
//! let request = Request::Servo(ServoRequest::Move {
//!     to: Address::One(ServoId::new(1)?),
//!     angle: Angle::new(90)?,
//!     time: MoveTime::from_duration(Duration::from_secs(1))?,
//!     lock: Interval::from_duration(Duration::from_secs(1))?,
//! });
//! let mut out = [0; MAX_FRAME];
//! let n = Alpha1::encode_request(&request, &mut out).unwrap_or_default();
//! assert_eq!(out[..n], [0xFA, 0xAF, 0x01, 0x01, 0x5A, 0x32, 0x00, 0x32, 0xC0, 0xED]);
//! # Ok::<(), armwire::OutOfRange<f32>>(())
//! ```

#[cfg(feature = "async")]
mod driver;
mod frame;
mod message;
#[cfg(test)]
mod tests;
mod value;

#[cfg(feature = "async")]
pub use driver::{Arm, CallError};
pub use frame::{Expect, Frame, MAX_FRAME, MAX_TEXT, ServoAnswer, TAIL, checksum};
pub use message::{
    Action, Cause, FirmwareVersion, ParseError, Request, Response, ResponseRef, ServoRequest, ServoResponse,
};
pub use value::{
    Address, Angle, Interval, Led, MoveTime, OLDEST_FIRMWARE, Offset, OffsetTool, Outcome, SERVOS, ServoId,
    ServoStates, Text, TextRef, UsbType,
};

/// The Alpha1 protocol: a name for [`Decoder`](crate::Decoder), [`Client`](crate::Client) and
/// [`Device`](crate::Device).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Alpha1 {}
