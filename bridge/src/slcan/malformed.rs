//! The reasons for which a line is refused.

use core::{error, fmt};

use armwire::OutOfRange;

use crate::can::bus::Id;

/// A malformed line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Malformed {
    /// Its first character, 0 if it has none.
    pub command: u8,
    /// The error in the line.
    pub cause: Cause,
}

/// Cause of a malformed line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Cause {
    /// Unknown first character.
    Unknown,
    /// Invalid digit.
    Digit {
        /// Position in the line, 0 for the first character.
        at: usize,
        /// The character at this position.
        got: u8,
    },
    /// Invalid length.
    Length {
        /// Expected number of characters.
        expected: usize,
        /// Actual number of characters.
        got: usize,
    },
    /// Value out of range.
    OutOfRange(OutOfRange),
    /// An identifier of more than 29 bits.
    Identifier(u32),
    /// A data bit rate, in Mbit/s, that is not one of [`DATA_BIT_RATES`](super::DATA_BIT_RATES).
    DataBitRate(u8),
}

impl fmt::Display for Malformed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "'{}': ", self.command.escape_ascii())?;
        match self.cause {
            Cause::Unknown => f.write_str("unknown first character"),
            Cause::Digit { at, got } => write!(f, "'{}' at {at} is not a valid digit", got.escape_ascii()),
            Cause::Length { expected, got } => write!(f, "{got} characters, must be {expected}"),
            Cause::OutOfRange(error) => error.fmt(f),
            Cause::Identifier(id) => write!(f, "CAN identifier is {id:#X}, must be up to {:#X}", Id::MAX_EXTENDED),
            Cause::DataBitRate(rate) => write!(f, "data bit rate is {rate} Mbit/s, must be 1, 2, 4 or 5 Mbit/s"),
        }
    }
}

impl error::Error for Malformed {}
