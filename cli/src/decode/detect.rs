//! Detection of a recording's format from its first bytes.

use super::format::Format;
use super::input::{BYTE_ORDER_MARK, Head};
use super::log::candump::Candump;
#[cfg(feature = "recordings")]
use super::log::pcap;
use super::log::{Record, TextLog, blf, csv, gvret, printer};
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
            Some(format) => return Ok(format),
            None if is_all => {
                let (number, line, _) = first_line(head.bytes());
                let line = String::from_utf8_lossy(line);
                return Err(head.refused_line(number, &line, "no format that can be decoded, see --format"));
            }
            None => is_all = !head.read_more()?,
        }
    }
}

/// The format of a recording with these first bytes. `None` if more bytes are needed or, if these are all, if the
/// format is unknown.
fn judge(bytes: &[u8], is_all: bool) -> Option<Format> {
    let may_become = |beginning: &[u8]| !is_all && beginning.starts_with(bytes);
    if bytes.starts_with(blf::SIGNATURE) {
        return Some(Format::Blf);
    }
    if bytes.starts_with(MCAP) {
        return Some(Format::Mcap);
    }
    #[cfg(feature = "recordings")]
    if pcap::SIGNATURES.iter().any(|signature| bytes.starts_with(signature)) {
        return Some(Format::Pcap);
    }
    #[cfg(feature = "recordings")]
    if pcap::SIGNATURES.iter().any(|signature| may_become(signature)) {
        return None;
    }
    if may_become(blf::SIGNATURE) || may_become(MCAP) || may_become(BYTE_ORDER_MARK) {
        return None;
    }
    let text = bytes.strip_prefix(BYTE_ORDER_MARK).unwrap_or(bytes);
    let (_, line, is_ended) = first_line(text);
    let is_whole_line = is_all || is_ended;
    let line = String::from_utf8_lossy(line).trim().to_owned();
    // These formats may contain text of any language.
    if let Some(format) = judge_beginning(&line) {
        return Some(format);
    }
    if is_whole_line && matches!(Candump.record(&line), Ok(Record::Frame(_))) {
        return Some(Format::Candump);
    }
    // Each frame has a byte that no text has: AA for ling, ED for alpha1, 00 for xarm.
    if !text.is_ascii() || text.contains(&0) {
        return Some(Format::Raw);
    }
    match line.bytes().next() {
        _ if !is_whole_line => None,
        // An empty recording has no frames in any format.
        None => is_all.then_some(Format::Hex),
        Some(b'(') => Some(Format::Candump),
        Some(_) if begins_with_digits(&line) => Some(Format::Hex),
        Some(_) => None,
    }
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
    let word = line.split([' ', '\t', ',', ':']).next().unwrap_or_default();
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
