//! Lines: collected byte by byte, parsed field by field.

use armwire::OutOfRange;
use heapless::Vec;

use super::{Cause, Malformed};

/// Longest stored line: an FD frame of 64 bytes with a 29-bit identifier and a time stamp.
const MAX_LINE: usize = 1 + 8 + 1 + 2 * 64 + 4;

/// The incomplete line.
#[derive(Clone, Debug, Default)]
pub(super) struct Line {
    /// Its characters, up to the longest valid line.
    kept: Vec<u8, MAX_LINE>,
    len: usize,
}

impl Line {
    pub(super) fn push(&mut self, byte: u8) {
        // Bytes beyond the buffer are counted only.
        let _ = self.kept.push(byte);
        self.len += 1;
    }

    /// Parses the whole line, and begins the next.
    pub(super) fn take<T>(&mut self, parse: impl Fn(&mut Field<'_>) -> Result<T, Cause>) -> Result<T, Malformed> {
        let Self { kept, len } = core::mem::take(self);
        let mut field = Field { line: &kept, at: 0 };
        let malformed = |cause| Malformed {
            command: kept.first().copied().unwrap_or(0),
            cause,
        };
        let value = parse(&mut field).map_err(malformed)?;
        match field.at == len {
            true => Ok(value),
            false => Err(malformed(Cause::Length {
                expected: field.at,
                got: len,
            })),
        }
    }
}

/// The unparsed rest of a line.
pub(super) struct Field<'a> {
    line: &'a [u8],
    at: usize,
}

impl Field<'_> {
    /// Returns the first character, if there is one.
    pub(super) fn command(&mut self) -> Option<u8> {
        let first = self.line.first().copied();
        self.at = self.line.len().min(1);
        first
    }

    pub(super) fn is_at_end(&self) -> bool {
        self.at == self.line.len()
    }

    /// Parses a hexadecimal number of this many digits, at most eight.
    pub(super) fn number(&mut self, digits: usize) -> Result<u32, Cause> {
        let end = self.at + digits;
        let mut number = 0;
        while self.at < end {
            let Some(&got) = self.line.get(self.at) else {
                return Err(Cause::Length {
                    expected: end,
                    got: self.at,
                });
            };
            let digit = char::from(got).to_digit(16);
            let digit = digit.ok_or(Cause::Digit { at: self.at, got })?;
            number = number << 4 | digit;
            self.at += 1;
        }
        Ok(number)
    }

    /// Parses one hexadecimal digit, at most `max`.
    pub(super) fn digit(&mut self, what: &'static str, max: u8) -> Result<u8, Cause> {
        match self.number(1)? as u16 {
            got if got > u16::from(max) => Err(Cause::OutOfRange(OutOfRange {
                what,
                unit: "",
                got,
                min: 0,
                max: max.into(),
            })),
            digit => Ok(digit as u8),
        }
    }

    /// Parses two hexadecimal digits.
    pub(super) fn byte(&mut self) -> Result<u8, Cause> {
        self.number(2).map(|byte| byte as u8)
    }

    /// Takes any characters.
    pub(super) fn characters<const N: usize>(&mut self) -> Result<[u8; N], Cause> {
        let Some(characters) = self.line.get(self.at..).and_then(<[u8]>::first_chunk) else {
            return Err(Cause::Length {
                expected: self.at + N,
                got: self.line.len(),
            });
        };
        self.at += N;
        Ok(*characters)
    }
}
