//! Detection of a recording's format from its first bytes.

#[cfg(feature = "recordings")]
use super::capture;
use super::content::{Content, content, first_line, is_ended, lines};
use super::format::Format;
use super::input::{BYTE_ORDER_MARK, Head};
use super::lines::LineReader;
use super::log::candump::{self, Candump};
use super::log::{blf, csv, gvret, printer};
use super::text::{decimal, dump, logged, time};
use super::unit::Unit;
use crate::error::Error;
use crate::hex;

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
/// First bytes of files that are not read, with the reason.
const REFUSED: [(&[u8], &str); 22] = [
    (
        b"SQLite format 3\0",
        "an SQLite database: 'python -m can.logconvert FILE OUT.log' converts that of python-can, 'ros2 bag convert' that \
         of ROS 2",
    ),
    (b"MDF     ", MDF),
    (b"UnFinMF ", MDF),
    (b"#ROSBAG V2.0\n", "a bag of ROS 1: 'rosbags-convert' converts it"),
    (
        b"PAR1",
        "a Parquet file, as of a LeRobot data set: tools/lerobot_to_mcap.py of the repository converts one to MCAP",
    ),
    (
        b"btsnoop\0",
        "a Bluetooth HCI log (btsnoop): 'tshark -r FILE -Y btspp -T fields -e btspp.data' prints the bytes of a serial port",
    ),
    (
        b"<SALEAE>",
        "a binary export of Saleae Logic: export the table of the serial analyser as CSV",
    ),
    (b"snoop\0\0\0", NETWORK),
    (b"GMBU", NETWORK),
    (
        b"\x89HDF\r\n\x1A\n",
        "an HDF5 file: export its bytes as text, or as they are",
    ),
    (
        b"\x93NUMPY",
        "an array of NumPy: 'array.tofile(\"OUT\")' writes its bytes as they are",
    ),
    (
        b"ARROW1",
        "a file of Apache Arrow: export its bytes as text, or as they are",
    ),
    (
        b"\xD0\xCF\x11\xE0",
        "a document of an older Office: save the table as CSV",
    ),
    (b"\xFD7zXZ\0", "compressed by xz: decompress it by 'xz -d'"),
    (b"BZh", "compressed by bzip2: decompress it by 'bzip2 -d'"),
    (b"\x04\x22\x4D\x18", "compressed by lz4: decompress it by 'lz4 -d'"),
    (
        b"PK\x03\x04",
        "a ZIP archive: unpack it; of a capture of Saleae Logic (.sal) or sigrok (.sr), export the bytes of the serial \
         decoder as CSV or text; of a spreadsheet, save the table as CSV",
    ),
    (b"7z\xBC\xAF\x27\x1C", "a 7z archive: unpack it"),
    (b"Rar!\x1A\x07", "a RAR archive: unpack it"),
    (b"{\\rtf1", "rich text: save it as plain text"),
    (b"%PDF-", "a PDF file: copy the text"),
    (b"\x89PNG\r\n", "a picture: copy the text"),
];
const NETWORK: &str = "a capture of a network: 'tshark -X lua_script:tools/wireshark/armwire.lua -r FILE' shows an xArm's \
                       frames in it";
const MDF: &str = "an ASAM MDF file: 'python -m can.logconvert FILE OUT.log' of python-can converts MF4";

