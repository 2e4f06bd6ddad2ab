//! Errors common to all protocols.

use core::fmt;

use crate::hex::Hex;

/// A buffer that is too short for the data to write.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct BufferTooShort {
    /// Required length in bytes.
    pub needed: usize,
    /// Actual length in bytes.
    pub got: usize,
}

impl fmt::Display for BufferTooShort {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { needed, got } = self;
        write!(f, "the message takes {needed} bytes, the buffer has {got}")
    }
}

impl core::error::Error for BufferTooShort {}

/// A value outside the protocol's range: a raw count, or a quantity in SI units (`f32`).
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
    /// The name of the value.
    pub what: &'static str,
    /// Its unit, or an empty string.
    pub unit: &'static str,
    /// The value.
    pub got: T,
    /// The minimum.
    pub min: T,
    /// The maximum.
    pub max: T,
}

impl<T: fmt::Display> fmt::Display for OutOfRange<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { what, unit, got, .. } = self;
        let space = if unit.is_empty() { "" } else { " " };
        write!(f, "{what} is {got}{space}{unit}, must be {}..={}", self.min, self.max)
    }
}

impl<T: fmt::Debug + fmt::Display> core::error::Error for OutOfRange<T> {}

impl<T: Copy> OutOfRange<T> {
    /// The error of a value `got` outside `min..=max`.
    pub const fn new(what: &'static str, unit: &'static str, got: T, min: T, max: T) -> Self {
        Self {
            what,
            unit,
            got,
            min,
            max,
        }
    }

    /// Converts the error to a wider type.
    fn widen<U: From<T> + Copy>(self) -> OutOfRange<U> {
        OutOfRange::new(self.what, self.unit, self.got.into(), self.min.into(), self.max.into())
    }
}

/// The value, if it is within its range.
#[cfg(any(feature = "ling", feature = "xarm", feature = "alpha1"))]
pub(crate) fn within<T: Copy + PartialOrd>(
    what: &'static str,
    unit: &'static str,
    got: T,
    min: T,
    max: T,
) -> Result<T, OutOfRange<T>> {
    match (min..=max).contains(&got) {
        true => Ok(got),
        false => Err(OutOfRange::new(what, unit, got, min, max)),
    }
}

/// Checks that a length is at most `max`, which must be less than 65 535.
#[cfg(any(feature = "ling", feature = "xarm", feature = "alpha1"))]
pub(crate) fn at_most(what: &'static str, unit: &'static str, len: usize, max: u16) -> Result<(), OutOfRange> {
    let len = u16::try_from(len).unwrap_or(u16::MAX);
    within(what, unit, len, 0, max).map(drop)
}

/// A count converts to a quantity: one `?` handles both.
impl From<OutOfRange> for OutOfRange<f32> {
    fn from(count: OutOfRange) -> Self {
        count.widen()
    }
}

/// The reason why a frame cannot be written: its receiver would reject it.
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
    /// The data is longer than the maximum of a frame.
    OutOfRange(OutOfRange),
}

impl fmt::Display for EncodeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::BufferTooShort(error) => error.fmt(f),
            Self::OutOfRange(error) => error.fmt(f),
        }
    }
}

impl core::error::Error for EncodeError {}

impl From<BufferTooShort> for EncodeError {
    fn from(error: BufferTooShort) -> Self {
        Self::BufferTooShort(error)
    }
}

impl From<OutOfRange> for EncodeError {
    fn from(error: OutOfRange) -> Self {
        Self::OutOfRange(error)
    }
}

/// The error of a valid frame that is not a message of the document: the message's name, the cause and its offset.
///
/// ```
/// use armwire::alpha1::Alpha1;
/// use armwire::ling::Ling;
/// use armwire::messages::Messages;
/// use armwire::Cause;
///
/// let joints = [0xAA, 0x06, 0x00, 0x03, 0x00, 0x00, 0x00, 0x5F, 0xFF];
/// let error = Ling.parse_response(&joints, ()).unwrap_err();
/// assert_eq!(error.cause, Cause::Length { expected: &[15], got: 3 });
/// assert_eq!(error.to_string(), "command 06 function 00: 3 data bytes, expected 15");
///
/// let usb_type = [0xF9, 0x9F, 4, 0, 0, 0, 0, 0, 4, 0xED];
/// let error = Alpha1.parse_request(&usb_type).unwrap_err();
/// assert_eq!(error.to_string(), "command F9: data byte 0 is 04, must be 01 or 02 or 03");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ParseError {
    /// The name of the message.
    pub message: MessageId,
    /// The cause.
    pub cause: Cause,
}

