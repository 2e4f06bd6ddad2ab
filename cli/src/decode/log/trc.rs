//! PEAK's trace, TRC, of the versions 1.0 to 2.1 (PEAK CAN TRC File Format).

use armwire_bridge::can::{FD_LENGTHS, Frame};

use super::{Doubt, LineReader, Logged, MILLIS, Read, Unit, data, frame, identifier, number, time};

/// A warning, an error, or a status.
const EVENT: Unit<'static> = Unit::Other("other events");
/// Maximum number of columns in a trace.
const MAX_COLUMNS: usize = 16;

/// A parser of such logs:
///
/// ```text
/// ;$FILEVERSION=2.1
/// ;$COLUMNS=N,O,T,B,I,d,R,L,D
///       1      1059.900 DT 1   060F Rx -  8    07 AA 06 00 01 FE 9A FF
/// ```
///
/// or, for version 1.1, which has no columns:
///
/// ```text
/// ;$FILEVERSION=1.1
///      1)      1059.9  Rx         060F  8  07 AA 06 00 01 FE 9A FF
/// ```
#[derive(Default)]
pub(in crate::decode) struct Trc {
    version: Version,
    /// The letters of the columns, since version 2.
    columns: Vec<char>,
}

#[derive(Clone, Copy, Default)]
enum Version {
    #[default]
    V1_0,
    V1_1,
    V1_2,
    V1_3,
    V2,
}

impl Trc {
    fn read_comment(&mut self, comment: &str) -> Read<'static> {
        if let Some(version) = comment.strip_prefix("$FILEVERSION=") {
            self.version = match version.trim() {
                "1.0" => Version::V1_0,
                "1.1" => Version::V1_1,
                "1.2" => Version::V1_2,
                "1.3" => Version::V1_3,
                "2.0" | "2.1" => Version::V2,
                _ => return Err("unsupported version: expected 1.0 to 1.3, 2.0 or 2.1".into()),
            };
        }
        if let Some(columns) = comment.strip_prefix("$COLUMNS=") {
            let columns = columns.trim().split(',').map(|column| match column.as_bytes() {
                [letter] => Some(char::from(*letter)),
                _ => None,
            });
            self.columns = columns.collect::<Option<_>>().ok_or("a column is not one letter")?;
            if self.columns.len() > MAX_COLUMNS {
                return Err("more than 16 columns".into());
            }
        }
        Ok(Unit::Comment)
    }

    /// `1) 1059.9 1 Rx 060F - 8 07 AA ...`, with the fields of this version.
    fn first_version<'a>(&self, line: &'a str) -> Read<'a> {
        let mut words = line.split_whitespace();
        let mut word = |what: &str| words.next().ok_or_else(|| Doubt::missing(what));
        if !word("number")?.ends_with(')') {
            return Err("no number with a parenthesis".into());
        }
        let time = time(word("time")?, MILLIS)?;
        let bus = match self.version {
            Version::V1_2 | Version::V1_3 => word("bus")?,
            _ => "",
        };
        if !matches!(self.version, Version::V1_0) {
            match word("type")? {
                "Rx" | "Tx" => {}
                "Warng" | "Error" => return Ok(EVENT),
                other => return Err(Doubt::word(other, "no type of a message")),
            }
        }
        let id = word("identifier")?;
        // The identifier of a warning in version 1.0.
        if id == "FFFFFFFF" {
            return Ok(EVENT);
        }
        if matches!(self.version, Version::V1_3) {
            word("reserved column")?;
        }
        let len = number(word("length")?, 10).ok_or_else(|| Doubt::missing("length of the data"))?;
        let mut words = words.peekable();
        let frame = match words.peek() {
            Some(&"ERROR") => return Ok(EVENT),
            Some(&"RTR") => None,
            _ => whole_frame(id, false, &data(words, len as usize, 16)?)?,
        };
        Ok(Unit::Can(Logged::whole(time, bus, frame)))
    }

    /// A line with the columns of the header.
    fn second_version<'a>(&self, line: &'a str) -> Read<'a> {
        if self.columns.is_empty() {
            return Err("no $COLUMNS before the first message".into());
        }
        let words = || line.split_whitespace();
        let column = |letter| self.columns.iter().position(|column| *column == letter);
        let word = |letter, what: &str| {
            let word = column(letter).and_then(|column| words().nth(column));
            word.ok_or_else(|| Doubt::missing(&format!("{what} (column {letter})")))
        };
        let is_fd = match word('T', "type")? {
            "DT" => Some(false),
            "FD" | "FB" | "FE" | "BI" => Some(true),
            "RR" => None,
            // Status, error frame, error counter, and event.
            "ST" | "ER" | "EC" | "EV" => return Ok(EVENT),
            other => return Err(Doubt::word(other, "no type of a message")),
        };
        let time = time(word('O', "time")?, MILLIS)?;
        let id = word('I', "identifier")?;
        let frame = match is_fd {
            None => None,
            Some(is_fd) => {
                let len = match column('l') {
                    Some(_) => number(word('l', "length")?, 10),
                    None => number(word('L', "length code")?, 10)
                        .and_then(|code| FD_LENGTHS.get(code as usize))
                        .map(|&len| if is_fd { len } else { len.min(8) }.into()),
                };
                let len = len.ok_or_else(|| Doubt::missing("length of the data"))?;
                let first = column('D').ok_or_else(|| Doubt::missing("column D, for data"))?;
                whole_frame(id, is_fd, &data(words().skip(first), len as usize, 16)?)?
            }
        };
        let bus = column('B').and_then(|column| words().nth(column)).unwrap_or_default();
        Ok(Unit::Can(Logged::whole(time, bus, frame)))
    }
}

impl LineReader for Trc {
    fn line<'a>(&mut self, line: &'a str) -> Read<'a> {
        let line = line.trim();
        match (line.strip_prefix(';'), self.version) {
            (Some(comment), _) => self.read_comment(comment),
            (None, Version::V2) => self.second_version(line),
            (None, _) => self.first_version(line),
        }
    }
}

/// A frame whose identifier has more than 4 digits for 29 bits.
fn whole_frame(id: &str, is_fd: bool, data: &[u8]) -> Result<Option<Frame>, Doubt> {
    frame(identifier(id, 16)?, id.len() > 4, is_fd, data)
}
