//! Ling / Alicia-D: six joints and a gripper on a 1 Mbaud UART.
//!
//! Sections are those of the *Ling Upper/Lower Machine Communication Protocol*, last modified on March 6, 2026. The
//! messages of the force-feedback leader are those of the vendor's candidate document of September 2026.
//!
//! ```
//! use armwire::messages::Messages;
//! use armwire::ling::{Ling, Request, Torque};
//!
//! let mut out = [0; 8];
//! let n = Ling.encode_request(&Request::SetTorque(Torque::On), &mut out)?;
//! assert_eq!(out[..n], [0xAA, 0x05, 0x00, 0x01, 0x01, 0xF9, 0xFF]);
//! # Ok::<(), armwire::BufferTooShort>(())
//! ```

mod answer;
pub mod arrival;
mod correlation;
#[cfg(feature = "async")]
mod driver;
pub mod effect;
mod force_feedback;
mod frame;
#[cfg(feature = "ling-legacy")]
pub mod legacy;
mod message;
pub mod mode_change;
mod protocol;
mod rest;
pub mod stop;
#[cfg(test)]
mod tests;
pub mod text;
mod value;

pub use correlation::Key;
#[cfg(feature = "async")]
pub use driver::Arm;
pub use effect::ReadBack;
pub use force_feedback::{
    ControlMode, ForceFeedback, Inhibit, JointForce, JointMask, ModeReply, ModeResult, ModeState,
};
pub use frame::{
    Frame, MAX_DATA, MAX_FRAME, OVERHEAD, READ_INFO, READ_JOINTS, SELF_CHECK, TAIL, TORQUE_OFF, TORQUE_ON, checksum,
};
pub use message::{GripperSpeed, Info, JointState, Move, Request, Response, Torque};
pub use mode_change::ModeChange;
pub use protocol::Ling;
pub use rest::Rest;
pub use stop::Stop;
pub use value::{
    Foreign, Immovable, JOINTS, Kind, MotionStatus, Opening, PerServo, Position, SelfCheck, SerialNumber, Speed,
    Stroke, TICKS_PER_TURN, TemperatureLimit, Version,
};

use crate::Client;

/// A [`Client`] with buffers for every message of this protocol.
///
/// ```
/// use armwire::Config;
/// use armwire::ling::{Ling, LingClient, Request};
///
/// let mut client = LingClient::new(Ling, Config::default());
/// client.submit(&Request::ReadJoints)?;
/// # Ok::<(), armwire::SubmitError>(())
/// ```
pub type LingClient = Client<Ling, MAX_FRAME>;
