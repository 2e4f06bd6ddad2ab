//! Logs of can-utils: `candump -L`, and the output of `candump` without it.

use armwire_bridge::Instant;
use armwire_bridge::can::{Frame, MAX_CLASSIC};

use super::{
    Doubt, LineReader, Logged, Read, SECONDS, Time, Unit, byte, data, decimal, frame, identifier, number, time,
};
use crate::hex;

/// The beginning of a line about frames that candump lost.
const DROPPED: &str = "DROPCOUNT: dropped ";

/// Details of an error frame, in lines of their own with a tab before them. Some have more behind them in braces.
const DETAILS: [&str; 10] = [
    "tx-timeout",
    "lost-arbitration",
    "controller-problem",
    "protocol-violation",
    "transceiver-status",
    "no-acknowledgement-on-tx",
    "bus-off",
    "bus-error",
    "restarted-after-bus-off",
    "error-counter-tx-rx",
];

/// A parser of both forms:
///
/// ```text
/// (1609459200.123456) can0 60F#07AA060001FE9AFF
///  (1609459200.123456)  can0  60F   [8]  07 AA 06 00 01 FE 9A FF
/// ```
///
/// and of frames for cansend, `cansend can0 60F#07AA060001FE9AFF`.
pub(in crate::decode) struct Candump;

impl LineReader for Candump {
    fn line<'a>(&mut self, line: &'a str) -> Read<'a> {
        if let Some(detail) = line.strip_prefix('\t')
            && DETAILS.contains(&detail.split('{').next().unwrap_or_default().trim_end())
        {
            return Ok(Unit::Comment);
        }
        if let Some(dropped) = line.strip_prefix(DROPPED) {
            let word = dropped.split_whitespace().next().unwrap_or_default();
            let frames = word.parse().map_err(|_| Doubt::word(word, "no number of frames"))?;
            return Ok(Unit::Dropped(frames));
        }
        let (time, line) = split_time(line.trim())?;
        let mut words = line.split_whitespace();
        let first = words.next().ok_or_else(|| Doubt::missing("interface"))?;
        let (bus, first) = match first.split_once('#') {
            // As cansend takes it.
            Some(_) => ("", Some(first)),
            None if first == "cansend" => (words.next().unwrap_or_default(), words.next()),
            None => (first, words.next()),
        };
        let first = first.ok_or_else(|| Doubt::missing("identifier"))?;
        let content = match first.split_once('#') {
            Some((id, data)) => logged(id, data)?,
            None => printed(first, words)?,
        };
        Ok(match content {
            Content::Frame(frame) => Unit::Can(Logged::whole(time, bus, frame)),
            Content::Xl => Unit::Other("CAN XL frames"),
        })
    }

    /// Only the data of `60F#07AA` have no length before them. A classic frame has at most 8 bytes.
    fn may_go_on(&self, line: &str) -> bool {
        let Some((_, data)) = line.split_once('#') else {
            return false;
        };
        let data = data.trim_end();
        // Flags are behind a whole frame.
        let is_last = !data.contains(' ');
        is_last && (data.starts_with('#') || pairs(data).is_ok_and(|data| data.len() < MAX_CLASSIC))
    }
}

/// The content of a line.
enum Content {
    /// `None` for a frame that adapters do not use.
    Frame(Option<Frame>),
    /// A CAN XL frame.
    Xl,
}

/// Returns true if a line begins with a time and the name of an interface, such as `can0`, or has an identifier and a
/// number sign behind it.
pub(in crate::decode) fn names_interface(line: &str) -> bool {
    let Ok((_, rest)) = split_time(line) else {
        return false;
    };
    let mut words = rest.split_whitespace();
    let name = words.next().unwrap_or_default();
    let kind = name.trim_end_matches(|character: char| character.is_ascii_digit());
    let is_name = kind.len() < name.len() && !kind.is_empty() && kind.bytes().all(|byte| byte.is_ascii_alphabetic());
    let id = words.next().and_then(|word| word.split_once('#')).map(|(id, _)| id);
    is_name || id.is_some_and(|id| split_id(id).is_ok())
}

/// The time in parentheses, if there is one, and the rest of the line.
fn split_time(line: &str) -> Result<(Time<'_>, &str), Doubt> {
    let Some(line) = line.strip_prefix('(') else {
        return Ok((Time::seconds(Instant::ZERO, ""), line));
    };
    let (stamp, line) = line.split_once(')').ok_or("no time in parentheses")?;
    let time = match stamp.split_once(' ') {
        Some((date, clock)) => {
            let at = date_time(date, clock).ok_or_else(|| Doubt::word(stamp, "no time"))?;
            Time::seconds(at, stamp)
        }
        None => time(stamp, SECONDS)?,
    };
    Ok((time, line))
}

