//! Formats with a unit in each line.

use super::doubts::{Doubt, Place};
use super::input::Input;
use super::unit::{Read, Take, Unit};
use crate::error::Error;

/// A reader of lines.
pub(super) trait LineReader {
    /// What a line is, which is not blank.
    fn line<'a>(&mut self, line: &'a str) -> Read<'a>;

    /// Returns true if the record of a line may go on behind it.
    fn may_go_on(&self, _line: &str) -> bool {
        false
    }

    /// Passes on what waited for another line.
    fn end(&mut self, _take: &mut Take<'_>) {}
}

/// The lines of a format.
#[derive(Clone, Copy)]
pub(super) struct Lines {
    /// Maximum length of a line, in bytes.
    pub(super) max: usize,
    /// A record ends with its line. A part of it may look like another.
    pub(super) are_ended: bool,
}

/// Passes what each line is to `take`.
pub(super) fn read(
    input: &mut Input<'_>,
    lines: Lines,
    reader: &mut dyn LineReader,
    take: &mut Take<'_>,
) -> Result<(), Error> {
    while let Some(line) = input.line_up_to(lines.max)? {
        let place = Place::Line(line.number, &line.text);
        // A file system may fill the end of a log with them when the power fails.
        let text = line.text.trim_matches('\0');
        if text.len() < line.text.len() {
            take(place, Err("NUL bytes".into()));
            if text.is_empty() {
                continue;
            }
        }
        let unit = match text.trim().is_empty() {
            true => Ok(Unit::Comment),
            false => reader.line(text),
        };
        match unit {
            Ok(Unit::Comment) => take(place, unit),
            // The missing end may change its meaning.
            _ if !line.is_whole => take(place, Err("the line is too long".into())),
            Ok(Unit::Other(_)) | Err(_) if lines.are_ended && !line.is_ended => take(place, Err(Doubt::cut())),
            Ok(Unit::Can(_)) if !line.is_ended && reader.may_go_on(text) => take(place, Err(Doubt::cut())),
            Err(doubt) if doubt.is_last => {
                let (number, text) = (line.number, text.to_owned());
                reader.end(take);
                return Err(input.refused_line(number, &text, &doubt.text));
            }
            unit => take(place, unit),
        }
    }
    reader.end(take);
    Ok(())
}
