//! The frames of a log, and the words of its records.

use std::borrow::Cow;

use armwire_bridge::Instant;
use armwire_bridge::can::{Frame, Id, MAX_CLASSIC};

use crate::decode::doubts::Doubt;

/// The highest 29-bit identifier.
pub(super) const MAX_EXTENDED: u32 = 0x1FFF_FFFF;

/// One frame of a log.
#[derive(Debug, PartialEq)]
pub(in crate::decode) struct Logged<'a> {
    pub(in crate::decode) time: Time<'a>,
    /// The name of the bus in the log; empty if there is none.
    pub(in crate::decode) bus: Cow<'a, str>,
    /// `None` for remote frames, error frames and 29-bit identifiers, which adapters do not use.
    pub(in crate::decode) frame: Option<Frame>,
    /// Number of bytes at the end of the frame that the log lacks. They are 0 in `frame`.
    pub(in crate::decode) lacking: usize,
}

impl<'a> Logged<'a> {
    /// A frame with all of its data.
    pub(in crate::decode) fn whole(time: Time<'a>, bus: impl Into<Cow<'a, str>>, frame: Option<Frame>) -> Self {
        Self {
            time,
            bus: bus.into(),
            frame,
            lacking: 0,
        }
    }
}

/// The time of a frame.
#[derive(Debug, PartialEq)]
pub(in crate::decode) struct Time<'a> {
    pub(in crate::decode) at: Instant,
    /// The text in the log; empty if there is none.
    pub(in crate::decode) stamp: Cow<'a, str>,
    /// The unit of the text; empty for seconds.
    pub(in crate::decode) unit: &'static str,
}

impl<'a> Time<'a> {
    /// A time whose text is in seconds, or a date.
    pub(in crate::decode) fn seconds(at: Instant, stamp: impl Into<Cow<'a, str>>) -> Self {
        let stamp = stamp.into();
        Self { at, stamp, unit: "" }
    }
}

/// Converts a time, a decimal number in this unit.
pub(super) fn time<'a>(text: &'a str, unit: Unit) -> Result<Time<'a>, Doubt> {
    let micros = decimal(text, unit.decimals).ok_or_else(|| Doubt::word(text, "no time"))?;
    Ok(Time {
        at: Instant::from_micros(micros),
        stamp: text.into(),
        unit: unit.suffix,
    })
}

/// The unit of a log's times.
pub(super) struct Unit {
    suffix: &'static str,
    /// Number of decimals to a microsecond.
    decimals: usize,
}

pub(super) const SECONDS: Unit = Unit {
    suffix: "",
    decimals: 6,
};
pub(super) const MILLIS: Unit = Unit {
    suffix: " ms",
    decimals: 3,
};
pub(super) const MICROS: Unit = Unit {
    suffix: " µs",
    decimals: 0,
};

/// A decimal number in units of its last digit, with `digits` decimals. Further decimals are ignored.
pub(in crate::decode) fn decimal(text: &str, digits: usize) -> Option<u64> {
    let (whole, fraction) = text.split_once('.').unwrap_or((text, "0"));
    let are_digits = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    if !are_digits(whole) || !are_digits(fraction) {
        return None;
    }
    let scale = 10_u64.checked_pow(digits as u32)?;
    let kept = fraction.bytes().chain(std::iter::repeat(b'0')).take(digits);
    let fraction = kept.fold(0, |sum, digit| sum * 10 + u64::from(digit - b'0'));
    whole.parse::<u64>().ok()?.checked_mul(scale)?.checked_add(fraction)
}

/// An integer in this base.
pub(super) fn number(text: &str, base: u32) -> Option<u32> {
    // The parser of the standard library accepts a sign.
    let are_digits = text.chars().all(|digit| digit.is_digit(base));
    u32::from_str_radix(text, base).ok().filter(|_| are_digits)
}

pub(super) fn identifier(text: &str, base: u32) -> Result<u32, Doubt> {
    number(text, base).ok_or_else(|| Doubt::word(text, "no identifier"))
}

/// `len` bytes, each a word in this base.
pub(super) fn data<'a>(words: impl Iterator<Item = &'a str>, len: usize, base: u32) -> Result<Vec<u8>, Doubt> {
    let byte = |word: &str| byte(word, base).ok_or_else(|| Doubt::word(word, "no byte"));
    let bytes = words.take(len).map(byte).collect::<Result<Vec<_>, _>>()?;
    match bytes.len() {
        there if there == len => Ok(bytes),
        there => Err(Doubt::short(len, there)),
    }
}

/// A byte in this base.
pub(super) fn byte(word: &str, base: u32) -> Option<u8> {
    number(word, base).and_then(|byte| u8::try_from(byte).ok())
}

/// A data frame; `None` if its identifier has 29 bits. More than 8 bytes are those of an FD frame in any case: some
/// programs write no other sign of it.
pub(in crate::decode) fn frame(id: u32, is_extended: bool, is_fd: bool, data: &[u8]) -> Result<Option<Frame>, Doubt> {
    let max = if is_extended {
        MAX_EXTENDED
    } else {
        Id::MAX.get().into()
    };
    if id > max {
        let text = format!("identifier {id:X} is out of range (0 to {max:X})");
        return Err(Doubt::new("identifier out of range", text));
    }
    // The length is checked for both kinds of identifier.
    let standard = Id::new(id as u16).unwrap_or(Id::MAX);
    let new = if is_fd || data.len() > MAX_CLASSIC {
        Frame::new_fd
    } else {
        Frame::new
    };
    let frame = new(standard, data).map_err(|error| Doubt::new("no length of a frame", error.to_string()))?;
    Ok((!is_extended).then_some(frame))
}
