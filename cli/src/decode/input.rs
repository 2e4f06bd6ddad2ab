//! The bytes and lines of a recording, read in pieces of bounded size.

use std::borrow::Cow;
use std::io::{self, BufRead, BufReader, Chain, Cursor, ErrorKind, Read};

use super::content::ends_line;
use super::output::Output;
use super::packed::Unpacked;
use crate::error::Error;
use crate::printable::cut;

/// The UTF-8 byte order mark of some editors.
pub(super) const BYTE_ORDER_MARK: &[u8] = b"\xEF\xBB\xBF";
/// Size of the buffer, and maximum size of the head, in bytes.
const CAPACITY: usize = 64 * 1024;

/// The first bytes of a recording, as far as they were needed to detect its format.
pub(super) struct Head<'a> {
    name: String,
    /// Has [`CAPACITY`] bytes, of which `len` were read.
    buffer: Vec<u8>,
    len: usize,
    rest: Source<'a>,
}

impl<'a> Head<'a> {
    pub(super) fn new(name: String, source: Box<dyn Read + 'a>, out: &'a dyn Output) -> Self {
        Self {
            name,
            buffer: vec![0; CAPACITY],
            len: 0,
            rest: Source::new(source, out),
        }
    }

    /// The recording, decompressed if it is compressed, and with UTF-8 in place of UTF-16. Nothing of it was read yet.
    pub(super) fn unpacked(self) -> Self {
        let Source { source, out, .. } = self.rest;
        Self {
            rest: Source::new(Box::new(Unpacked::new(source)), out),
            ..self
        }
    }

    pub(super) fn bytes(&self) -> &[u8] {
        &self.buffer[..self.len]
    }

    /// Reads more bytes. Returns false at the end of the recording, and if the head has its maximum size. An error behind
    /// other bytes is that of a later read.
    pub(super) fn read_more(&mut self) -> Result<bool, Error> {
        match self.rest.read(&mut self.buffer[self.len..]) {
            Ok(n) => {
                self.len += n;
                Ok(n > 0)
            }
            Err(error) if self.len == 0 => Err(Error::at(&self.name, error)),
            Err(error) => {
                self.rest.error = Some(error);
                Ok(false)
            }
        }
    }

    /// The first bytes of what was read so far.
    pub(super) fn beginning(&self) -> Vec<u8> {
        /// Number of bytes that are shown of a recording without a frame.
        const SHOWN: usize = 16;
        let bytes = self.bytes();
        bytes[..bytes.len().min(SHOWN)].to_vec()
    }

    /// The whole recording.
    pub(super) fn into_input(mut self) -> Input<'a> {
        self.buffer.truncate(self.len);
        Input {
            name: self.name,
            reader: BufReader::with_capacity(CAPACITY, Cursor::new(self.buffer).chain(self.rest)),
            offset: 0,
            lines: 0,
            line: Vec::new(),
            is_cut: false,
            is_behind_return: false,
        }
    }

    /// The whole recording, without a byte order mark.
    pub(super) fn into_text(mut self) -> Result<Input<'a>, Error> {
        while BYTE_ORDER_MARK.starts_with(self.bytes()) && self.bytes() != BYTE_ORDER_MARK && self.read_more()? {}
        if self.bytes().starts_with(BYTE_ORDER_MARK) {
            self.buffer.drain(..BYTE_ORDER_MARK.len());
            self.len -= BYTE_ORDER_MARK.len();
        }
        Ok(self.into_input())
    }

    /// The error of a recording that cannot be decoded.
    pub(super) fn refused(&self, reason: &str) -> Error {
        Error::at(&self.name, reason)
    }

    /// The error of a line that cannot be decoded.
    pub(super) fn refused_line(&self, number: u64, text: &str, reason: &str) -> Error {
        refused_line(&self.name, number, text, reason)
    }
}

/// A recording that is being read.
pub(super) struct Input<'a> {
    name: String,
    /// The head, and the rest of the recording.
    reader: BufReader<Chain<Cursor<Vec<u8>>, Source<'a>>>,
    /// Number of bytes consumed.
    offset: u64,
    /// Number of lines begun.
    lines: u64,
    line: Vec<u8>,
    /// The last line was cut, and its rest is not skipped yet.
    is_cut: bool,
    /// The last line ended with a carriage return. A line feed behind it is a part of the same end.
    is_behind_return: bool,
}

