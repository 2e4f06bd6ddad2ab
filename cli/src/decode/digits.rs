//! Conversion of hexadecimal text to bytes, piece by piece.

use crate::error::Error;
use crate::printable::cut;

/// Maximum length of a word that is kept for error messages, in bytes. Messages show no more.
const MAX_WORD: usize = 512;

/// Words of pairs of digits, with or without 0x before them, separated by white space, commas and colons.
pub(super) struct Digits {
    line: usize,
    word: Vec<u8>,
    /// Length of the word so far, in bytes.
    len: u64,
    /// The first digit of a pair.
    high: Option<u8>,
    /// The word has a character that is no digit.
    is_wrong: bool,
}

impl Digits {
    pub(super) fn new() -> Self {
        Self {
            line: 1,
            word: Vec::new(),
            len: 0,
            high: None,
            is_wrong: false,
        }
    }

    /// Reads the next piece of text and appends its bytes.
    pub(super) fn read(&mut self, name: &str, text: &[u8], bytes: &mut Vec<u8>) -> Result<(), Error> {
        for &byte in text {
            match byte {
                b' ' | b'\t' | b',' | b':' | b'\r' | b'\n' => {
                    self.end_word(name)?;
                    self.line += usize::from(byte == b'\n');
                }
                _ => self.read_digit(name, byte, bytes)?,
            }
        }
        Ok(())
    }

    /// Ends the text, and its last word.
    pub(super) fn finish(&mut self, name: &str) -> Result<(), Error> {
        self.end_word(name)
    }

    fn read_digit(&mut self, name: &str, byte: u8, bytes: &mut Vec<u8>) -> Result<(), Error> {
        if self.word.len() < MAX_WORD {
            self.word.push(byte);
        } else if self.is_wrong {
            return Err(self.refused(name));
        }
        self.len += 1;
        if self.is_wrong {
            return Ok(());
        }
        let is_prefix = self.len == 2 && self.high == Some(0) && matches!(byte, b'x' | b'X');
        match (char::from(byte).to_digit(16), self.high.take()) {
            (Some(digit), None) => self.high = Some(digit as u8),
            (Some(digit), Some(high)) => bytes.push(high << 4 | digit as u8),
            (None, _) if is_prefix => {}
            (None, _) => self.is_wrong = true,
        }
        Ok(())
    }

    fn end_word(&mut self, name: &str) -> Result<(), Error> {
        if self.is_wrong || self.high.is_some() {
            return Err(self.refused(name));
        }
        self.word.clear();
        self.len = 0;
        Ok(())
    }

    fn refused(&self, name: &str) -> Error {
        let (line, word) = (self.line, cut(&String::from_utf8_lossy(&self.word)));
        Error::at(
            name,
            format_args!("line {line}: '{word}' is not a byte or bytes in hexadecimal"),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The bytes of a text that is read in pieces of `piece` bytes.
    fn parse(text: &str, piece: usize) -> Result<Vec<u8>, Error> {
        let (mut digits, mut bytes) = (Digits::new(), Vec::new());
        for piece in text.as_bytes().chunks(piece) {
            digits.read("log", piece, &mut bytes)?;
        }
        digits.finish("log")?;
        Ok(bytes)
    }

    #[test]
    fn hexadecimal_text_is_understood_in_its_usual_forms() {
        for text in ["AA 06 00", "aa0600", "0xAA,0x06, 0x00", "aa:06:00", "AA\n06\r\n\n00\n"] {
            for piece in 1..=text.len() {
                assert_eq!(parse(text, piece).unwrap(), [0xAA, 0x06, 0x00], "{text}");
            }
        }
    }

    #[test]
    fn bad_hexadecimal_is_reported_with_its_line() {
        for (text, line, word) in [
            ("AA\n0G", 2, "0G"),
            ("AAA", 1, "AAA"),
            ("+1", 1, "+1"),
            ("00x1", 1, "00x1"),
        ] {
            let error = parse(text, 1).unwrap_err().to_string();
            assert!(
                error.starts_with(&format!("log: line {line}: '{word}' is not")),
                "{error}"
            );
        }
    }

    #[test]
    fn a_word_without_end_is_not_kept() {
        let mut digits = Digits::new();
        let mut bytes = Vec::new();
        for _ in 0..1000 {
            bytes.clear();
            digits.read("log", &[b'A'; 4096], &mut bytes).unwrap();
        }
        assert!(digits.word.capacity() <= 2 * MAX_WORD);
        let error = digits.read("log", b"GG", &mut bytes).unwrap_err().to_string();
        assert!(error.len() < 250, "{error}");
    }
}
