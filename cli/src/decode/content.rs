//! Text, or the bytes of a line as they are.

/// The content of a recording that begins with these bytes.
pub(super) enum Content {
    Text,
    Raw,
    /// More bytes are needed.
    Unknown,
}

/// Text is UTF-8 without control characters, up to an incomplete character, or lines in an encoding of one byte.
pub(super) fn content(bytes: &[u8], is_all: bool) -> Content {
    let text = match std::str::from_utf8(bytes) {
        Ok(text) => text,
        Err(error) if error.error_len().is_some() => return content_of_one_byte(bytes, is_all),
        Err(error) => std::str::from_utf8(&bytes[..error.valid_up_to()]).unwrap_or_default(),
    };
    let is_control = |character: char| character.is_control() && !character.is_whitespace() && character != ESCAPE;
    match !text.contains('\0') && (text.is_ascii() || !text.contains(is_control)) {
        true => Content::Text,
        false => Content::Raw,
    }
}

/// The first character of a terminal's colours.
const ESCAPE: char = '\u{1B}';

/// Text in an encoding of one byte has mostly characters of ASCII in its first line. A raw recording has control
/// characters.
fn content_of_one_byte(bytes: &[u8], is_all: bool) -> Content {
    /// The beginning of a text has some characters of ASCII in it.
    const BEGINNING: usize = 8;
    let is_ascii = |byte: &u8| byte.is_ascii_graphic() || byte.is_ascii_whitespace();
    let ascii = |bytes: &[u8]| bytes.iter().filter(|byte| is_ascii(byte)).count();
    let is_control = |byte: &u8| byte.is_ascii_control() && !is_ascii(byte) && char::from(*byte) != ESCAPE;
    let beginning = &bytes[..bytes.len().min(BEGINNING)];
    let (_, line, is_ended) = first_line(bytes);
    match () {
        () if bytes.iter().any(is_control) => Content::Raw,
        () if beginning.len() == BEGINNING && 4 * ascii(beginning) <= BEGINNING => Content::Raw,
        () if !is_ended && !is_all => Content::Unknown,
        () if 4 * ascii(line) > 3 * line.len() => Content::Text,
        () => Content::Raw,
    }
}

/// The first line that is not blank, its number, and true if its end was read.
pub(super) fn first_line(text: &[u8]) -> (u64, &[u8], bool) {
    let is_blank = |line: &[u8]| line.iter().all(u8::is_ascii_whitespace);
    match (1..).zip(lines(text)).find(|(_, line)| !is_blank(line)) {
        Some((number, line)) => (number, line, is_ended(line)),
        None => (1, &[], false),
    }
}

/// The lines of a text, with their ends.
pub(super) fn lines(text: &[u8]) -> impl Iterator<Item = &[u8]> + Clone {
    let mut rest = text;
    std::iter::from_fn(move || {
        let end = rest.iter().position(ends_line).map_or(rest.len(), |end| end + 1);
        let end = end + usize::from(rest[..end].ends_with(b"\r") && rest[end..].starts_with(b"\n"));
        let (line, behind) = rest.split_at(end);
        rest = behind;
        (!line.is_empty()).then_some(line)
    })
}

/// Returns true if a line has its end.
pub(super) fn is_ended(line: &[u8]) -> bool {
    line.last().is_some_and(ends_line)
}

/// Returns true for a byte that ends a line. A line feed behind a carriage return is a part of the same end.
pub(super) fn ends_line(byte: &u8) -> bool {
    matches!(byte, b'\n' | b'\r')
}
