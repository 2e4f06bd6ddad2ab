//! Lists and arrays of decimal numbers, on one line or over several.

use super::direction::{direction, is_between};
use super::token::Token;
use crate::args::Speaker;
use crate::decode::doubts::Doubt;

/// The fewest numbers of a list without commas.
const MIN_SPACED: usize = 3;

/// The lists of a line.
pub(super) struct Lists {
    pub(super) from: Option<Speaker>,
    pub(super) bytes: Vec<u8>,
    /// The list goes on in the next line.
    pub(super) is_open: bool,
}

/// The numbers of a list of Python, or of an array: decimal, and separated by commas.
pub(super) fn find(tokens: &[Token<'_>]) -> Result<Option<Lists>, Doubt> {
    let mut found: Option<(usize, Lists)> = None;
    for (at, token) in tokens.iter().enumerate() {
        let Token::Mark(bracket @ ('[' | '{' | '(')) = token else {
            continue;
        };
        let Some(list) = list(tokens, at, *bracket)? else {
            continue;
        };
        match &mut found {
            None => {
                found = Some((
                    list.end,
                    Lists {
                        from: direction(tokens, at).map(|(_, from)| from),
                        ..list.lists
                    },
                ))
            }
            Some((end, lists)) if are_joined(&tokens[*end..at]) => {
                lists.bytes.extend(list.lists.bytes);
                lists.is_open = list.lists.is_open;
                *end = list.end;
            }
            Some(_) => {
                let text = "two lists are in the line, and either may be the bytes of the arm's line";
                return Err(Doubt::new("ambiguous bytes", text));
            }
        }
    }
    Ok(found.map(|(_, lists)| lists))
}

/// Returns true if only commas and brackets are between two lists.
fn are_joined(between: &[Token<'_>]) -> bool {
    between
        .iter()
        .all(|token| matches!(token, Token::Comma | Token::Mark('[' | ']' | '{' | '}' | '(' | ')')))
}

/// A list, and the token behind it.
struct List {
    lists: Lists,
    end: usize,
}

/// The list behind the bracket `at`.
fn list(tokens: &[Token<'_>], at: usize, bracket: char) -> Result<Option<List>, Doubt> {
    let inner = &tokens[at + 1..];
    let is_item = |token: &Token<'_>| matches!(token, Token::Word(_) | Token::Comma | Token::Mark('-'));
    let len = inner.iter().position(|token| !is_item(token)).unwrap_or(inner.len());
    let Some(items) = items(&inner[..len]) else {
        return Ok(None);
    };
    let commas = inner[..len].iter().filter(|token| **token == Token::Comma).count();
    let bytes: Option<Vec<u8>> = items.iter().map(|item| item.byte()).collect();
    let list = |is_open| {
        let end = at + 1 + len;
        // Other numbers are no bytes, such as a size.
        bytes.map(|bytes| List {
            lists: Lists {
                from: None,
                bytes,
                is_open,
            },
            end,
        })
    };
    if !matches!(inner.get(len), Some(Token::Mark(']' | '}' | ')'))) {
        let goes_on = len == inner.len() && commas > 0 && bracket != '(';
        return Ok(list(true).filter(|_| goes_on));
    }
    if items.is_empty() {
        return Ok(None);
    }
    let is_last = inner.len() == len + 1 || inner[len + 1..].iter().all(|token| *token == Token::Comma);
    let is_named = || direction(tokens, at).is_some_and(|(named, _)| is_between(&tokens[named + 1..at]));
    let is_alone = items.len() == 1 && is_last && (at == 0 || is_named());
    let is_spaced = commas == 0 && items.len() >= MIN_SPACED;
    if is_spaced && items.iter().all(|item| item.text.len() == 2) {
        let text = "the numbers in brackets may be decimal or hexadecimal: separate decimal ones by commas";
        return Err(Doubt::new("ambiguous bytes", text));
    }
    Ok(list(false).filter(|_| commas > 0 && items.len() > 1 || is_alone || is_spaced))
}

/// A number of a list.
struct Item<'a> {
    text: &'a str,
    is_negative: bool,
}

impl Item<'_> {
    /// The byte; negative numbers are those of signed bytes.
    fn byte(&self) -> Option<u8> {
        let number: i16 = self.text.parse().ok()?;
        match self.is_negative {
            false => u8::try_from(number).ok(),
            true => i8::try_from(-number).ok().map(i8::cast_unsigned),
        }
    }
}

/// The numbers between commas; `None` if there is anything else.
fn items<'a>(tokens: &[Token<'a>]) -> Option<Vec<Item<'a>>> {
    let mut items = Vec::new();
    let mut is_negative = false;
    for token in tokens {
        match token {
            Token::Word(word) => {
                let is_number = word.text.bytes().all(|digit| digit.is_ascii_digit());
                if !is_number || word.text.len() > 1 && word.text.starts_with('0') {
                    return None;
                }
                items.push(Item {
                    text: word.text,
                    is_negative: std::mem::take(&mut is_negative),
                });
            }
            Token::Mark('-') if !is_negative => is_negative = true,
            Token::Comma if !is_negative => {}
            _ => return None,
        }
    }
    Some(items).filter(|_| !is_negative)
}

/// Returns true if the line ends in the bracket of a list that the next line may begin.
pub(super) fn begins(tokens: &[Token<'_>]) -> bool {
    matches!(tokens.last(), Some(Token::Mark('[' | '{')))
}

/// A line of a list that began before.
pub(super) struct Part {
    pub(super) bytes: Vec<u8>,
    /// The list goes on in the next line.
    pub(super) is_open: bool,
}

/// The numbers of a line inside a list, decimal or behind 0x; `None` if there is anything else.
pub(super) fn part(tokens: &[Token<'_>]) -> Option<Part> {
    let is_end = |token: &Token<'_>| matches!(token, Token::Mark(']' | '}'));
    let is_behind = |token: &Token<'_>| is_end(token) || *token == Token::Comma;
    let len = tokens.iter().position(is_end).unwrap_or(tokens.len());
    if !tokens[len..].iter().all(is_behind) {
        return None;
    }
    let mut bytes = Vec::new();
    // Brackets between lists of a list say nothing.
    for part in tokens[..len].split(|token| matches!(token, Token::Comma | Token::Mark('{' | '['))) {
        match part {
            [Token::Word(word)] if word.text.len() > 1 && word.text.starts_with('0') => {
                bytes.push(prefixed(word.text)?);
            }
            _ => bytes.extend(items(part)?.iter().map(Item::byte).collect::<Option<Vec<u8>>>()?),
        }
    }
    Some(Part {
        bytes,
        is_open: len == tokens.len(),
    })
}

/// A byte behind 0x.
fn prefixed(word: &str) -> Option<u8> {
    let digits = word.strip_prefix("0x").or(word.strip_prefix("0X"))?;
    u8::from_str_radix(digits, 16).ok().filter(|_| digits.len() <= 2)
}

/// The number of an item in a list of YAML: `- 170`.
pub(super) fn yaml_item(tokens: &[Token<'_>]) -> Option<u8> {
    match tokens {
        [Token::Mark('-'), number @ Token::Word(_)] => items(std::slice::from_ref(number))?.first()?.byte(),
        _ => None,
    }
}
