//! The parts of a line.

use super::word::Word;
use crate::args::Speaker;

/// A part of a line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Token<'a> {
    Word(Word<'a>),
    /// A bracket, a quote, a colon behind a word, or the like.
    Mark(char),
    Arrow(Speaker),
    Comma,
}

/// The tokens of a line.
pub(super) fn tokens(line: &str) -> Vec<Token<'_>> {
    let mut tokens = Vec::new();
    let mut rest = line;
    while let Some(first) = rest.chars().next() {
        let len = match first {
            ',' | ';' => {
                tokens.push(Token::Comma);
                1
            }
            _ if first.is_whitespace() => first.len_utf8(),
            '→' | '←' => {
                tokens.push(Token::Arrow(if first == '→' { Speaker::Host } else { Speaker::Arm }));
                first.len_utf8()
            }
            '<' | '>' | '-' | '=' => arrow(line, rest, &mut tokens),
            '[' | ']' | '(' | ')' | '{' | '}' | '|' | '"' | '\'' | '`' | ':' | '#' | '$' => {
                tokens.push(Token::Mark(first));
                first.len_utf8()
            }
            ZERO_WIDTH => first.len_utf8(),
            '：' => {
                tokens.push(Token::Mark(':'));
                first.len_utf8()
            }
            _ if is_sign(first) => {
                tokens.push(Token::Mark(first));
                first.len_utf8()
            }
            _ => {
                let is_end = |character: char| {
                    is_sign(character) || character.is_whitespace() || ",;[](){}|\"'`#$=<>→←".contains(character)
                };
                let word = &rest[..rest.find(is_end).unwrap_or(rest.len())];
                let trimmed = word.trim_end_matches([':', '-']);
                // A dash between a word and an angle bracket belongs to the arrow.
                let trimmed = if trimmed.is_empty() { word } else { trimmed };
                tokens.push(Token::Word(Word {
                    text: trimmed,
                    end: line.len() - rest.len() + trimmed.len(),
                }));
                trimmed.len()
            }
        };
        rest = &rest[len..];
    }
    tokens
}

/// A space without width.
const ZERO_WIDTH: char = '\u{200B}';

/// Returns true for signs and for characters that words in hexadecimal may be next to: no letters of Europe.
fn is_sign(character: char) -> bool {
    /// The first block of signs in Unicode.
    const GENERAL_PUNCTUATION: char = '\u{2000}';
    character >= GENERAL_PUNCTUATION && !character.is_whitespace()
}

/// Pushes an arrow, or the marks of its characters. Returns its length.
fn arrow<'a>(line: &'a str, rest: &'a str, tokens: &mut Vec<Token<'a>>) -> usize {
    let len = rest.find(|character| !"<>-=".contains(character)).unwrap_or(rest.len());
    let before = &line[..line.len() - rest.len()];
    let is_apart = !before.ends_with(|character: char| !character.is_whitespace())
        && !rest[len..].starts_with(|character: char| !character.is_whitespace());
    match (rest[..len].contains('>'), rest[..len].contains('<')) {
        (true, false) if is_apart || len > 1 => tokens.push(Token::Arrow(Speaker::Host)),
        (false, true) if is_apart || len > 1 => tokens.push(Token::Arrow(Speaker::Arm)),
        _ => tokens.extend(rest[..len].chars().map(Token::Mark)),
    }
    len
}
