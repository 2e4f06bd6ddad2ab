//! Errors that every protocol shares.

use core::fmt;

use crate::Reason;

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

/// A value outside what the protocol can say: a count as it is on the wire, or a quantity in SI units (`f32`).
///
/// ```
/// use armwire::ling::Position;
///
/// let error = Position::new(4096).unwrap_err();
/// assert_eq!(error.to_string(), "joint position is 4096 ticks, must be 0..=4095");
/// let error = Position::from_radians(-4.0).unwrap_err();
/// assert_eq!(error.to_string(), "joint angle is -4 rad, must be -3.1415927..=3.1400588");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct OutOfRange<T = u16> {
    /// What the value is of.
    pub what: &'static str,
    /// Its unit, or an empty string.
    pub unit: &'static str,
    /// The value.
    pub got: T,
    /// The least it may be.
    pub min: T,
    /// The most it may be.
    pub max: T,
}

/// A count is a quantity too, so that one `?` takes both.
impl From<OutOfRange> for OutOfRange<f32> {
    fn from(count: OutOfRange) -> Self {
        Self {
            what: count.what,
            unit: count.unit,
            got: count.got.into(),
            min: count.min.into(),
            max: count.max.into(),
        }
    }
}

impl<T: fmt::Display> fmt::Display for OutOfRange<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let space = if self.unit.is_empty() { "" } else { " " };
        write!(
            f,
            "{} is {}{space}{}, must be {}..={}",
            self.what, self.got, self.unit, self.min, self.max
        )
    }
}

impl<T: fmt::Display + fmt::Debug> core::error::Error for OutOfRange<T> {}

/// Why a frame cannot be written: what cannot be read back is not.
///
/// ```
/// use armwire::ling::{Frame, MAX_DATA};
/// use armwire::{EncodeError, OutOfRange};
///
/// let frame = Frame { command: 0x05, function: 0x00, data: &[0; MAX_DATA + 1] };
/// let Err(EncodeError::OutOfRange(error)) = frame.encode(&mut [0; 100]) else {
///     panic!("it was written");
/// };
/// assert_eq!((error.what, error.got, error.max), ("data", 65, 64));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum EncodeError {
    /// The buffer is too short.
    BufferTooShort(BufferTooShort),
    /// A field, or the length of a part, is one that no frame has.
    OutOfRange(OutOfRange),
    /// A byte that may have few values has another.
    Byte {
        /// Where it is, in bytes from the start of the frame.
        offset: u8,
        /// What it may be.
        expected: &'static [u8],
        /// What it is.
        got: u8,
    },
}

impl fmt::Display for EncodeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::BufferTooShort(error) => error.fmt(f),
            Self::OutOfRange(error) => error.fmt(f),
            Self::Byte { offset, expected, got } => Reason::Byte { offset, expected, got }.fmt(f),
        }
    }
}

impl core::error::Error for EncodeError {}

/// Writes what may be instead of what is: `a or b or c`.
pub(crate) fn write_either<T>(
    f: &mut fmt::Formatter<'_>,
    choices: &[T],
    write: impl Fn(&mut fmt::Formatter<'_>, &T) -> fmt::Result,
) -> fmt::Result {
    for (i, choice) in choices.iter().enumerate() {
        f.write_str(if i == 0 { "" } else { " or " })?;
        write(f, choice)?;
    }
    Ok(())
}