/// Detects the format. Reads as much as needed.
pub(super) fn detect(head: &mut Head<'_>) -> Result<Format, Error> {
    let mut is_all = false;
    loop {
        if let Some((_, reason)) = REFUSED.into_iter().find(|(mark, _)| head.bytes().starts_with(mark)) {
            return Err(head.refused(reason));
        }
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

/// The order of the bytes in a hex dump. Reads as much as needed.
pub(super) fn dump_order(head: &mut Head<'_>) -> Result<dump::Order, Error> {
    let mut is_all = false;
    loop {
        let text = head.bytes().strip_prefix(BYTE_ORDER_MARK).unwrap_or(head.bytes());
        let text = String::from_utf8_lossy(text);
        match dump::order((1..).zip(ended_lines(&text, is_all)), is_all) {
            Ok(Some(order)) => return Ok(order),
            Ok(None) => is_all = !head.read_more()?,
            Err((number, line, reason)) => return Err(head.refused_line(number, &line, &reason)),
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
    for signature in capture::SIGNATURES {
        if bytes.starts_with(signature) {
            return Some(Some(Format::Pcap));
        }
        if may_become(signature) {
            return Some(None);
        }
    }
    let may_be_refused = REFUSED.iter().any(|(mark, _)| may_become(mark));
    if may_be_refused || may_become(blf::SIGNATURE) || may_become(MCAP) || may_become(BYTE_ORDER_MARK) {
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
    if is_whole_line && matches!(Candump.line(&line), Ok(Unit::Can(_))) {
        return Some(Some(Format::Candump));
    }
    // Each frame has a byte that no text has: AA for ling, ED for alpha1, 00 for xarm.
    // No more than the first line: the verdict must not depend on the size of reads.
    match content(first_line(text).1, is_all) {
        Content::Text => {}
        Content::Raw => return Some(Some(Format::Raw)),
        Content::Unknown => return Some(None),
    }
    match line.bytes().next() {
        _ if !is_whole_line => Some(None),
        // An empty recording has no frames in any format.
        None => Some(is_all.then_some(Format::Hex)),
        // A line of candump may be damaged.
        Some(b'(') if candump::names_interface(&line) => Some(Some(Format::Candump)),
        Some(_) => None,
    }
}

/// The verdict on text that is no log of a CAN bus, by its first line that has bytes, and the line behind it.
fn judge_lines(text: &[u8], is_all: bool) -> Verdict {
    let text = String::from_utf8_lossy(text);
    let ended = ended_lines(&text, is_all);
    let mut lines = (1..).zip(ended).filter(|(_, line)| !line.trim().is_empty());
    let mut log = logged::Log::default();
    let mut first = None;
    let mut has_small_numbers = false;
    while let Some((number, line)) = lines.next() {
        let next = lines.clone().next().map(|(_, line)| line);
        let is_first = first.is_none();
        first.get_or_insert((number, line));
        // A heading, or the command, may be before a log.
        if matches!(Candump.line(line.trim()), Ok(Unit::Can(_))) {
            return Verdict::Format(Format::Candump);
        }
        match judge_line(line, &mut log) {
            Column::Offset => return Verdict::Format(Format::Dump),
            Column::OffsetOr(other) => match next {
                Some(next) if dump::follows(line, next) => return Verdict::Format(Format::Dump),
                Some(next) if dump::columns(next).is_none() => return Verdict::Format(other),
                // The next line decides.
                None if !is_all => return Verdict::Unknown,
                _ => return Verdict::Refused(number, line.to_owned(), OFFSET_OR_BYTES.to_owned()),
            },
            Column::Ruler | Column::Nothing => {}
            Column::TimeOrBytes => return Verdict::Refused(number, line.to_owned(), TIME_OR_BYTES.to_owned()),
            Column::Decimal => return Verdict::Format(Format::Dec),
            Column::SmallNumbers => has_small_numbers = true,
            Column::Bytes if is_first => return Verdict::Format(Format::Hex),
            Column::Bytes | Column::Logged => return Verdict::Format(Format::Log),
            Column::Refused(reason) => return Verdict::Refused(number, line.to_owned(), reason),
        }
    }
    match first.filter(|_| is_all) {
        Some((number, line)) if has_small_numbers => {
            Verdict::Refused(number, line.to_owned(), DECIMAL_OR_BYTES.to_owned())
        }
        Some((number, line)) if begins_with_digits(line.trim()) => match hex::parse(line) {
            Ok(_) => Verdict::Unknown,
            Err(error) => Verdict::Refused(number, line.to_owned(), not_bytes(&error.word)),
        },
        _ => Verdict::Unknown,
    }
}

/// The lines of a text up to one that may go on.
fn ended_lines(text: &str, is_all: bool) -> impl Iterator<Item = &str> + Clone {
    let lines = lines(text.as_bytes()).filter(move |line| is_all || is_ended(line));
    // The ends are characters: a part between them is UTF-8.
    lines.map(|line| std::str::from_utf8(line).unwrap_or_default())
}

fn not_bytes(word: &str) -> String {
    format!("'{word}' is not a byte or bytes in hexadecimal")
}

const OFFSET_OR_BYTES: &str = "the first word may be an offset (--format dump) or bytes (--format hex)";
const TIME_OR_BYTES: &str = "the first word may be a time or a date (--format log) or bytes (--format hex)";

const DECIMAL_OR_BYTES: &str = "the numbers may be decimal (--format dec) or bytes in hexadecimal (--format hex)";

/// The beginning of a line.
enum Column {
    /// An offset.
    Offset,
    /// An offset, or what a line of this format has.
    OffsetOr(Format),
    TimeOrBytes,
    /// The numbers of the columns of a dump.
    Ruler,
    /// Decimal numbers, one of which has three digits.
    Decimal,
    /// Decimal numbers of one or two digits.
    SmallNumbers,
    Bytes,
    /// A prefix, with bytes behind it.
    Logged,
    /// The bytes cannot be told apart from the prefix, for this reason.
    Refused(String),
    /// The line has no bytes.
    Nothing,
}

fn judge_line(line: &str, log: &mut logged::Log) -> Column {
    let plain = logged::without_escapes(line);
    if dump::is_ruler(line) {
        return Column::Ruler;
    }
    if is_intel_hex(line.trim()) {
        return Column::Refused(INTEL_HEX.to_owned());
    }
    let has_digits = line.contains(|character: char| character.is_ascii_hexdigit());
    let are_bytes = has_digits && line.split([' ', '\t', ',', ':', '-', '\r', '\n']).all(is_bytes);
    if let Some(dump::Line::Data(row)) = dump::columns(&plain)
        && !row.words.is_empty()
    {
        let offset = row.offset;
        let are_zeros = offset.bytes().all(|digit| digit == b'0');
        // An offset is longer than the words behind it, except for long groups.
        let is_long = offset.len() >= MIN_OFFSET.0;
        match (row.has_colon || row.has_column(), offset.len() % 2) {
            (true, _) if is_long || row.has_column() => return Column::Offset,
            (true, _) => return Column::OffsetOr(Format::Hex),
            (false, 1) if are_zeros => return Column::Offset,
            // The first offset may be short.
            (false, _) if offset.len() < MIN_OFFSET.1 && !are_zeros => {}
            (false, _) if are_bytes && row.widest() < offset.len() => return Column::OffsetOr(Format::Hex),
            (false, 1) => return Column::OffsetOr(Format::Log),
            (false, _) => {}
        }
    }
    if are_bytes {
        return match time::behind_times(line) {
            _ if time::begins_with_time_or_bytes(line) => Column::TimeOrBytes,
            Some(_) => Column::Logged,
            None => Column::Bytes,
        };
    }
    let words = || line.split([' ', '\t', ',', ';', '\r', '\n']);
    match (decimal(line), log.find(line)) {
        // Bytes of a list.
        (_, Ok(Some(_))) => Column::Logged,
        (Some(_), _) if words().any(|word| word.len() == 3) => Column::Decimal,
        (Some(_), _) => Column::SmallNumbers,
        (None, Ok(None)) => Column::Nothing,
        (None, Err(doubt)) => Column::Refused(doubt.text),
    }
}

/// The shortest offset that is no byte, with a colon, and without one if it is not 0, in digits.
const MIN_OFFSET: (usize, usize) = (4, 6);

const INTEL_HEX: &str = "a record of Intel HEX: 'objcopy -I ihex -O binary' converts it";

/// Returns true for a record of Intel HEX: a colon, and bytes whose sum is 0.
fn is_intel_hex(line: &str) -> bool {
    const MIN_RECORD: usize = 5;
    let bytes = line.strip_prefix(':').and_then(|digits| hex::parse(digits).ok());
    bytes.is_some_and(|bytes| {
        bytes.len() >= MIN_RECORD
            && usize::from(bytes[0]) == bytes.len() - MIN_RECORD
            && bytes.iter().fold(0, |sum: u8, byte| sum.wrapping_add(*byte)) == 0
    })
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
