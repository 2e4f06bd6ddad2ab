//! UFACTORY xArm: up to seven joints, on TCP port 502.

mod dialect;
mod frame;

pub use crate::xarm::ProtocolId;
pub use dialect::Key;
pub use frame::{Direction, Frame, HEADER, HEARTBEAT, MAX_BODY, MAX_FRAME, MAX_PARAMS};

/// The xArm protocol, with the protocol id of its requests. Responses are read in any.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct XArm {
    /// The protocol id.
    pub protocol: ProtocolId,
}

impl XArm {
    /// In protocol id 2, the document's.
    pub const PRIVATE: Self = Self {
        protocol: ProtocolId::Private,
    };
}

impl Default for XArm {
    fn default() -> Self {
        Self::PRIVATE
    }
}
