//! UBTECH Alpha1: a humanoid of 16 servos on USB, and the servos on their own bus.
//!
//! Rows are those of *Alpha1 Series PC Communication Protocol*, V20151215, named by the first byte of their header. The
//! messages of the servos' manual (*UBT-12HC User Manual*, V1.02), to which it refers, are included. The robot's
//! Bluetooth protocol is a different one: its frames are recognised and skipped.
//!
//! ```
//! use core::time::Duration;
//!
//! use armwire::alpha1::{Address, Alpha1, Angle, Interval, MAX_FRAME, MoveTime, Request, ServoId, ServoRequest};
//! use armwire::messages::Messages;
//!
//! let request = Request::Servo(ServoRequest::Move {
//!     to: Address::One(ServoId::new(1)?),
//!     angle: Angle::new(90)?,
//!     time: MoveTime::from_duration(Duration::from_secs(1))?,
//!     lock: Interval::from_duration(Duration::from_secs(1))?,
//! });
//! let mut out = [0; MAX_FRAME];
//! let n = Alpha1.encode_request(&request, &mut out).unwrap_or_default();
//! assert_eq!(out[..n], [0xFA, 0xAF, 0x01, 0x01, 0x5A, 0x32, 0x00, 0x32, 0xC0, 0xED]);
//! # Ok::<(), armwire::OutOfRange<f32>>(())
//! ```

mod answer;
mod cause;
mod correlation;
#[cfg(feature = "async")]
mod driver;
mod frame;
pub mod hid;
mod message;
mod protocol;
#[cfg(test)]
mod tests;
mod text;
mod value;

pub use cause::Cause;
pub use correlation::Key;
#[cfg(feature = "async")]
pub use driver::Arm;
pub use frame::{
    Expect, Frame, MAX_FRAME, READ_FIRMWARE_VERSION, READ_SERVO_STATES, STOP, ServoAnswer, TAIL, checksum,
};
pub use message::{Action, FirmwareVersion, Request, Response, ServoRequest, ServoResponse};
pub use protocol::Alpha1;
pub use value::{
    Address, Angle, INSTALLED, Interval, Led, MAX_TEXT, MoveTime, OLDEST_FIRMWARE, Offset, OffsetTool, Outcome, SERVOS,
    ServoAngles, ServoId, ServoStates, Text, UsbType,
};

use crate::Client;

/// A [`Client`] with buffers for every message of this protocol. A smaller one is enough for short names and versions,
/// and for a bus of servos.
///
/// ```
/// use armwire::Config;
/// use armwire::alpha1::{Alpha1, Alpha1Client, Request};
///
/// let mut client = Alpha1Client::new(Alpha1, Config::default());
/// client.submit(&Request::Stop)?;
/// # Ok::<(), armwire::SubmitError>(())
/// ```
pub type Alpha1Client = Client<Alpha1, MAX_FRAME>;