/// One line of text, without its end.
pub(super) struct Line<'a> {
    /// Counted from 1.
    pub(super) number: u64,
    /// The bytes of it that are kept.
    pub(super) text: Cow<'a, str>,
    pub(super) is_whole: bool,
    /// The recording goes on behind it.
    pub(super) is_ended: bool,
}

impl Input<'_> {
    /// Number of bytes consumed, other than in lines.
    pub(super) fn offset(&self) -> u64 {
        self.offset
    }

    /// The next line, if there is one. At most `max` bytes of it are kept.
    pub(super) fn line_up_to(&mut self, max: usize) -> Result<Option<Line<'_>>, Error> {
        let read = self.read_line(max);
        let is_ended = read.map_err(|error| self.failed(error))?;
        if !is_ended && self.line.is_empty() {
            return Ok(None);
        }
        self.lines += 1;
        self.is_cut = !is_ended && self.line.len() > max;
        self.line.truncate(max);
        Ok(Some(Line {
            number: self.lines,
            text: String::from_utf8_lossy(&self.line),
            is_whole: !self.is_cut,
            is_ended: is_ended || self.is_cut,
        }))
    }

    /// Reads a line, after the rest of a line that was cut. Of a longer line it reads one byte more than is kept. Returns
    /// true if its end was read.
    fn read_line(&mut self, max: usize) -> io::Result<bool> {
        self.line.clear();
        while self.is_cut {
            let is_ended = self.read_piece(max + 1)?;
            self.is_cut = !is_ended && !self.line.is_empty();
            self.line.clear();
        }
        while self.line.len() <= max {
            let len = self.line.len();
            if self.read_piece(max + 1 - len)? {
                return Ok(true);
            }
            if self.line.len() == len {
                break;
            }
        }
        Ok(false)
    }

    /// Reads at most `max` bytes of a line, as they come, and none at the end of the recording. Returns true at the end of
    /// the line.
    fn read_piece(&mut self, max: usize) -> io::Result<bool> {
        if self.is_behind_return && self.reader.fill_buf()?.starts_with(b"\n") {
            self.reader.consume(1);
        }
        self.is_behind_return = false;
        let piece = self.reader.fill_buf()?;
        let piece = &piece[..piece.len().min(max)];
        let end = piece.iter().position(ends_line);
        let len = end.unwrap_or(piece.len());
        self.line.extend(&piece[..len]);
        self.is_behind_return = end.is_some_and(|end| piece[end] == b'\r');
        self.reader.consume(len + usize::from(end.is_some()));
        Ok(end.is_some())
    }

    /// The error of a failed read.
    pub(super) fn failed(&self, error: io::Error) -> Error {
        Error::at(&self.name, error)
    }

    /// The error of a recording that cannot be decoded.
    pub(super) fn refused(&self, reason: &str) -> Error {
        Error::at(&self.name, reason)
    }

    /// The error of a line that cannot be decoded.
    pub(super) fn refused_line(&self, number: u64, text: &str, reason: &str) -> Error {
        refused_line(&self.name, number, text, reason)
    }

    /// The error of bytes that cannot be decoded.
    #[cfg(feature = "recordings")]
    pub(super) fn refused_at(&self, offset: u64, reason: &str) -> Error {
        Error::at(&self.name, format_args!("byte {offset}: {reason}"))
    }

    pub(super) fn name(&self) -> &str {
        &self.name
    }
}

fn refused_line(name: &str, number: u64, text: &str, reason: &str) -> Error {
    Error::at(name, format_args!("line {number}: '{}': {reason}", cut(text.trim())))
}

impl Read for Input<'_> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let n = self.reader.read(bytes)?;
        self.offset += n as u64;
        Ok(n)
    }
}

impl BufRead for Input<'_> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        self.reader.fill_buf()
    }

    fn consume(&mut self, n: usize) {
        self.reader.consume(n);
        self.offset += n as u64;
    }
}

/// The source of a recording. The output is flushed before each wait for input.
struct Source<'a> {
    source: Box<dyn Read + 'a>,
    out: &'a dyn Output,
    /// The error of the next read.
    error: Option<io::Error>,
}

impl<'a> Source<'a> {
    fn new(source: Box<dyn Read + 'a>, out: &'a dyn Output) -> Self {
        let error = None;
        Self { source, out, error }
    }
}

impl Read for Source<'_> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        if let Some(error) = self.error.take() {
            return Err(error);
        }
        // Without an output the recording ends here.
        if !self.out.flush() {
            return Ok(0);
        }
        loop {
            match self.source.read(bytes) {
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                read => return read,
            }
        }
    }
}
