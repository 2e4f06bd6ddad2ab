//! Lines of hexadecimal digits.

use super::word::short_byte;
use crate::decode::content::{ends_line, is_ended};
use crate::decode::doubts::{Doubt, Place};
use crate::decode::unit::{Bytes, Take, Unit};
use crate::hex::Parser;

/// Maximum number of bytes of a line that wait for its end: a line with a wrong word has no bytes.
const MAX_KEPT: usize = 4096;
/// Maximum length of a line's beginning that is kept for its doubt, in bytes.
const MAX_SHOWN: usize = 256;

/// Lines in pieces of any size.
pub(super) struct HexLines {
    parser: Parser,
    /// The number of the line, counted from 1, and its beginning.
    number: u64,
    beginning: Vec<u8>,
    /// The last line ended with a carriage return. A line feed behind it is a part of the same end.
    is_behind_return: bool,
    /// The bytes of the line that are not passed on.
    bytes: Vec<u8>,
    /// The wrong word of the line.
    wrong: Option<String>,
}

impl Default for HexLines {
    fn default() -> Self {
        Self {
            parser: Parser::new(),
            number: 1,
            beginning: Vec::new(),
            is_behind_return: false,
            bytes: Vec::new(),
            wrong: None,
        }
    }
}

impl HexLines {
    pub(super) fn push(&mut self, piece: &[u8], take: &mut Take<'_>) {
        for part in piece.split_inclusive(ends_line) {
            if std::mem::replace(&mut self.is_behind_return, part.ends_with(b"\r")) && part == b"\n" {
                continue;
            }
            let room = MAX_SHOWN.saturating_sub(self.beginning.len());
            self.beginning.extend(part.iter().take(room));
            // Byte by byte: what of a wrong line is passed on does not depend on the pieces.
            for byte in part.iter().filter(|byte| !ends_line(byte)) {
                if self.wrong.is_some() {
                    break;
                }
                if let Err(wrong) = self.parser.push(&[*byte], &mut self.bytes) {
                    self.reject(wrong.word);
                }
                if self.bytes.len() >= MAX_KEPT {
                    self.pass(take);
                }
            }
            if is_ended(part) {
                self.end_line(take);
                self.number += 1;
            }
        }
    }

    /// Passes on what the line is. The bytes of a long one may be passed on before, in parts.
    pub(super) fn end_line(&mut self, take: &mut Take<'_>) {
        if self.wrong.is_none()
            && let Err(wrong) = self.parser.finish()
        {
            match short_byte(&wrong.word).filter(|_| self.bytes.is_empty()) {
                // Some programs write each byte in a line, without zeros before it.
                Some(byte) => {
                    self.bytes.push(byte);
                    self.parser = Parser::new();
                }
                None => self.reject(wrong.word),
            }
        }
        match self.wrong.take() {
            Some(word) => {
                let text = String::from_utf8_lossy(&self.beginning);
                let reason = format!("'{word}' is not a byte or bytes in hexadecimal");
                let doubt = Doubt::new("no bytes in hexadecimal", reason);
                take(Place::Line(self.number, &text), Err(doubt));
            }
            None if !self.bytes.is_empty() => self.pass(take),
            // Nothing behind the last line.
            None if self.beginning.is_empty() => {}
            None => take(Place::Line(self.number, ""), Ok(Unit::Comment)),
        }
        self.bytes.clear();
        self.beginning.clear();
    }

    fn pass(&mut self, take: &mut Take<'_>) {
        take(
            Place::Line(self.number, ""),
            Ok(Unit::Bytes(Bytes::new(&self.bytes[..]))),
        );
        self.bytes.clear();
    }

    /// Leaves out the line, which has this word.
    fn reject(&mut self, word: String) {
        self.wrong = Some(word);
        self.bytes.clear();
        self.parser = Parser::new();
    }
}
