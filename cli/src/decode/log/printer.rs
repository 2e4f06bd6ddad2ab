//! The text of python-can's `Printer`, also in its logs of the type TXT.

use super::{Doubt, LineReader, Logged, Read, SECONDS, Unit, data, frame, identifier, number, time};

/// First characters of such a log.
pub(in crate::decode) const BEGINNING: &str = "Timestamp: ";

/// A parser of such logs:
///
/// ```text
/// Timestamp: 1609459200.123456    ID: 060f    S Rx                DL:  8    07 aa 06 00 01 fe 9a ff     Channel: can0
/// ```
///
/// The letters between identifier and length are X for 29 bits or S, the direction, E for an error frame, R for a remote
/// frame, F for FD, BS and EI.
pub(in crate::decode) struct Printer;

impl LineReader for Printer {
    fn line<'a>(&mut self, line: &'a str) -> Read<'a> {
        let after = |text: &'a str, what: &'static str| {
            let found = text
                .split_once(what)
                .map(|(before, after)| (before, after.trim_start()));
            found.ok_or_else(|| Doubt::missing(what))
        };
        let (_, rest) = after(line, BEGINNING)?;
        let (stamp, rest) = after(rest, "ID: ")?;
        let time = time(stamp.trim(), SECONDS)?;
        let (id, rest) = rest.split_once(' ').ok_or_else(|| Doubt::missing("identifier"))?;
        let (flags, rest) = after(rest, "DL:")?;
        let (rest, bus) = rest.split_once("Channel: ").unwrap_or((rest, ""));
        let has = |flag: &str| flags.split_whitespace().any(|word| word == flag);
        let mut words = rest.split_whitespace();
        let len = words.next().and_then(|len| number(len, 10));
        let len = len.ok_or_else(|| Doubt::missing("length of the data"))? as usize;
        let frame = match has("E") || has("R") {
            true => None,
            false => frame(identifier(id, 16)?, has("X"), has("F"), &data(words, len, 16)?)?,
        };
        Ok(Unit::Can(Logged::whole(time, bus.trim(), frame)))
    }
}