impl fmt::Display for ParseError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.message, self.cause)
    }
}

impl core::error::Error for ParseError {}

/// The name of a message. Names and causes that only one protocol has are types of its module, and are not part of a
/// build without it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum MessageId {
    /// None: the bytes are not a frame.
    None,
    /// A command.
    Command(u8),
    /// A command and a function within it.
    Function {
        /// The command.
        command: u8,
        /// The function.
        function: u8,
    },
    /// A message of an xArm.
    #[cfg(feature = "xarm")]
    XArm(crate::xarm::MessageId),
}

/// The cause of a [`ParseError`]. Offsets are in bytes from the start of the message's data.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
// Without a bound for each field: the bound for `&'static [u8]` is not provable where one for `&'a [u8]` is assumed.
#[cfg_attr(feature = "defmt", derive(defmt::Format), defmt(bound()))]
#[non_exhaustive]
pub enum Cause {
    /// The document has no such message in this direction.
    Unknown,
    /// The arm's error frame, which names no request and no documented reason.
    ErrorFrame,
    /// The data has the wrong length.
    Length {
        /// The allowed lengths, in bytes.
        expected: &'static [usize],
        /// The actual length, in bytes.
        got: usize,
    },
    /// A byte is not one of the allowed values.
    Byte {
        /// The byte's offset.
        offset: usize,
        /// The allowed values.
        expected: &'static [u8],
        /// The byte.
        got: u8,
    },
    /// A value is out of range.
    Value {
        /// The value's offset.
        offset: usize,
        /// The value and its range.
        error: OutOfRange<i32>,
    },
    /// A cause that only the Alpha1's protocol has.
    #[cfg(feature = "alpha1")]
    Alpha1(crate::alpha1::Cause),
}

impl fmt::Display for Cause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unknown => f.write_str("unknown"),
            Self::ErrorFrame => f.write_str("the arm's error frame"),
            Self::Length { expected, got } => {
                write!(f, "{got} data bytes, expected {}", either(expected, fmt::Display::fmt))
            }
            Self::Byte { offset, expected, got } => {
                let expected = either(expected, |byte, f| write!(f, "{byte:02X}"));
                write!(f, "data byte {offset} is {got:02X}, must be {expected}")
            }
            Self::Value { offset, error } => write!(f, "{error} (data byte {offset})"),
            #[cfg(feature = "alpha1")]
            Self::Alpha1(cause) => cause.fmt(f),
        }
    }
}

impl core::error::Error for Cause {}

#[cfg(feature = "alpha1")]
impl From<crate::alpha1::Cause> for Cause {
    fn from(cause: crate::alpha1::Cause) -> Self {
        Self::Alpha1(cause)
    }
}

/// An arm's error frame: its bytes as sent, at most the first 16.
///
/// ```
/// use armwire::ErrorFrame;
///
/// let error = ErrorFrame::new(&[0xAA, 0xEE, 0x00, 0x00, 0xF7, 0xFF]);
/// assert_eq!(error.to_string(), "AA EE 00 00 F7 FF");
/// ```
#[derive(Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ErrorFrame {
    bytes: [u8; Self::MAX],
    /// The length of the frame, which may exceed that of `bytes`.
    len: usize,
}

impl ErrorFrame {
    /// The maximum number of bytes that are kept.
    pub const MAX: usize = 16;

    /// The error frame with these bytes.
    pub fn new(frame: &[u8]) -> Self {
        let mut bytes = [0; Self::MAX];
        for (to, byte) in bytes.iter_mut().zip(frame) {
            *to = *byte;
        }
        Self {
            bytes,
            len: frame.len(),
        }
    }

    /// The first bytes of the frame.
    pub fn bytes(&self) -> &[u8] {
        self.bytes.get(..self.len).unwrap_or(&self.bytes)
    }
}

