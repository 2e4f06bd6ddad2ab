//! The column of characters behind the words of a line.

use super::word::Word;

/// Maximum number of words before a column. No program writes as many.
const MAX_WORDS: usize = 256;

/// Number of characters before a gap.
const GAP: usize = 8;

/// The number of words that a column of their characters follows, with the bytes of each word. The words may go on into
/// the column: its characters may be digits.
pub(super) fn before_column(
    line: &str,
    words: &[Word<'_>],
    bytes_of: impl Fn(&str) -> Option<Vec<u8>>,
) -> Option<usize> {
    let mut bytes = Vec::new();
    let mut ends = Vec::new();
    for word in words.iter().take(MAX_WORDS) {
        let Some(more) = bytes_of(word.text) else { break };
        bytes.extend(more);
        ends.push((word.end, bytes.len()));
    }
    let last = ends
        .iter()
        .rposition(|&(end, len)| shows(&line[end..], &bytes[..len]))?;
    Some(last + 1)
}

/// Returns true if spaces and then the characters of these bytes follow, perhaps between marks.
fn shows(behind: &str, bytes: &[u8]) -> bool {
    let text = behind.trim_end();
    let column = text.trim_start();
    let framed = |open, close| column.strip_prefix(open)?.strip_suffix(close);
    let framed = framed('|', '|').or(framed('>', '<'));
    let blanks = text
        .char_indices()
        .take_while(|(_, character)| character.is_whitespace());
    // The column may begin with a space.
    let mut starts = blanks.map(|(at, blank)| at + blank.len_utf8());
    column.len() < text.len()
        && (framed.is_some_and(|column| are_shown(bytes, column))
            || starts.any(|start| are_shown(bytes, &text[start..])))
}

/// Returns true if these are the characters of the bytes, perhaps with a gap in their middle.
fn are_shown(bytes: &[u8], column: &str) -> bool {
    let gap = column
        .char_indices()
        .nth(GAP)
        .filter(|(_, character)| *character == ' ');
    are_equal(bytes, column)
        || gap.is_some_and(|(at, _)| are_equal(bytes, &[&column[..at], &column[at + 1..]].concat()))
}

/// Returns true if these are the characters of the bytes. A byte without a character has a mark in its place.
fn are_equal(bytes: &[u8], column: &str) -> bool {
    let mut characters = column.chars();
    let are_equal = bytes.iter().all(|byte| match (characters.next(), byte) {
        (Some(character), b' '..=b'~') => character == char::from(*byte),
        (Some(character), _) => !character.is_ascii_alphanumeric(),
        // Blanks at the end of a line are often lost.
        (None, byte) => !byte.is_ascii_graphic(),
    });
    are_equal && characters.next().is_none()
}
