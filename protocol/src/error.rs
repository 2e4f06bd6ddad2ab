//! Errors that every protocol shares.

use core::fmt;

/// A buffer too short for what was to be written into it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct BufferTooShort {
    /// Bytes it would have taken.
    pub needed: usize,
    /// Bytes there were.
    pub got: usize,
}

impl fmt::Display for BufferTooShort {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "the message takes {} bytes, the buffer has {}",
            self.needed, self.got
        )
    }
}

impl core::error::Error for BufferTooShort {}

/// A value outside what the protocol can say.
///
/// ```
/// use armwire::ling::Position;
///
/// let error = Position::new(4096).unwrap_err();
/// assert_eq!(error.to_string(), "joint position is 4096 ticks, must be 0..=4095");
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct OutOfRange {
    /// What the value is of.
    pub what: &'static str,
    /// Its unit, or an empty string.
    pub unit: &'static str,
    /// The value.
    pub got: f32,
    /// The least it may be.
    pub min: f32,
    /// The most it may be.
    pub max: f32,
}

impl fmt::Display for OutOfRange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let space = if self.unit.is_empty() { "" } else { " " };
        write!(
            f,
            "{} is {}{space}{}, must be {}..={}",
            self.what, self.got, self.unit, self.min, self.max
        )
    }
}

impl core::error::Error for OutOfRange {}
