//! The bytes and lines of a recording, read in pieces of bounded size.

use std::borrow::Cow;
use std::io::{self, BufRead, ErrorKind, Read};

use super::format::BYTE_ORDER_MARK;
use super::output::Output;
use crate::error::Error;
use crate::printable::cut;

/// How many bytes are kept at most. The format of a recording is told from them.
const CAPACITY: usize = 64 * 1024;
/// The longest line of a log that is read whole, in bytes. No format has one of a quarter of that.
const MAX_LINE: usize = 4 * 1024;

/// A recording that is being read. Before it waits for more, it has the output shown.
pub(super) struct Input<'a> {
    name: String,
    source: Box<dyn Read + 'a>,
    out: &'a dyn Output,
    buffer: Vec<u8>,
    /// What is left to take of the buffer.
    start: usize,
    end: usize,
    /// How many bytes were taken before.
    offset: u64,
    /// How many lines were begun.
    lines: u64,
    line: Vec<u8>,
    /// The last line was cut, and its rest is yet to be skipped.
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

    /// What was read and not taken yet.
    pub(super) fn buffered(&self) -> &[u8] {
        &self.buffer[self.start..self.end]
    }

    /// Reads more, waiting for it. False at the end of the recording, or if there is no room.
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

    /// Skips what some editors begin UTF-8 text with.
    pub(super) fn skip_byte_order_mark(&mut self) -> Result<(), Error> {
        while BYTE_ORDER_MARK.starts_with(self.buffered()) && self.buffered() != BYTE_ORDER_MARK && self.more()? {}
        if self.buffered().starts_with(BYTE_ORDER_MARK) {
            self.consume(BYTE_ORDER_MARK.len());
        }
        Ok(())
    }

    /// How many bytes were taken.
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

    /// Takes to the end of the line and keeps up to `room` bytes of it. False if these are not all, with bytes left to
    /// take; with no room the bytes are skipped.
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

    /// The recording cannot be read.
    pub(super) fn failed(&self, error: io::Error) -> Error {
        Error::at(&self.name, error)
    }

    /// A line has no meaning.
    pub(super) fn refused_line(&self, number: u64, text: &str, reason: &str) -> Error {
        Error::at(
            &self.name,
            format_args!("line {number}: '{}': {reason}", cut(text.trim())),
        )
    }

    /// The bytes at an offset have no meaning.
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
