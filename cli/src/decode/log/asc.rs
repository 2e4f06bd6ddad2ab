//! Vector's ASCII log, ASC, of CANalyzer, CANoe and others.

use armwire_bridge::can::{FD_LENGTHS, Frame, MAX_CLASSIC};
use armwire_bridge::{Duration, Instant};

use super::{Doubt, LineReader, Logged, Read, SECONDS, Time, Unit, byte, data, frame, identifier, number, time};

/// First words of lines in the header and between measurements, in lower case, with the one behind it if it has to be
/// there. Kvaser's programs write a heading behind a semicolon.
const HEADINGS: [(&str, Option<&str>); 9] = [
    ("date", None),
    ("base", None),
    ("internal", Some("events")),
    ("no", Some("internal")),
    ("begin", Some("triggerblock")),
    ("end", Some("triggerblock")),
    ("previous", Some("log")),
    ("//", None),
    (";", None),
];
/// First words of other events behind their time, in lower case, with the one behind it if it has to be there. A colon
/// belongs to the word.
///
/// The first rows are those of Vector's *CAN, Log & Trigger ASC Logging Format Specification*, version 1.4.6, 3.5 to
/// 3.12, and the start of a measurement, which it does not describe. The last row is of other buses, by the types of
/// events in Vector_ASC of T. Lorenz: LIN, FlexRay, Ethernet, AFDX.
const EVENTS: [(&str, Option<&str>); 12] = [
    ("start", None),
    ("log", None),
    ("sv:", None),
    ("gps", Some("device:")),
    ("gps-device:", None),
    ("comment:", None),
    ("tfs:", None),
    ("can", None),
    ("li", None),
    ("fr", None),
    ("eth", None),
    ("afdx", None),
];
/// Words of events behind the number of a bus, of which CAN FD has its own lines: 3.3 of the same document, and J1939.
const BUS_EVENTS: [&str; 4] = ["statistic:", "overloadframe", "status:", "j1939tp"];
/// A word in the line of a global marker, behind its type and colours: 3.11.
const MARKER: &str = "GMGroup:";
/// The mark between the parts of a signal's name: 3.8.
const SIGNAL: &str = "::";
/// A statistic, a variable, a transmit request, and the like.
const EVENT: Unit<'static> = Unit::Other("other events");
/// The flag of a `CANFD` line whose frame is an FD frame.
const EXTENDED_DATA_LENGTH: u32 = 1 << 12;

/// A parser of ASC logs:
///
/// ```text
/// base hex  timestamps absolute
///    0.001000 1  60F             Rx   d 8 07 AA 06 00 01 FE 9A FF
///    0.002000 CANFD   1 Rx   60F  0 0 8  8 07 AA 06 00 01 FE 9A FF
/// ```
pub(in crate::decode) struct Asc {
    /// Base of identifiers and data.
    base: u32,
    /// True if times are relative to the event before.
    is_relative: bool,
    now: Instant,
}

impl Asc {
    pub(in crate::decode) fn new() -> Self {
        Self {
            base: 16,
            is_relative: false,
            now: Instant::ZERO,
        }
    }

