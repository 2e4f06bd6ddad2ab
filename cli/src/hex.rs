//! Bytes as hexadecimal text, and back.

pub(crate) use armwire_host::describe::hex as show;

use crate::printable::cut;

/// Maximum length of a word that is kept for error messages, in bytes. Messages show no more.
const MAX_WORD: usize = 512;

/// The bytes of a text.
pub(crate) fn parse(text: &str) -> Result<Vec<u8>, WrongWord> {
    let (mut parser, mut bytes) = (Parser::new(), Vec::new());
    parser.push(text.as_bytes(), &mut bytes)?;
    parser.finish()?;
    Ok(bytes)
}

/// A word that is not hexadecimal, cut after [`MAX_WORD`] bytes and for messages.
#[derive(Debug, thiserror::Error)]
#[error("line {line}: '{word}' is not a byte or bytes in hexadecimal")]
pub(crate) struct WrongWord {
    /// The line, counted from 1.
    pub(crate) line: usize,
    pub(crate) word: String,
}

/// A parser of text in pieces of any size: words of pairs of digits, with or without 0x before them, separated by white
/// space, commas, colons and dashes.
pub(crate) struct Parser {
    line: usize,
    word: Vec<u8>,
    /// Length of the word so far, in bytes.
    len: u64,
    /// The first digit of a pair.
    high: Option<u8>,
    /// The word has a character that is no digit.
    is_wrong: bool,
}

impl Parser {
    pub(crate) fn new() -> Self {
        Self {
            line: 1,
            word: Vec::new(),
            len: 0,
            high: None,
            is_wrong: false,
        }
    }

    /// Reads the next piece of text and appends its bytes.
    pub(crate) fn push(&mut self, text: &[u8], bytes: &mut Vec<u8>) -> Result<(), WrongWord> {
        for &byte in text {
            match byte {
                b' ' | b'\t' | b',' | b':' | b'-' | b'\r' | b'\n' => {
                    self.finish()?;
                    self.line += usize::from(byte == b'\n');
                }
                _ => self.push_digit(byte, bytes)?,
            }
        }
        Ok(())
    }

    fn push_digit(&mut self, byte: u8, bytes: &mut Vec<u8>) -> Result<(), WrongWord> {
        if self.word.len() < MAX_WORD {
            self.word.push(byte);
        } else if self.is_wrong {
            return Err(self.wrong_word());
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

    /// Ends the word.
    pub(crate) fn finish(&mut self) -> Result<(), WrongWord> {
        if self.is_wrong || self.high.is_some() {
            return Err(self.wrong_word());
        }
        self.word.clear();
        self.len = 0;
        Ok(())
    }

    fn wrong_word(&self) -> WrongWord {
        let word = cut(&String::from_utf8_lossy(&self.word));
        WrongWord { line: self.line, word }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The bytes of a text that is read in pieces of `piece` bytes.
    fn parse(text: &str, piece: usize) -> Result<Vec<u8>, WrongWord> {
        let (mut parser, mut bytes) = (Parser::new(), Vec::new());
        for piece in text.as_bytes().chunks(piece) {
            parser.push(piece, &mut bytes)?;
        }
        parser.finish()?;
        Ok(bytes)
    }

    #[test]
    fn hexadecimal_text_is_understood_in_its_usual_forms() {
        for text in [
            "AA 06 00",
            "aa0600",
            "0xAA,0x06, 0x00",
            "aa:06:00",
            "AA-06-00",
            "AA\n06\r\n\n00\n",
        ] {
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
            let error = parse(text, 1).unwrap_err();
            assert_eq!((error.line, error.word.as_str()), (line, word));
        }
    }

    #[test]
    fn word_without_end_is_not_kept() {
        let mut parser = Parser::new();
        let mut bytes = Vec::new();
        for _ in 0..1000 {
            bytes.clear();
            parser.push(&[b'A'; 4096], &mut bytes).unwrap();
        }
        assert!(parser.word.capacity() <= 2 * MAX_WORD);
        let error = parser.push(b"GG", &mut bytes).unwrap_err();
        assert!(error.word.len() < 250, "{}", error.word);
    }
}
