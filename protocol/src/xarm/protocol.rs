//! The protocol, which has no state but the id of its requests.

use super::value::ProtocolId;

/// The xArm protocol, with the protocol id of its requests. Responses are accepted with any id.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct XArm {
    /// The protocol id.
    pub protocol: ProtocolId,
}

impl XArm {
    /// Protocol id 2, that of the document.
    pub const PRIVATE: Self = Self {
        protocol: ProtocolId::Private,
    };
}

impl Default for XArm {
    fn default() -> Self {
        Self::PRIVATE
    }
}
