//! Log formats of a CAN bus.

pub(super) mod asc;
pub(super) mod blf;
pub(super) mod candump;
pub(super) mod csv;
pub(super) mod gvret;
#[cfg(feature = "recordings")]
pub(super) mod pcap;
pub(super) mod printer;
pub(super) mod trc;

#[cfg(test)]
mod tests;

use armwire_bridge::Instant;
use armwire_bridge::can::{Frame, Id, MAX_CLASSIC};

use super::doubts::{Doubt, Place};
use super::format::Format;
use super::input::Input;
use crate::error::Error;
use asc::Asc;
use candump::Candump;
use csv::Csv;
use gvret::Gvret;
use printer::Printer;
use trc::Trc;

/// The highest 29-bit identifier.
const MAX_EXTENDED: u32 = 0x1FFF_FFFF;

/// A consumer of the records of a log, each with its place.
pub(super) type Take<'a> = dyn FnMut(Place<'_>, Result<Record<'_>, Doubt>) + 'a;

/// Passes each record of a log to `take`. Recordings of a line have no records.
pub(super) fn read(input: &mut Input<'_>, format: Format, take: &mut Take<'_>) -> Result<(), Error> {
    match format {
        Format::Raw
        | Format::Hex
        | Format::Dec
        | Format::Dump
        | Format::DumpBe
        | Format::DumpLe
        | Format::Log
        | Format::Mcap => Ok(()),
        Format::Blf => blf::read(input, take),
        #[cfg(feature = "recordings")]
        Format::Pcap => pcap::read(input, take),
        #[cfg(not(feature = "recordings"))]
        Format::Pcap => Err(Error::at(input.name(), "this build of armwire reads no captures")),
        Format::Candump => read_lines(input, &mut Candump, take),
        Format::Asc => read_lines(input, &mut Asc::new(), take),
        Format::Trc => read_lines(input, &mut Trc::default(), take),
        Format::Csv => read_lines(input, &mut Csv, take),
        Format::Gvret => read_lines(input, &mut Gvret::default(), take),
        Format::Printer => read_lines(input, &mut Printer, take),
    }
}

/// Passes each record of a log with one record per line to `take`.
fn read_lines(input: &mut Input<'_>, log: &mut dyn TextLog, take: &mut Take<'_>) -> Result<(), Error> {
    while let Some(line) = input.line()? {
        let place = Place::Line(line.number, &line.text);
        // A file system may fill the end of a log with them when the power fails.
        let text = line.text.trim_matches('\0');
        if text.len() < line.text.len() {
            take(place, Err("NUL bytes".into()));
        }
        if text.trim().is_empty() {
            continue;
        }
        let record = match log.record(text) {
            // The missing end may change its meaning.
            Ok(Record::Frame(_)) | Err(_) if !line.is_whole => Err("the line is too long".into()),
            Ok(Record::Other) | Err(_) if !line.is_ended => Err(Doubt::cut()),
            record => record,
        };
        take(place, record);
    }
    Ok(())
}

/// A format with one record per line.
pub(super) trait TextLog {
    /// Parses a line that is not blank.
    fn record<'a>(&mut self, line: &'a str) -> Result<Record<'a>, Doubt>;
}

/// One record of a log.
#[derive(Debug, PartialEq)]
pub(super) enum Record<'a> {
    Frame(Logged<'a>),
    /// An event without a frame.
    Other,
    /// Frames that the logging program lost.
    Dropped(u64),
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
    /// Number of bytes at the end of the frame that the log lacks. They are 0 in `frame`.
    pub(super) lacking: usize,
}

impl<'a> Logged<'a> {
    /// A frame with all of its data.
    fn whole(time: Time<'a>, bus: &'a str, frame: Option<Frame>) -> Self {
        Self {
            time,
            bus,
            frame,
            lacking: 0,
        }
    }
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
fn time<'a>(text: &'a str, unit: Unit) -> Result<Time<'a>, Doubt> {
    let micros = decimal(text, unit.decimals).ok_or_else(|| Doubt::word(text, "no time"))?;
    Ok(Time {
        at: Instant::from_micros(micros),
        stamp: text,
        unit: unit.suffix,
    })
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

fn identifier(text: &str, base: u32) -> Result<u32, Doubt> {
    number(text, base).ok_or_else(|| Doubt::word(text, "no identifier"))
}

/// `len` bytes, each a word in this base.
fn data<'a>(words: impl Iterator<Item = &'a str>, len: usize, base: u32) -> Result<Vec<u8>, Doubt> {
    let byte = |word: &str| byte(word, base).ok_or_else(|| Doubt::word(word, "no byte"));
    let bytes = words.take(len).map(byte).collect::<Result<Vec<_>, _>>()?;
    match bytes.len() {
        there if there == len => Ok(bytes),
        there => Err(Doubt::short(len, there)),
    }
}

/// A byte in this base.
fn byte(word: &str, base: u32) -> Option<u8> {
    number(word, base).and_then(|byte| u8::try_from(byte).ok())
}

/// A data frame; `None` if its identifier has 29 bits. More than 8 bytes are those of an FD frame in any case: some
/// programs write no other sign of it.
fn frame(id: u32, is_extended: bool, is_fd: bool, data: &[u8]) -> Result<Option<Frame>, Doubt> {
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
