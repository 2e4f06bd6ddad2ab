//! Detection of a recording's format from its first bytes.

use super::format::Format;
use super::input::{BYTE_ORDER_MARK, Head};
use super::log::candump::{self, Candump};
#[cfg(feature = "recordings")]
use super::log::pcap;
use super::log::{Record, TextLog, blf, csv, gvret, printer};
use super::text::{dump, logged};
use crate::error::Error;

/// First characters of text formats, in any case. TRC version 1.0 has a line of number signs.
const BEGINNINGS: [(&str, Format); 7] = [
    ("date ", Format::Asc),
    ("base ", Format::Asc),
    (";$", Format::Trc),
    (";##", Format::Trc),
    (csv::HEADER, Format::Csv),
    (gvret::HEADER, Format::Gvret),
    (printer::BEGINNING, Format::Printer),
];
/// First bytes of an MCAP file.
const MCAP: &[u8] = b"\x89MCAP0\r\n";

/// Detects the format. Reads as much as needed.
pub(super) fn detect(head: &mut Head<'_>) -> Result<Format, Error> {
    let mut is_all = false;
    loop {
        match judge(head.bytes(), is_all) {
            Verdict::Format(format) => return Ok(format),
            Verdict::Refused(number, line, reason) => return Err(head.refused_line(number, &line, &reason)),
            Verdict::Unknown if is_all => {
                let (number, line, _) = first_line(head.bytes());
                let line = String::from_utf8_lossy(line);
                return Err(head.refused_line(number, &line, "no format that can be decoded, see --format"));
            }
            Verdict::Unknown => is_all = !head.read_more()?,
        }
    }
}

/// The verdict on the first bytes of a recording.
enum Verdict {
    Format(Format),
    /// A line with more than one reading: its number, its text, and the reason.
    Refused(u64, String, String),
    /// More bytes are needed or, if these are all, the format is unknown.
    Unknown,
}

impl From<Option<Format>> for Verdict {
    fn from(format: Option<Format>) -> Self {
        format.map_or(Self::Unknown, Self::Format)
    }
}

/// The verdict on a recording with these first bytes.
fn judge(bytes: &[u8], is_all: bool) -> Verdict {
    match judge_marks(bytes, is_all) {
        Some(verdict) => verdict.into(),
        None => judge_lines(bytes.strip_prefix(BYTE_ORDER_MARK).unwrap_or(bytes), is_all),
    }
}

/// The format by the first bytes or the first line; `None` within if more bytes are needed. `None` for text without such
/// a mark.
fn judge_marks(bytes: &[u8], is_all: bool) -> Option<Option<Format>> {
    let may_become = |beginning: &[u8]| !is_all && beginning.starts_with(bytes);
    if bytes.starts_with(blf::SIGNATURE) {
        return Some(Some(Format::Blf));
    }
    if bytes.starts_with(MCAP) {
        return Some(Some(Format::Mcap));
    }
    #[cfg(feature = "recordings")]
    for signature in pcap::SIGNATURES {
        if bytes.starts_with(signature) {
            return Some(Some(Format::Pcap));
        }
        if may_become(signature) {
            return Some(None);
        }
    }
    if may_become(blf::SIGNATURE) || may_become(MCAP) || may_become(BYTE_ORDER_MARK) {
        return Some(None);
    }
    let text = bytes.strip_prefix(BYTE_ORDER_MARK).unwrap_or(bytes);
    let (_, line, is_ended) = first_line(text);
    let is_whole_line = is_all || is_ended;
    let line = String::from_utf8_lossy(line).trim().to_owned();
    // These formats may contain text of any language.
    if let Some(format) = judge_beginning(&line) {
        return Some(Some(format));
    }
    if is_whole_line && matches!(Candump.record(&line), Ok(Record::Frame(_))) {
        return Some(Some(Format::Candump));
    }
    // Each frame has a byte that no text has: AA for ling, ED for alpha1, 00 for xarm.
    if !is_text(text) {
        return Some(Some(Format::Raw));
    }
    match line.bytes().next() {
        _ if !is_whole_line => Some(None),
        // An empty recording has no frames in any format.
        None => Some(is_all.then_some(Format::Hex)),
        // A line of candump may be damaged.
        Some(b'(') if line.contains('#') || candump::names_interface(&line) => Some(Some(Format::Candump)),
        Some(_) => None,
    }
}

/// Returns true for UTF-8 without control characters, up to an incomplete character.
fn is_text(bytes: &[u8]) -> bool {
    let text = match std::str::from_utf8(bytes) {
        Ok(text) => text,
        Err(error) if error.error_len().is_some() => return false,
        Err(error) => std::str::from_utf8(&bytes[..error.valid_up_to()]).unwrap_or_default(),
    };
    !text.contains('\0')
        && (text.is_ascii() || !text.contains(|character: char| character.is_control() && !character.is_whitespace()))
}

