//! Bytes in quotes with escapes, as of Python, C, Qt or strace, and escapes without quotes.

use crate::decode::doubts::Doubt;
use crate::hex;

/// The bytes of the literals in a line, and the text before them.
pub(super) fn find(line: &str) -> Result<Option<(&str, Vec<u8>)>, Doubt> {
    let mut found: Option<(&str, Vec<u8>)> = None;
    let (mut rest, mut between) = (0, 0);
    while let Some((start, literal)) = next(&line[rest..]) {
        let (bytes, len) = literal.bytes(&line[rest + start..])?;
        let bytes = digits(&bytes).unwrap_or(bytes);
        let end = rest + start + len;
        match &mut found {
            None => found = Some((&line[..rest + start], bytes)),
            Some((_, all)) if are_joined(&line[between..rest + start]) => all.extend(bytes),
            Some(_) => {
                let text = "two byte strings are in the line, and either may be the bytes of the arm's line";
                return Err(Doubt::new("ambiguous bytes", text));
            }
        }
        (rest, between) = (end, end);
        if line[end..].starts_with("...") {
            return Err(Doubt::new("cut data", "the byte string is cut: '...' is behind it"));
        }
    }
    Ok(found)
}

/// The bytes whose digits these are, as of `binascii.hexlify`. A frame has a byte that is no digit.
fn digits(bytes: &[u8]) -> Option<Vec<u8>> {
    let bytes = hex::parse(str::from_utf8(bytes).ok()?).ok()?;
    (!bytes.is_empty()).then_some(bytes)
}

/// Returns true if nothing but a separator is between two literals.
fn are_joined(between: &str) -> bool {
    between
        .chars()
        .all(|character| character.is_whitespace() || ",+".contains(character))
}

/// A form of literal.
enum Literal {
    /// From its quote to the next one.
    Quoted { prefix: usize, quote: char },
    /// Escapes without quotes, up to a space.
    Bare,
}

/// The place of the next literal, and its form.
fn next(text: &str) -> Option<(usize, Literal)> {
    let mut before = None;
    let mut characters = text.char_indices();
    while let Some((at, character)) = characters.next() {
        let is_word = |character: char| character.is_alphanumeric() || character == '_';
        match character {
            '\'' | '"' => {
                let is_bytes = before == Some('b') && !text[..at - 1].ends_with(is_word);
                if is_bytes {
                    let (prefix, quote) = (1, character);
                    return Some((at - 1, Literal::Quoted { prefix, quote }));
                }
                let inner = &text[at + 1..];
                if !before.is_some_and(is_word)
                    && let Some(end) = end_of(inner, character)
                {
                    if has_escapes(&inner[..end]) {
                        let (prefix, quote) = (0, character);
                        return Some((at, Literal::Quoted { prefix, quote }));
                    }
                    // Another text, such as a name.
                    if inner[..end].len() > 1 {
                        characters = text.char_indices();
                        characters.by_ref().find(|(there, _)| *there == at + 1 + end);
                    }
                }
            }
            '\\' if is_hex_escape(&text[at..]) => return Some((at, Literal::Bare)),
            _ => {}
        }
        before = Some(character);
    }
    None
}

/// The place of the closing quote.
fn end_of(text: &str, quote: char) -> Option<usize> {
    let mut is_escaped = false;
    text.char_indices().find_map(|(at, character)| {
        let is_end = character == quote && !is_escaped;
        is_escaped = character == '\\' && !is_escaped;
        is_end.then_some(at)
    })
}

/// Returns true if the text has an escape of a byte by its number.
fn has_escapes(text: &str) -> bool {
    let mut escapes = text.match_indices('\\').map(|(at, _)| &text[at..]);
    escapes.any(|escape| is_hex_escape(escape) || is_octal_escape(escape))
}

fn is_hex_escape(text: &str) -> bool {
    let digits = text.strip_prefix("\\x").and_then(|digits| digits.get(..2));
    digits.is_some_and(|digits| digits.bytes().all(|byte| byte.is_ascii_hexdigit()))
}

fn is_octal_escape(text: &str) -> bool {
    text.strip_prefix('\\')
        .is_some_and(|text| text.starts_with(|digit| matches!(digit, '0'..='7')))
}

impl Literal {
    /// The bytes of the literal that `text` begins with, and its length with prefix and quotes.
    fn bytes(&self, text: &str) -> Result<(Vec<u8>, usize), Doubt> {
        let wrong = |text: &str| Doubt::new("no byte string", text);
        let (start, quote) = match *self {
            Self::Quoted { prefix, quote } => (prefix + 1, Some(quote)),
            Self::Bare => (0, None),
        };
        let mut bytes = Vec::new();
        let mut rest = &text[start..];
        loop {
            let mut characters = rest.chars();
            let escape = characters.clone().nth(1);
            match (characters.next(), quote) {
                (None, Some(_)) => return Err(wrong("the byte string does not end on its line")),
                (Some(character), Some(quote)) if character == quote => {
                    return Ok((bytes, text.len() - rest.len() + 1));
                }
                (None, None) => return Ok((bytes, text.len())),
                // Of a value without quotes only escapes are bytes.
                (Some(_), None) if !is_hex_escape(rest) => return Ok((bytes, text.len() - rest.len())),
                (Some('\\'), _) => {
                    let (byte, len) = unescaped(rest, escape)?;
                    bytes.push(byte);
                    rest = &rest[len..];
                }
                (Some(character), _) if character.is_ascii() => {
                    bytes.push(character as u8);
                    rest = characters.as_str();
                }
                (Some(_), _) => return Err(wrong("a byte string has ASCII characters only")),
            }
        }
    }
}

/// The byte of an escape, and its length. `escape` is its second character.
fn unescaped(text: &str, escape: Option<char>) -> Result<(u8, usize), Doubt> {
    let wrong = |text: String| Doubt::new("no byte string", text);
    let simple = match escape {
        Some('n') => b'\n',
        Some('r') => b'\r',
        Some('t') => b'\t',
        Some('a') => 7,
        Some('b') => 8,
        Some('f') => 12,
        Some('v') => 11,
        Some(quoted @ ('\\' | '\'' | '"')) => quoted as u8,
        Some('x') if is_hex_escape(text) => {
            let byte = u8::from_str_radix(&text[2..4], 16);
            return byte.map(|byte| (byte, 4)).map_err(|error| wrong(error.to_string()));
        }
        Some('x') => return Err(wrong("an escape of the byte string has not two digits".to_owned())),
        Some('0'..='7') => {
            let digits = text[1..]
                .bytes()
                .take(3)
                .take_while(|digit| matches!(digit, b'0'..=b'7'))
                .count();
            let byte = u8::from_str_radix(&text[1..=digits], 8);
            let byte = byte.map_err(|_| wrong(format!("'{}' is more than a byte", &text[..=digits])))?;
            return Ok((byte, 1 + digits));
        }
        Some(other) => {
            return Err(wrong(format!(
                "'\\{}' is no escape of a byte string",
                other.escape_default()
            )));
        }
        None => return Err(wrong("the byte string does not end on its line".to_owned())),
    };
    Ok((simple, 2))
}
