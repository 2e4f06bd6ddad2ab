//! The bytes and lines of a recording, read in pieces of bounded size.

use std::borrow::Cow;
use std::io::{self, BufRead, ErrorKind, Read};

use super::output::Output;
use crate::error::Error;
use crate::printable::cut;

/// The UTF-8 byte order mark of some editors.
pub(super) const BYTE_ORDER_MARK: &[u8] = b"\xEF\xBB\xBF";
/// Size of the buffer, in bytes. The format of a recording is detected in it.
const CAPACITY: usize = 64 * 1024;
/// Maximum length of a line, in bytes: more than four times the longest line of every format.
const MAX_LINE: usize = 4 * 1024;

/// A recording that is being read. The output is flushed before each wait for input.
pub(super) struct Input<'a> {
    name: String,
    source: Box<dyn Read + 'a>,
    out: &'a dyn Output,
    buffer: Vec<u8>,
    /// The unread part of the buffer.
    start: usize,
    end: usize,
    /// Number of bytes consumed.
    offset: u64,
    /// Number of lines begun.
    lines: u64,
    line: Vec<u8>,
    /// The last line was cut, and its rest is not skipped yet.
    is_cut: bool,
}

/// One line of text, without its end.
pub(super) struct Line<'a> {
    /// Counted from 1.
    pub(super) number: u64,
    /// At most [`MAX_LINE`] bytes of it.
    pub(super) text: Cow<'a, str>,
    pub(super) is_whole: bool,
}

impl<'a> Input<'a> {
    pub(super) fn new(name: String, source: Box<dyn Read + 'a>, out: &'a dyn Output) -> Self {
        Self {
            name,
            source,
            out,
            buffer: vec![0; CAPACITY],
            start: 0,
            end: 0,
            offset: 0,
            lines: 0,
            line: Vec::new(),
            is_cut: false,
        }
    }

    /// The bytes in the buffer that are not consumed yet.
    pub(super) fn buffered(&self) -> &[u8] {
        &self.buffer[self.start..self.end]
    }

    /// Reads more, and waits for it. Returns false at the end of the recording, and if the buffer is full.
    pub(super) fn more(&mut self) -> Result<bool, Error> {
        let read = self.read_more();
        read.map_err(|error| self.failed(error))
    }

    fn read_more(&mut self) -> io::Result<bool> {
        self.buffer.copy_within(self.start..self.end, 0);
        self.end -= self.start;
        self.start = 0;
        self.out.flush();
        loop {
            match self.source.read(&mut self.buffer[self.end..]) {
                Ok(n) => {
                    self.end += n;
                    return Ok(n > 0);
                }
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
    }

    /// Skips a byte order mark.
    pub(super) fn skip_byte_order_mark(&mut self) -> Result<(), Error> {
        while BYTE_ORDER_MARK.starts_with(self.buffered()) && self.buffered() != BYTE_ORDER_MARK && self.more()? {}
        if self.buffered().starts_with(BYTE_ORDER_MARK) {
            self.consume(BYTE_ORDER_MARK.len());
        }
        Ok(())
    }

    /// Number of bytes consumed.
    pub(super) fn offset(&self) -> u64 {
        self.offset
    }

    /// The next line, if there is one.
    pub(super) fn line(&mut self) -> Result<Option<Line<'_>>, Error> {
        if self.is_cut {
            while !self.take_line(0)? {}
        }
        self.line.clear();
        if self.buffered().is_empty() && !self.more()? {
            return Ok(None);
        }
        self.lines += 1;
        self.is_cut = !self.take_line(MAX_LINE)?;
        Ok(Some(Line {
            number: self.lines,
            text: String::from_utf8_lossy(&self.line),
            is_whole: !self.is_cut,
        }))
    }

    /// Consumes the line up to its end and keeps up to `room` bytes. Returns false if bytes of the line are left. If
    /// `room` is 0, the bytes are skipped.
    fn take_line(&mut self, room: usize) -> Result<bool, Error> {
        loop {
            if self.buffered().is_empty() && !self.more()? {
                return Ok(true);
            }
            let free = match room {
                0 => usize::MAX,
                room => room - self.line.len(),
            };
            let bytes = &self.buffer[self.start..self.end];
            let end = bytes.iter().position(|&byte| byte == b'\n');
            let len = end.unwrap_or(bytes.len());
            if len > free {
                self.line.extend_from_slice(&bytes[..free]);
                self.consume(free);
                return Ok(false);
            }
            if room > 0 {
                self.line.extend_from_slice(&bytes[..len]);
            }
            self.consume(len + usize::from(end.is_some()));
            if end.is_some() {
                return Ok(true);
            }
        }
    }

    /// The error of a failed read.
    pub(super) fn failed(&self, error: io::Error) -> Error {
        Error::at(&self.name, error)
    }

    /// The error of a line that cannot be decoded.
    pub(super) fn refused_line(&self, number: u64, text: &str, reason: &str) -> Error {
        Error::at(
            &self.name,
            format_args!("line {number}: '{}': {reason}", cut(text.trim())),
        )
    }

    /// The error of bytes that cannot be decoded.
    pub(super) fn refused_at(&self, offset: u64, reason: &str) -> Error {
        Error::at(&self.name, format_args!("byte {offset}: {reason}"))
    }

    pub(super) fn name(&self) -> &str {
        &self.name
    }
}

impl Read for Input<'_> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let n = self.fill_buf()?.read(bytes)?;
        self.consume(n);
        Ok(n)
    }
}

impl BufRead for Input<'_> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        if self.buffered().is_empty() {
            self.read_more()?;
        }
        Ok(self.buffered())
    }

    fn consume(&mut self, n: usize) {
        debug_assert!(n <= self.end - self.start);
        self.start += n;
        self.offset += n as u64;
    }
}
