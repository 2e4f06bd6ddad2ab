//! Log formats of a CAN bus.

pub(super) mod asc;
pub(super) mod blf;
pub(super) mod candump;
pub(super) mod csv;
pub(super) mod gvret;
pub(super) mod trc;

#[cfg(test)]
mod tests;

use armwire_bridge::Instant;
use armwire_bridge::can::{Frame, Id};

use super::format::Format;
use super::input::Input;
use crate::error::Error;
use crate::printable::cut;
use asc::Asc;
use candump::Candump;
use csv::Csv;
use gvret::Gvret;
use trc::Trc;

/// The highest 29-bit identifier.
const MAX_EXTENDED: u32 = 0x1FFF_FFFF;

/// A consumer of records. Its error is the reason in words.
pub(super) type Take<'a> = dyn FnMut(Record<'_>) -> Result<(), String> + 'a;

/// Passes each record of a log to `take`. Recordings of a line have no records.
pub(super) fn read(input: &mut Input<'_>, format: Format, take: &mut Take<'_>) -> Result<(), Error> {
    match format {
        Format::Raw | Format::Hex | Format::Mcap => Ok(()),
        Format::Blf => blf::read(input, take),
        Format::Candump => read_lines(input, &mut Candump, take),
        Format::Asc => read_lines(input, &mut Asc::new(), take),
        Format::Trc => read_lines(input, &mut Trc::default(), take),
        Format::Csv => read_lines(input, &mut Csv, take),
        Format::Gvret => read_lines(input, &mut Gvret::default(), take),
    }
}

/// Passes each record of a log with one record per line to `take`.
fn read_lines(input: &mut Input<'_>, log: &mut dyn TextLog, take: &mut Take<'_>) -> Result<(), Error> {
    while let Some(line) = input.line()? {
        if line.text.trim().is_empty() {
            continue;
        }
        let taken = match log.record(&line.text) {
            // The missing end may change its meaning.
            Ok(Record::Frame(_)) | Err(_) if !line.is_whole => Err("the line is too long".to_owned()),
            record => record.and_then(&mut *take),
        };
        if let Err(reason) = taken {
            let (number, text) = (line.number, line.text.into_owned());
            return Err(input.refused_line(number, &text, &reason));
        }
    }
    Ok(())
}

/// A format with one record per line.
pub(super) trait TextLog {
    /// Parses a line that is not blank. The error is the reason in words.
    fn record<'a>(&mut self, line: &'a str) -> Result<Record<'a>, String>;
}

/// One record of a log.
#[derive(Debug, PartialEq)]
pub(super) enum Record<'a> {
    Frame(Logged<'a>),
    /// An event without a frame.
    Other,
    /// A line that is no event of the bus, such as a comment.
    Comment,
}

/// One frame of a log.
#[derive(Debug, PartialEq)]
pub(super) struct Logged<'a> {
    pub(super) time: Time<'a>,
    /// The name of the bus in the log; empty if there is none.
    pub(super) bus: &'a str,
    /// `None` for remote frames, error frames and 29-bit identifiers, which adapters do not use.
    pub(super) frame: Option<Frame>,
}

/// The time of a frame.
#[derive(Debug, PartialEq)]
pub(super) struct Time<'a> {
    pub(super) at: Instant,
    /// The text in the log; empty if there is none.
    pub(super) stamp: &'a str,
    /// The unit of the text; empty for seconds.
    pub(super) unit: &'static str,
}

impl<'a> Time<'a> {
    /// A time whose text is in seconds, or a date.
    fn seconds(at: Instant, stamp: &'a str) -> Self {
        Self { at, stamp, unit: "" }
    }
}

/// Converts a time, a decimal number in this unit.
fn time<'a>(text: &'a str, unit: Unit) -> Result<Time<'a>, String> {
    let micros = decimal(text, unit.decimals).ok_or_else(|| wrong(text, "no time"))?;
    Ok(Time {
        at: Instant::from_micros(micros),
        stamp: text,
        unit: unit.suffix,
    })
}

/// The error of a word.
fn wrong(word: &str, what: &str) -> String {
    format!("'{}' is {what}", cut(word))
}

/// The unit of a log's times.
struct Unit {
    suffix: &'static str,
    /// Number of decimals to a microsecond.
    decimals: usize,
}

const SECONDS: Unit = Unit {
    suffix: "",
    decimals: 6,
};
const MILLIS: Unit = Unit {
    suffix: " ms",
    decimals: 3,
};
const MICROS: Unit = Unit {
    suffix: " µs",
    decimals: 0,
};

/// A decimal number in units of its last digit, with `digits` decimals. Further decimals are ignored.
fn decimal(text: &str, digits: usize) -> Option<u64> {
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
fn number(text: &str, base: u32) -> Option<u32> {
    // The parser of the standard library accepts a sign.
    let are_digits = text.chars().all(|digit| digit.is_digit(base));
    u32::from_str_radix(text, base).ok().filter(|_| are_digits)
}

fn identifier(text: &str, base: u32) -> Result<u32, String> {
    number(text, base).ok_or_else(|| wrong(text, "no identifier"))
}

/// `len` bytes, each a word in this base.
fn data<'a>(words: impl Iterator<Item = &'a str>, len: usize, base: u32) -> Result<Vec<u8>, String> {
    let byte = |word: &str| {
        let byte = number(word, base).and_then(|byte| u8::try_from(byte).ok());
        byte.ok_or_else(|| wrong(word, "no byte"))
    };
    let bytes = words.take(len).map(byte).collect::<Result<Vec<_>, _>>()?;
    match bytes.len() {
        got if got == len => Ok(bytes),
        got => Err(format!("{len} bytes of data were announced, {got} are there")),
    }
}

/// A data frame; `None` if its identifier has 29 bits.
fn frame(id: u32, is_extended: bool, is_fd: bool, data: &[u8]) -> Result<Option<Frame>, String> {
    let max = if is_extended {
        MAX_EXTENDED
    } else {
        Id::MAX.get().into()
    };
    if id > max {
        return Err(format!("identifier {id:X} is out of range (0 to {max:X})"));
    }
    // The length is checked for both kinds of identifier.
    let standard = Id::new(id as u16).unwrap_or(Id::MAX);
    let new = if is_fd { Frame::new_fd } else { Frame::new };
    let frame = new(standard, data).map_err(|error| error.to_string())?;
    Ok((!is_extended).then_some(frame))
}
