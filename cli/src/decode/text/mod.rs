//! Bytes of a line as people have them: digits, hex dumps with offsets, and the lines of logs.

mod column;
mod direction;
pub(super) mod dump;
mod hex_lines;
mod list;
mod literal;
pub(super) mod logged;
mod run;
mod stamp;
mod table;
#[cfg(test)]
mod tests;
pub(super) mod time;
mod token;
mod word;

use super::format::Format;
use super::input::Input;
use super::lines::{self, LineReader, Lines};
use super::unit::{Bytes, Read, Take, Unit};
use crate::error::Error;
use dump::{Dump, Order};
use hex_lines::HexLines;
use logged::Log;

/// The lines of a text. Logs have the bytes of a whole read in a line, arrays a whole file.
const LINES: Lines = Lines {
    max: 1024 * 1024,
    are_ended: false,
};

/// Passes what each line of a text in this format is to `take`. The words of a hex dump have this order of bytes.
pub(super) fn read(
    input: &mut Input<'_>,
    format: Format,
    order: Option<Order>,
    take: &mut Take<'_>,
) -> Result<(), Error> {
    let reader: &mut dyn LineReader = match (format, order) {
        (Format::Hex, _) => return read_hex(input, take),
        (Format::Dec, _) => &mut Decimal,
        (_, Some(order)) => &mut Dump::new(order),
        _ => &mut Log::default(),
    };
    lines::read(input, LINES, reader, take)
}

/// Reads hexadecimal digits. A line may have any length.
fn read_hex(input: &mut Input<'_>, take: &mut Take<'_>) -> Result<(), Error> {
    use std::io::BufRead;

    let mut lines = HexLines::default();
    loop {
        let len = match input.fill_buf() {
            Ok(piece) => {
                lines.push(piece, take);
                piece.len()
            }
            Err(error) => {
                lines.end_line(take);
                return Err(input.failed(error));
            }
        };
        if len == 0 {
            lines.end_line(take);
            return Ok(());
        }
        input.consume(len);
    }
}

/// Decimal numbers.
struct Decimal;

impl LineReader for Decimal {
    fn line<'a>(&mut self, line: &'a str) -> Read<'a> {
        let bytes = decimal(line).ok_or("no numbers from 0 to 255")?;
        Ok(Unit::Bytes(Bytes::new(bytes)))
    }
}

/// The bytes of a line of decimal numbers, between spaces, commas or semicolons.
pub(super) fn decimal(line: &str) -> Option<Vec<u8>> {
    let words = line.split(|character: char| character.is_whitespace() || matches!(character, ',' | ';'));
    words.filter(|word| !word.is_empty()).map(word::decimal).collect()
}
