//! UFACTORY xArm: up to seven joints, on TCP port 502.
//!
//! Registers are those of the vendor's page *Public Port Section (0-10)*.
//!
//! ```
//! use armwire::messages::Messages;
//! use armwire::xarm::{Joint, Request, XArm};
//!
//! let mut out = [0; 8];
//! let n = XArm::PRIVATE.encode_request(&Request::ReadRotationRadius(Joint::new(6)?), &mut out).unwrap_or_default();
//! assert_eq!(out[..n], [0x00, 0x00, 0x00, 0x02, 0x00, 0x02, 0x06, 0x06]); // the client writes a number first
//! # Ok::<(), armwire::OutOfRange>(())
//! ```

mod answer;
mod codes;
mod correlation;
#[cfg(feature = "async")]
mod driver;
mod frame;
mod message;
mod message_id;
mod protocol;
#[cfg(test)]
mod tests;
mod text;
mod value;

pub use answer::Answer;
pub use codes::{Codes, ErrorCode, WarningCode};
pub use correlation::Key;
#[cfg(feature = "async")]
pub use driver::Arm;
pub use frame::{Direction, Frame, HEADER, HEARTBEAT, MAX_BODY, MAX_FRAME};
pub use message::{Reply, Request, Response};
pub use message_id::MessageId;
pub use protocol::XArm;
pub use value::{
    Joint, MAX_JOINTS, MAX_PARAMS, ModbusFunction, ProtocolId, Raw, RawError, Register, RotationRadius, SerialsText,
    State, TEXT, TorqueSource, Version, VersionError, VersionText,
};

use crate::Client;

/// A [`Client`] with buffers for every message of this protocol.
///
/// ```
/// use armwire::Config;
/// use armwire::xarm::{Request, XArm, XArmClient};
///
/// let mut client = XArmClient::new(XArm::PRIVATE, Config::TCP);
/// client.submit(&Request::ReadVersion)?;
/// # Ok::<(), armwire::SubmitError>(())
/// ```
pub type XArmClient = Client<XArm, MAX_FRAME>;
