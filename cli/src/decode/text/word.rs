//! Words of a line, and the bytes of single ones.

/// A word of a line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in super::super) struct Word<'a> {
    pub(in super::super) text: &'a str,
    /// The place in the line behind it.
    pub(super) end: usize,
}

impl Word<'_> {
    /// The word without 0x before it.
    pub(super) fn without_prefix(self) -> Self {
        let text = self.text.strip_prefix("0x").unwrap_or(self.text);
        Self { text, ..self }
    }
}

/// The words of a line, between white space.
pub(super) fn words(line: &str) -> impl Iterator<Item = Word<'_>> {
    let mut at = 0;
    std::iter::from_fn(move || {
        let rest = &line[at..];
        let start = at + rest.len() - rest.trim_start().len();
        let text = line[start..]
            .split(char::is_whitespace)
            .next()
            .filter(|word| !word.is_empty())?;
        at = start + text.len();
        Some(Word { text, end: at })
    })
}

/// The byte of a hexadecimal word with one digit.
pub(super) fn short_byte(word: &str) -> Option<u8> {
    let is_digit = word.len() == 1 && word.bytes().all(|digit| digit.is_ascii_hexdigit());
    u8::from_str_radix(word, 16).ok().filter(|_| is_digit)
}

/// The byte of a decimal word without zeros before it.
pub(super) fn decimal(word: &str) -> Option<u8> {
    let is_number = is_decimal(word) && (word.len() == 1 || !word.starts_with('0'));
    word.parse().ok().filter(|_| is_number)
}

pub(super) fn is_decimal(word: &str) -> bool {
    word.bytes().all(|byte| byte.is_ascii_digit())
}
