//! Bytes of a line as people have them: hex dumps with offsets, and the lines of logs.

pub(super) mod dump;
pub(super) mod logged;
#[cfg(test)]
mod tests;

use super::input::Input;
use super::output::Output;
use crate::args::Speaker;
use crate::error::Error;
use dump::Dump;

/// Maximum length of a line of text, in bytes. Logs have the bytes of a whole read in a line.
const MAX_LINE: usize = 64 * 1024;

/// A consumer of bytes, with their sender if the text names it.
pub(super) type Take<'a> = dyn FnMut(Option<Speaker>, &[u8]) + 'a;

/// Passes the bytes of a hex dump to `take`. Offsets that do not fit are remarked.
pub(super) fn read_dump(input: &mut Input<'_>, out: &dyn Output, take: &mut Take<'_>) -> Result<(), Error> {
    let mut dump = Dump::default();
    let mut take = |bytes: &[u8]| take(None, bytes);
    while let Some(line) = input.line_up_to(MAX_LINE)? {
        match dump.push(&line.text, &mut take) {
            Ok(None) => {}
            Ok(Some(remark)) => out.remark(format_args!("line {}: {remark}", line.number)),
            Err(reason) => {
                let (number, text) = (line.number, line.text.into_owned());
                return Err(input.refused_line(number, &text, &reason));
            }
        }
    }
    dump.finish(&mut take);
    Ok(())
}

/// Passes the bytes in the lines of a log to `take`. Lines without bytes are skipped.
pub(super) fn read_log(input: &mut Input<'_>, take: &mut Take<'_>) -> Result<(), Error> {
    while let Some(line) = input.line_up_to(MAX_LINE)? {
        let found = match line.is_whole {
            true => logged::find(&line.text),
            false => Err("the line is too long".to_owned()),
        };
        match found {
            Ok(None) => {}
            Ok(Some(found)) => take(found.from, &found.bytes),
            Err(reason) => {
                let (number, text) = (line.number, line.text.into_owned());
                return Err(input.refused_line(number, &text, &reason));
            }
        }
    }
    Ok(())
}
