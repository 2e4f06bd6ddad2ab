//! UFACTORY xArm: up to seven joints, on TCP port 502.
//!
//! Registers are those of the vendor's page *Public Port Section (0-10)*.
//!
//! ```
//! use armwire::Protocol;
//! use armwire::xarm::{Command, Header, Joint, ProtocolId, Request, XArm};
//!
//! let request = Request::Call {
//!     header: Header { transaction: 1, protocol: ProtocolId::Private },
//!     command: Command::ReadRotationRadius(Joint::new(6).unwrap()),
//! };
//! let mut out = [0; 8];
//! let n = XArm::encode_request(&request, &mut out)?;
//! assert_eq!(out[..n], [0x00, 0x01, 0x00, 0x02, 0x00, 0x02, 0x06, 0x06]);
//! # Ok::<(), armwire::BufferTooShort>(())
//! ```

#[cfg(feature = "async")]
mod driver;
mod frame;
#[expect(
    clippy::large_enum_variant,
    reason = "without allocation, raw parameters have nowhere else to be"
)]
mod message;
#[cfg(test)]
mod tests;
mod value;

#[cfg(feature = "async")]
pub use driver::{Answer, Arm, ArmError, CallError};
pub use frame::{Direction, Frame, HEADER, HEARTBEAT, MAX_BODY, MAX_FRAME, MAX_PARAMS};
pub use message::{Cause, Command, Header, ParseError, Reply, ReplyRef, Request, Response, ResponseRef, Transactions};
pub use value::{
    Joint, MAX_JOINTS, ModbusFunction, ProtocolId, Raw, RawError, RawRef, Register, RotationRadius, SerialsText, State,
    TEXT, TorqueSource, Version, VersionError, VersionText,
};

/// The xArm protocol: a name for [`Decoder`](crate::Decoder), [`Client`](crate::Client) and
/// [`Device`](crate::Device).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum XArm {}