/// The verdict on text that is no log of a CAN bus, by its first line that has bytes, and the line behind it.
fn judge_lines(text: &[u8], is_all: bool) -> Verdict {
    let text = String::from_utf8_lossy(text);
    let ended = text.split_inclusive('\n').filter(|line| is_all || line.ends_with('\n'));
    let mut lines = (1..).zip(ended).filter(|(_, line)| !line.trim().is_empty());
    let mut is_first = true;
    while let Some((number, line)) = lines.next() {
        let next = lines.clone().next().map(|(_, line)| line);
        match judge_line(line) {
            Column::Offset => return Verdict::Format(Format::Dump),
            Column::OffsetOr(other) => match next {
                Some(next) if dump::follows(line, next) => return Verdict::Format(Format::Dump),
                Some(next) if dump::columns(next).is_none() => return Verdict::Format(other),
                // The next line decides.
                None if !is_all => return Verdict::Unknown,
                _ => return Verdict::Refused(number, line.to_owned(), OFFSET_OR_BYTES.to_owned()),
            },
            Column::TimeOrBytes => return Verdict::Refused(number, line.to_owned(), TIME_OR_BYTES.to_owned()),
            Column::Bytes if is_first => return Verdict::Format(Format::Hex),
            Column::Bytes | Column::Logged => return Verdict::Format(Format::Log),
            Column::Nothing if is_first && begins_with_digits(line.trim()) => return Verdict::Format(Format::Hex),
            Column::Refused(reason) => return Verdict::Refused(number, line.to_owned(), reason),
            Column::Nothing => {}
        }
        is_first = false;
    }
    Verdict::Unknown
}

const OFFSET_OR_BYTES: &str = "the first word may be an offset (--format dump) or bytes (--format hex)";
const TIME_OR_BYTES: &str = "the first word may be a time or a date (--format log) or bytes (--format hex)";

/// The beginning of a line.
enum Column {
    /// An offset.
    Offset,
    /// An offset, or what a line of this format has.
    OffsetOr(Format),
    TimeOrBytes,
    Bytes,
    /// A prefix, with bytes behind it.
    Logged,
    /// The bytes cannot be told apart from the prefix, for this reason.
    Refused(String),
    /// The line has no bytes.
    Nothing,
}

fn judge_line(line: &str) -> Column {
    let are_bytes = line.split([' ', '\t', ',', ':', '-', '\r', '\n']).all(is_bytes);
    if let Some(dump::Line::Data {
        offset,
        has_colon,
        words,
        ascii,
    }) = dump::columns(line)
        && !words.is_empty()
    {
        let widest = words.iter().map(|word| word.len()).max().unwrap_or_default();
        // An offset is longer than the words behind it, except for long groups.
        match (has_colon, ascii) {
            (true, _) | (_, Some(_)) => return Column::Offset,
            (false, None) if offset.len() % 2 == 1 && offset.bytes().all(|digit| digit == b'0') => {
                return Column::Offset;
            }
            (false, None) if are_bytes && widest < offset.len() => return Column::OffsetOr(Format::Hex),
            (false, None) if offset.len() % 2 == 1 => return Column::OffsetOr(Format::Log),
            (false, None) => {}
        }
    }
    if are_bytes {
        return match logged::begins_with_time_or_bytes(line) {
            true => Column::TimeOrBytes,
            false => Column::Bytes,
        };
    }
    match logged::find(line) {
        Ok(Some(_)) => Column::Logged,
        Ok(None) => Column::Nothing,
        Err(reason) => Column::Refused(reason),
    }
}

/// Returns true for pairs of digits, with or without 0x before them, and for nothing.
fn is_bytes(word: &str) -> bool {
    let digits = word.strip_prefix("0x").or(word.strip_prefix("0X")).unwrap_or(word);
    digits.len().is_multiple_of(2) && digits.bytes().all(|digit| digit.is_ascii_hexdigit())
}

fn judge_beginning(line: &str) -> Option<Format> {
    let begins = |beginning: &str| {
        line.get(..beginning.len())
            .is_some_and(|front| front.eq_ignore_ascii_case(beginning))
    };
    let found = BEGINNINGS.into_iter().find(|(beginning, _)| begins(beginning));
    found.map(|(_, format)| format)
}

/// Returns true if the available part of the first word is hexadecimal digits.
fn begins_with_digits(line: &str) -> bool {
    let word = line.split([' ', '\t', ',', ':', '-']).next().unwrap_or_default();
    let digits = word.strip_prefix("0x").or(word.strip_prefix("0X")).unwrap_or(word);
    !digits.is_empty() && digits.bytes().all(|digit| digit.is_ascii_hexdigit())
}

/// The first line that is not blank, its number, and true if its end was read.
fn first_line(text: &[u8]) -> (u64, &[u8], bool) {
    let is_blank = |line: &[u8]| line.iter().all(u8::is_ascii_whitespace);
    let mut lines = text.split_inclusive(|&byte| byte == b'\n').zip(1..);
    match lines.find(|(line, _)| !is_blank(line)) {
        Some((line, number)) => (number, line, line.ends_with(b"\n")),
        None => (1, &[], false),
    }
}