    fn read_heading(&mut self, line: &str) -> Read<'static> {
        let line = line.to_ascii_lowercase();
        let mut words = line.split_whitespace();
        let (first, second) = (words.next().unwrap_or_default(), words.next());
        let is_heading = |(word, next): &(&str, Option<&str>)| {
            let is_comment = matches!(*word, "//" | ";") && first.starts_with(word);
            is_comment || first == *word && (next.is_none() || *next == second)
        };
        if !HEADINGS.iter().any(is_heading) {
            return Err("no time".into());
        }
        let mut words = line.split_whitespace();
        if words.next() == Some("base") {
            self.base = match words.next() {
                Some("hex") => 16,
                Some("dec") => 10,
                _ => return Err("the base is neither hex nor dec".into()),
            };
            self.is_relative = words.any(|word| word == "relative");
        }
        Ok(Unit::Comment)
    }

    /// Advances the clock of the log.
    fn tick<'a>(&mut self, stamp: &'a str) -> Result<Time<'a>, Doubt> {
        let time = time(stamp, SECONDS)?;
        self.now = match self.is_relative {
            true => self.now + Duration::from_micros(time.at.as_micros()),
            false => time.at,
        };
        Ok(Time { at: self.now, ..time })
    }

    /// `1  60F  Rx  d 8 07 AA ...`, from the kind of frame on.
    fn classic<'a>(&self, id: &str, mut words: impl Iterator<Item = &'a str>) -> Result<Option<Frame>, Doubt> {
        let (id, is_extended) = self.split_id(id)?;
        match words.next() {
            Some("d" | "D") => {}
            Some("r" | "R") => return Ok(None),
            _ => return Err("neither data (d) nor a remote frame (r)".into()),
        }
        let length = words.next().ok_or_else(|| Doubt::missing("length of the data"))?;
        let words: Vec<_> = words.take_while(|word| byte(word, self.base).is_some()).collect();
        let len = self.classic_length(length, words.len());
        let len = len.ok_or_else(|| Doubt::word(length, "no length"))?;
        let data = data(words.into_iter(), len, self.base)?;
        frame(id, is_extended, false, &data)
    }

    /// The number of bytes of a frame with this length and `there` bytes of data. A classic frame has at most 8 bytes,
    /// also if its length code is higher. Some programs write FD frames in this form, with the length or its code.
    fn classic_length(&self, length: &str, there: usize) -> Option<usize> {
        let code = number(length, 16)? as usize;
        let of_code = FD_LENGTHS.get(code).map_or(code, |&len| len.into());
        let lengths = [Some(of_code), number(length, 10).map(|len| len as usize)];
        match there {
            _ if code <= MAX_CLASSIC => Some(code),
            0..=MAX_CLASSIC => Some(MAX_CLASSIC),
            _ if lengths.contains(&Some(there)) => Some(there),
            _ => Some(MAX_CLASSIC),
        }
    }

    /// `Rx 60F Name 0 0 8 8 07 AA ...`, from the name on.
    fn fd<'a>(&self, id: &str, words: impl Iterator<Item = &'a str>) -> Result<Option<Frame>, Doubt> {
        let (id, is_extended) = self.split_id(id)?;
        let mut words = words.peekable();
        // An optional message name precedes the bit for the rate.
        if words.peek().is_some_and(|word| !matches!(*word, "0" | "1")) {
            words.next();
        }
        let mut field = |what: &str, base| {
            let field = words.next().and_then(|word| number(word, base));
            field.ok_or_else(|| Doubt::missing(what))
        };
        field("bit for the rate", 2)?;
        field("bit for the error state", 2)?;
        field("length code", 16)?;
        let len = field("length of the data", 10)? as usize;
        let data = data(&mut words, len, self.base)?;
        // The flags follow the frame's duration and its length in bits.
        let flags = words.nth(2).and_then(|word| number(word, 16));
        let is_fd = flags.is_none_or(|flags| flags & EXTENDED_DATA_LENGTH != 0);
        frame(id, is_extended, is_fd, &data)
    }

    fn split_id(&self, text: &str) -> Result<(u32, bool), Doubt> {
        let short = text.strip_suffix(['x', 'X']);
        let id = identifier(short.unwrap_or(text), self.base)?;
        Ok((id, short.is_some()))
    }
}

impl LineReader for Asc {
    fn line<'a>(&mut self, line: &'a str) -> Read<'a> {
        let line = line.trim();
        if !line.starts_with(|character: char| character.is_ascii_digit()) {
            return self.read_heading(line);
        }
        let mut words = line.split_whitespace();
        let time = self.tick(words.next().unwrap_or_default())?;
        let (bus, direction, id, is_fd) = match (words.next(), words.next()) {
            (Some("CANFD"), Some(bus)) => (
                bus,
                words.next(),
                words.next().ok_or_else(|| Doubt::missing("identifier"))?,
                true,
            ),
            (Some(bus), Some(id)) if number(bus, 10).is_some() => (bus, words.next(), id, false),
            // A variable of the environment.
            (Some(_), Some(":=")) => return Ok(EVENT),
            (Some(first), second) if is_event(first, second) || has_name_of_event(line) => return Ok(EVENT),
            _ => return Err("no known event".into()),
        };
        let is_error = id.eq_ignore_ascii_case("ErrorFrame");
        // Only lines of classic error frames have no direction.
        if !direction.is_some_and(is_direction) && (is_fd || !is_error) {
            let is_request = direction.is_some_and(|word| word.eq_ignore_ascii_case("TxRq"));
            let named = if is_fd { direction.unwrap_or_default() } else { id };
            let is_event = BUS_EVENTS.iter().any(|event| begins(named, event));
            return match is_request || is_event || has_name_of_event(line) {
                true => Ok(EVENT),
                false => Err("neither received (Rx) nor sent (Tx)".into()),
            };
        }
        let frame = match (is_error, is_fd) {
            (true, _) => None,
            (false, true) => self.fd(id, words)?,
            (false, false) => self.classic(id, words)?,
        };
        Ok(Unit::Can(Logged::whole(time, bus, frame)))
    }
}

/// Returns true for the first words of an event.
fn is_event(first: &str, second: Option<&str>) -> bool {
    let is_second = |next: &str| second.is_some_and(|second| second.eq_ignore_ascii_case(next));
    let mut events = EVENTS.iter();
    events.any(|(word, next)| first.eq_ignore_ascii_case(word) && next.is_none_or(is_second))
}

/// Returns true for a signal or a global marker, whose first words may be any.
fn has_name_of_event(line: &str) -> bool {
    line.split_whitespace()
        .any(|word| word == MARKER || word.contains(SIGNAL))
}

/// Returns true if a word begins with these characters, in any case.
fn begins(word: &str, beginning: &str) -> bool {
    word.get(..beginning.len())
        .is_some_and(|front| front.eq_ignore_ascii_case(beginning))
}

/// Returns true if a frame with this direction was on the bus. A transmit request (`TxRq`) was not.
fn is_direction(word: &str) -> bool {
    word.eq_ignore_ascii_case("Rx") || word.eq_ignore_ascii_case("Tx")
}