/// `2021-01-01` and `00:00:00.123456`.
fn date_time(date: &str, clock: &str) -> Option<Instant> {
    let part = |text: Option<&str>, max| number(text?, 10).filter(|part| *part <= max).map(u64::from);
    let (clock, fraction) = clock.split_once('.')?;
    let (mut date, mut clock) = (date.split('-'), clock.split(':'));
    let year = part(date.next(), 9999)?.checked_sub(1)?;
    let month = part(date.next(), 12)?.checked_sub(1)?;
    let day = part(date.next(), 31)?.checked_sub(1)?;
    let hour = part(clock.next(), 23)?;
    let minute = part(clock.next(), 59)?;
    let second = part(clock.next(), 60)?;
    if date.next().is_some() || clock.next().is_some() {
        return None;
    }
    // Days since a first of March: the leap day is the last day of such a year.
    let (year, month) = if month < 2 {
        (year, month + 10)
    } else {
        (year + 1, month - 2)
    };
    let days = 365 * year + year / 4 - year / 100 + year / 400 + (153 * month + 2) / 5 + day;
    let micros = decimal(
        &format!("{}.{fraction}", ((days * 24 + hour) * 60 + minute) * 60 + second),
        6,
    )?;
    Some(Instant::from_micros(micros))
}

/// `123#AA06`, `123#R`, `123##` with a digit of flags for FD, and `123###` with the header of CAN XL.
fn logged(id: &str, data: &str) -> Result<Content, Doubt> {
    let (id, is_extended) = split_id(id)?;
    if data.starts_with("##") {
        return Ok(Content::Xl);
    }
    if let Some(fd) = data.strip_prefix('#') {
        let (flags, data) = fd.split_at_checked(1).ok_or("no flags of an FD frame")?;
        number(flags, 16).ok_or("no flags of an FD frame")?;
        return frame(id, is_extended, true, &pairs(data)?).map(Content::Frame);
    }
    // Newer versions append a length code above 8 to frames of 8 bytes.
    let data = data.split_once('_').map_or(data, |(data, _)| data);
    match data.starts_with('R') {
        true => Ok(Content::Frame(None)),
        false => frame(id, is_extended, false, &pairs(data)?).map(Content::Frame),
    }
}

/// `123   [2]  AA 06`, and `123  [02]  AA 06` for FD. With `-x` more columns precede the identifier, with `-8` a length
/// code above 8 is in braces, and CAN XL has a length of four digits.
fn printed<'a>(first: &'a str, mut words: impl Iterator<Item = &'a str>) -> Result<Content, Doubt> {
    let id = match first {
        "RX" | "TX" => words.nth(2).ok_or_else(|| Doubt::missing("identifier"))?,
        id => id,
    };
    let (id, is_extended) = split_id(id)?;
    let length = words.next().ok_or_else(|| Doubt::missing("length in brackets"))?;
    let between = |open, close| length.strip_prefix(open)?.strip_suffix(close);
    let (len, is_fd) = match (between('[', ']'), between('{', '}')) {
        (Some(digits), _) if digits.len() == 4 => return Ok(Content::Xl),
        (Some(digits), _) => (number(digits, 10), digits.len() > 1),
        (None, Some(code)) => (number(code, 16).map(|code| code.min(8)), false),
        (None, None) => return Err(Doubt::missing("length in brackets")),
    };
    let len = len.ok_or_else(|| Doubt::word(length, "no length"))? as usize;
    let mut words = words.peekable();
    if words.peek() == Some(&"remote") {
        return Ok(Content::Frame(None));
    }
    frame(id, is_extended, is_fd, &printed_data(words, len)?).map(Content::Frame)
}

/// Data as `AA 06`; with `-S` in the other order as 06`AA, and with `-i` in binary digits.
fn printed_data<'a>(words: impl Iterator<Item = &'a str>, len: usize) -> Result<Vec<u8>, Doubt> {
    /// Between swapped bytes.
    const SWAPPED: char = '`';
    let mut words = words.peekable();
    let swapped = words.next_if(|word| word.contains(SWAPPED));
    let (words, is_swapped): (Vec<_>, _) = match swapped {
        Some(word) => (word.split(SWAPPED).collect(), true),
        None => (words.take(len).collect(), false),
    };
    let is_binary = words.iter().all(|word| word.len() == 8 && byte(word, 2).is_some());
    let mut bytes = data(words.into_iter(), len, if is_binary { 2 } else { 16 })?;
    if is_swapped {
        bytes.reverse();
    }
    Ok(bytes)
}

/// The identifier: 3 digits, or 8 for 29 bits and for error frames.
fn split_id(text: &str) -> Result<(u32, bool), Doubt> {
    /// The bit for error frames.
    const ERROR: u32 = 0x2000_0000;
    let id = identifier(text, 16)?;
    match text.len() {
        3 => Ok((id, false)),
        8 => Ok((id & !ERROR, true)),
        _ => Err(Doubt::word(text, "no identifier of 3 or 8 digits")),
    }
}

fn pairs(text: &str) -> Result<Vec<u8>, Doubt> {
    // Bytes may be separated by dots.
    let text = text.replace('.', "");
    hex::parse(&text).map_err(|error| Doubt::word(&error.word, "not bytes in hexadecimal"))
}