impl fmt::Display for ErrorFrame {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        Hex(self.bytes()).fmt(f)?;
        match self.len.saturating_sub(Self::MAX) {
            0 => Ok(()),
            more => write!(f, " and {more} more"),
        }
    }
}

impl fmt::Debug for ErrorFrame {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "ErrorFrame({self})")
    }
}

impl ParseError {
    /// Bytes that are not a frame.
    pub const NO_FRAME: Self = Self {
        message: MessageId::None,
        cause: Cause::Unknown,
    };

    /// Adds the name of the message to a cause.
    #[cfg(any(feature = "ling", feature = "xarm", feature = "alpha1"))]
    pub(crate) fn of(message: MessageId) -> impl Fn(Cause) -> Self {
        move |cause| Self { message, cause }
    }
}

#[cfg(any(feature = "ling", feature = "xarm", feature = "alpha1"))]
impl Cause {
    /// A byte that is not one of the allowed values.
    #[cfg(any(feature = "ling", feature = "alpha1"))]
    pub(crate) const fn byte(offset: usize, expected: &'static [u8], got: u8) -> Self {
        Self::Byte { offset, expected, got }
    }

    /// A value out of range.
    pub(crate) fn value<T: Copy>(offset: usize, error: OutOfRange<T>) -> Self
    where
        i32: From<T>,
    {
        Self::Value {
            offset,
            error: error.widen(),
        }
    }
}

impl fmt::Display for MessageId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::None => f.write_str("no frame"),
            Self::Command(command) => write!(f, "command {command:02X}"),
            Self::Function { command, function } => write!(f, "command {command:02X} function {function:02X}"),
            #[cfg(feature = "xarm")]
            Self::XArm(message) => message.fmt(f),
        }
    }
}

/// Data of a fixed length, or the error with the expected length.
#[cfg(any(feature = "ling", feature = "alpha1"))]
pub(crate) fn sized<'a, const N: usize>(data: &'a [u8], expected: &'static [usize]) -> Result<&'a [u8; N], Cause> {
    let got = data.len();
    data.try_into().map_err(|_| Cause::Length { expected, got })
}

/// Checks constant data, `offset` bytes from the start of all data.
#[cfg(feature = "alpha1")]
pub(crate) fn constant<const N: usize>(offset: usize, data: &[u8; N], expected: &'static [u8; N]) -> Result<(), Cause> {
    for (i, (got, expected)) in data.iter().zip(expected.chunks(1)).enumerate() {
        if expected != [*got] {
            return Err(Cause::byte(offset.saturating_add(i), expected, *got));
        }
    }
    Ok(())
}

/// The choices as `a or b or c`.
pub(crate) fn either<T>(
    choices: &[T],
    write: impl Fn(&T, &mut fmt::Formatter<'_>) -> fmt::Result,
) -> impl fmt::Display {
    Either { choices, write }
}

/// Choices and the formatter of a choice. `fmt::from_fn` needs Rust 1.93.
struct Either<'a, T, F> {
    choices: &'a [T],
    write: F,
}

impl<T, F: Fn(&T, &mut fmt::Formatter<'_>) -> fmt::Result> fmt::Display for Either<'_, T, F> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, choice) in self.choices.iter().enumerate() {
            f.write_str(if i == 0 { "" } else { " or " })?;
            (self.write)(choice, f)?;
        }
        Ok(())
    }
}

#[cfg(all(test, feature = "ling", not(any(feature = "xarm", feature = "alpha1"))))]
mod tests {
    use super::*;

    /// It compiles only if these are all variants.
    #[test]
    fn build_with_ling_names_no_other_protocol() {
        let error = ParseError::of(MessageId::Function {
            command: 6,
            function: 0,
        })(Cause::Unknown);
        assert!(match error.message {
            MessageId::Function { .. } => true,
            MessageId::None | MessageId::Command(_) => false,
        });
        assert!(match error.cause {
            Cause::Unknown => true,
            Cause::ErrorFrame | Cause::Length { .. } | Cause::Byte { .. } | Cause::Value { .. } => false,
        });
    }
}
