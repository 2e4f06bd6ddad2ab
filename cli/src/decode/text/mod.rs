//! Bytes of a line as people have them: digits, hex dumps with offsets, and the lines of logs.

mod column;
mod direction;
pub(super) mod dump;
mod hex_lines;
mod list;
mod literal;
pub(super) mod logged;
mod run;
mod table;
#[cfg(test)]
mod tests;
pub(super) mod time;
mod token;
mod word;

use super::doubts::{Doubt, Doubts, Place};
use super::format::Format;
use super::input::Input;
use super::output::Output;
use crate::args::Speaker;
use crate::error::Error;
use dump::{Dump, Order};
use hex_lines::HexLines;
use logged::Log;

/// Maximum length of a line of text, in bytes. Logs have the bytes of a whole read in a line, arrays a whole file.
const MAX_LINE: usize = 1024 * 1024;

/// A consumer of bytes, with their sender if the text names it.
pub(super) type Take<'a> = dyn FnMut(Option<Speaker>, &[u8]) + 'a;

/// Passes the bytes of a text in this format to `take`. Returns what is not understood.
pub(super) fn read(
    input: &mut Input<'_>,
    format: Format,
    out: &dyn Output,
    take: &mut Take<'_>,
) -> (Doubts, Result<(), Error>) {
    let mut doubts = Doubts::default();
    let mut take_bytes = |bytes: &[u8]| take(None, bytes);
    let read = match format {
        Format::Hex => read_hex(input, out, &mut doubts, &mut take_bytes),
        Format::Dec => read_decimal(input, out, &mut doubts, &mut take_bytes),
        Format::Dump => read_dump(input, None, out, &mut doubts, &mut take_bytes),
        Format::DumpBe => read_dump(input, Some(Order::Big), out, &mut doubts, &mut take_bytes),
        Format::DumpLe => read_dump(input, Some(Order::Little), out, &mut doubts, &mut take_bytes),
        _ => read_log(input, out, &mut doubts, take),
    };
    (doubts, read)
}

/// Reads hexadecimal digits. A line may have any length.
fn read_hex(
    input: &mut Input<'_>,
    out: &dyn Output,
    doubts: &mut Doubts,
    take: &mut dyn FnMut(&[u8]),
) -> Result<(), Error> {
    use std::io::BufRead;

    let mut lines = HexLines::default();
    loop {
        let piece = match input.fill_buf() {
            Ok(piece) => piece,
            Err(error) => {
                lines.finish(take, &mut |place, doubt| doubts.add(place, &doubt, out));
                return Err(input.failed(error));
            }
        };
        let len = piece.len();
        if len == 0 {
            lines.finish(take, &mut |place, doubt| doubts.add(place, &doubt, out));
            return Ok(());
        }
        lines.push(piece, take, &mut |place, doubt| doubts.add(place, &doubt, out));
        input.consume(len);
    }
}

/// Reads decimal numbers.
fn read_decimal(
    input: &mut Input<'_>,
    out: &dyn Output,
    doubts: &mut Doubts,
    take: &mut dyn FnMut(&[u8]),
) -> Result<(), Error> {
    while let Some(line) = input.line_up_to(MAX_LINE)? {
        match decimal(&line.text).filter(|_| line.is_whole) {
            Some(bytes) => take(&bytes),
            None => doubts.add(
                Place::Line(line.number, &line.text),
                &"no numbers from 0 to 255".into(),
                out,
            ),
        }
    }
    Ok(())
}

/// The bytes of a line of decimal numbers, between spaces, commas or semicolons.
pub(super) fn decimal(line: &str) -> Option<Vec<u8>> {
    let words = line.split(|character: char| character.is_whitespace() || matches!(character, ',' | ';'));
    words.filter(|word| !word.is_empty()).map(word::decimal).collect()
}

/// Reads a hex dump.
fn read_dump(
    input: &mut Input<'_>,
    order: Option<Order>,
    out: &dyn Output,
    doubts: &mut Doubts,
    take: &mut dyn FnMut(&[u8]),
) -> Result<(), Error> {
    let mut dump = Dump::new(order);
    let mut last = (0, String::new());
    let mut doubt = |number: u64, text: &str, doubt: Doubt| doubts.add(Place::Line(number, text), &doubt, out);
    while let Some(line) = input.line_up_to(MAX_LINE)? {
        if !line.is_whole {
            doubt(line.number, &line.text, "the line is too long".into());
            continue;
        }
        last = (line.number, line.text.into_owned());
        if let Err(reason) = dump.push(last.0, &last.1, take, &mut doubt) {
            return Err(input.refused_line(last.0, &last.1, &reason));
        }
    }
    let finished = dump.finish(take, &mut doubt);
    finished.map_err(|reason| input.refused_line(last.0, &last.1, &reason))
}

/// Reads the lines of a log. Those without bytes are skipped.
fn read_log(input: &mut Input<'_>, out: &dyn Output, doubts: &mut Doubts, take: &mut Take<'_>) -> Result<(), Error> {
    let mut log = Log::default();
    while let Some(line) = input.line_up_to(MAX_LINE)? {
        let found = match line.is_whole {
            true => log.find(&line.text),
            false => Err("the line is too long".into()),
        };
        match found {
            Ok(None) => {}
            Ok(Some(found)) => take(found.from, &found.bytes),
            Err(doubt) => doubts.add(Place::Line(line.number, &line.text), &doubt, out),
        }
    }
    Ok(())
}
