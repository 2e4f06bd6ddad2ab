//! The names of messages.

use core::fmt;

/// The name of a message of this protocol.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum MessageId {
    /// A register.
    Register(u8),
    /// Standard Modbus.
    Modbus {
        /// The unit.
        unit: u8,
        /// The function, without the exception bit.
        function: u8,
    },
}

impl fmt::Display for MessageId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Register(register) => write!(f, "register {register}"),
            Self::Modbus { unit, function } => write!(f, "standard Modbus, unit {unit}, function {function}"),
        }
    }
}
