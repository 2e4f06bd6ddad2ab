//! Bytes in hexadecimal, with or without prefixes, brackets or quotes around each.

use super::column::before_column;
use super::direction::{direction, is_between, names_port};
use super::time::is_time;
use super::token::Token;
use super::word::{Word, decimal, is_decimal, short_byte};
use crate::args::Speaker;
use crate::decode::doubts::Doubt;
use crate::printable::cut;

/// The fewest bytes that a word without a mark may precede: words such as "be" are hexadecimal, too.
const MIN_RUN: usize = 3;
/// The shortest offset before a colon, and the shortest address behind 0x, in digits.
const MIN_OFFSET: usize = 4;
const MIN_ADDRESS: usize = 8;

/// The bytes of a line.
#[derive(Debug, PartialEq)]
pub(in super::super) struct Found {
    /// The sender, if the line or the one before names it.
    pub(in super::super) from: Option<Speaker>,
    pub(in super::super) bytes: Vec<u8>,
    /// Nothing is before them.
    pub(super) is_alone: bool,
}

impl Found {
    pub(super) fn new(from: Option<Speaker>, bytes: Vec<u8>) -> Self {
        let is_alone = false;
        Self { from, bytes, is_alone }
    }
}

/// Properties of a log, found in its earlier lines.
#[derive(Default)]
pub(super) struct Habits {
    /// No count is between the prefix and the bytes.
    has_no_count: bool,
    /// The token that bytes begin with.
    start: Option<usize>,
    /// Bytes below 16 have one digit.
    has_short_bytes: bool,
    /// Numbers are decimal.
    has_decimals: bool,
}

/// The bytes of a word: pairs of digits, or 0x and one or two, separated by dashes or colons. `None` for other words.
fn bytes_of(word: &str) -> Option<Vec<u8>> {
    if let Some(digits) = word.strip_suffix(['h', 'H']) {
        // Assemblers write a zero before a letter.
        let digits = digits
            .strip_prefix('0')
            .filter(|digits| digits.len() == 2)
            .unwrap_or(digits);
        let is_byte = digits.len() == 2 && digits.bytes().all(|digit| digit.is_ascii_hexdigit());
        return u8::from_str_radix(digits, 16)
            .ok()
            .filter(|_| is_byte)
            .map(|byte| vec![byte]);
    }
    let mut bytes = Vec::new();
    for part in word.split(['-', ':']) {
        let prefixed = part.strip_prefix("0x").or(part.strip_prefix("0X"));
        let digits = prefixed.unwrap_or(part);
        let is_short = prefixed.is_some() && digits.len() == 1;
        let is_even = !digits.is_empty() && digits.len() % 2 == 0;
        if !(is_short || is_even) || !digits.bytes().all(|digit| digit.is_ascii_hexdigit()) {
            return None;
        }
        // Words such as 2024-01-01 are no bytes.
        if word.len() != part.len() && digits.len() > 2 {
            return None;
        }
        if is_short {
            bytes.extend(u8::from_str_radix(digits, 16));
        }
        for at in (0..digits.len() & !1).step_by(2) {
            bytes.extend(u8::from_str_radix(&digits[at..at + 2], 16));
        }
    }
    Some(bytes)
}

/// The bytes of a word in a run.
fn run_bytes(word: &str) -> Option<Vec<u8>> {
    bytes_of(word).or_else(|| short_byte(word).map(|byte| vec![byte]))
}

/// Adjacent words in hexadecimal.
#[derive(Clone)]
struct Run<'a> {
    at: usize,
    end: usize,
    words: Vec<Word<'a>>,
}

/// Returns true for a word that may be bytes with a mistake in it. Others, such as "and", end the bytes.
fn may_be_bytes(word: &Word<'_>) -> bool {
    let has_digits = word.text.contains(|character: char| character.is_ascii_digit());
    let is_short = word.text.len() <= 2 && word.text.contains(|character: char| character.is_ascii_alphabetic());
    has_digits || is_short
}

/// Returns true for a word of two characters with a digit: a byte with a mistake in it.
fn is_wrong_byte(word: &str) -> bool {
    word.chars().count() == 2 && word.contains(|character: char| character.is_ascii_digit())
}

impl Run<'_> {
    fn bytes(&self) -> Vec<u8> {
        self.words
            .iter()
            .filter_map(|word| run_bytes(word.text))
            .flatten()
            .collect()
    }

    fn has_short_bytes(&self) -> bool {
        self.words.iter().any(|word| short_byte(word.text).is_some())
    }

    /// Returns true for a number that may count something, a word such as "be", or one byte.
    fn is_weak(&self) -> bool {
        let [word] = self.words[..] else { return false };
        let is_word = word.text.bytes().all(|byte| byte.is_ascii_alphabetic());
        is_decimal(word.text) || is_word || word.text.len() == 2 || is_time(word.text)
    }

    /// Returns true if the run has another form than this word behind it. An address has a prefix, bytes behind it none.
    fn is_before(&self, word: &str) -> bool {
        let is_prefixed = |word: &str| word.starts_with("0x") || word.starts_with("0X");
        let is_suffixed = |word: &str| word.ends_with(['h', 'H']);
        let last = self.words.last().map_or("", |word| word.text);
        is_suffixed(last) != is_suffixed(word) || is_prefixed(word) && !is_prefixed(last)
    }

    /// Returns true for an offset with a colon. Bytes that go on in the next line may end with a colon, too.
    fn is_offset(&self, next: Option<&Token<'_>>) -> bool {
        let is_offset = |word: &Word<'_>| word.text.len() >= MIN_OFFSET && !word.text.contains([':', '-']);
        matches!(&self.words[..], [word] if is_offset(word)) && next == Some(&Token::Mark(':'))
    }

    /// Returns true for the names of columns: D0, D1, D2.
    fn is_heading(&self) -> bool {
        let numbers: Vec<_> = self
            .words
            .iter()
            .filter_map(|word| u8::from_str_radix(word.text, 16).ok())
            .collect();
        let are_names = self
            .words
            .iter()
            .all(|word| word.text.starts_with(['d', 'D', 'b', 'B']));
        numbers.len() >= MIN_RUN && are_names && numbers.windows(2).all(|pair| pair[1].checked_sub(pair[0]) == Some(1))
    }

    /// Returns true if the run has the form of bytes with one or two digits each.
    fn may_have_short_bytes(&self) -> bool {
        self.words.len() >= MIN_RUN && self.words.iter().all(|word| word.text.len() <= 2)
    }

    fn has_letters(&self) -> bool {
        self.words.iter().any(|word| !is_decimal(word.text))
    }
}

/// The runs of a line, with words of one digit in them.
fn joined<'a>(tokens: &[Token<'a>]) -> Vec<Run<'a>> {
    let mut runs: Vec<Run<'a>> = Vec::new();
    for (at, token) in tokens.iter().enumerate() {
        match token {
            Token::Word(word) if run_bytes(word.text).is_some() => {
                let last = runs
                    .last_mut()
                    .filter(|run| are_adjacent(tokens, run, at) && !run.is_before(word.text));
                match last {
                    Some(run) => {
                        run.words.push(*word);
                        run.end = at + 1;
                    }
                    None => runs.push(Run {
                        at,
                        end: at + 1,
                        words: vec![*word],
                    }),
                }
            }
            Token::Comma => {
                if let Some(run) = runs.last_mut().filter(|run| run.end == at) {
                    run.end = at + 1;
                }
            }
            _ => {}
        }
    }
    runs
}

/// Returns true if the word `at` is behind a run, or if both have the same marks around them: `[AA][06]`, `'AA', '06'`.
fn are_adjacent(tokens: &[Token<'_>], run: &Run<'_>, at: usize) -> bool {
    use Token::{Comma, Mark};
    let before = run.at.checked_sub(1).and_then(|before| tokens.get(before));
    match tokens.get(run.end..at) {
        Some([]) => true,
        // An array of Java.
        Some([Mark('('), Token::Word(word), Mark(')')]) => word.text == "byte",
        Some([Mark(mark @ ('#' | '$'))]) => before == Some(&Mark(*mark)),
        Some([Mark(']'), Mark('[')] | [Mark('>'), Mark('<')] | [Mark(')'), Mark('(')]) => true,
        Some([Mark(close @ ('\'' | '"')), Comma, Mark(open)]) => {
            close == open && before == Some(&Mark(*open)) && tokens.get(at + 1) == Some(&Mark(*open))
        }
        _ => false,
    }
}

/// Returns true if a mark or nothing is before the run.
fn is_marked(tokens: &[Token<'_>], run: &Run<'_>) -> bool {
    match run.at.checked_sub(1).and_then(|before| tokens.get(before)) {
        None | Some(Token::Mark(_) | Token::Arrow(_)) => true,
        Some(Token::Word(_) | Token::Comma) => false,
    }
}

/// The runs of a line. Words of one digit are bytes only where others have letters, or had them before.
fn runs<'a>(tokens: &[Token<'a>], habits: &Habits) -> Result<Vec<Run<'a>>, Doubt> {
    let mut runs = Vec::new();
    for run in joined(tokens) {
        let is_whole = run.at == 0 && run.end == tokens.len();
        let is_closed = !matches!(tokens.get(run.end), Some(Token::Word(_)));
        let is_apart = is_closed && (is_marked(tokens, &run) || is_named(tokens, &run));
        if !run.has_short_bytes()
            || is_apart && run.may_have_short_bytes() && (run.has_letters() || habits.has_short_bytes)
        {
            runs.push(run);
        } else if is_whole && run.may_have_short_bytes() {
            let text = "the numbers may be decimal (--format dec) or bytes in hexadecimal";
            return Err(Doubt::new("ambiguous bytes", text));
        } else {
            runs.extend(without_short_bytes(&run, tokens));
        }
    }
    Ok(runs)
}

/// The parts of a run between its words of one digit.
fn without_short_bytes<'a>(run: &Run<'a>, tokens: &[Token<'a>]) -> Vec<Run<'a>> {
    let mut parts: Vec<Run<'a>> = Vec::new();
    for at in run.at..run.end {
        let Some(Token::Word(word)) = tokens.get(at) else {
            if let Some(part) = parts.last_mut().filter(|part| part.end == at) {
                part.end = at + 1;
            }
            continue;
        };
        if short_byte(word.text).is_some() {
            continue;
        }
        match parts.last_mut().filter(|part| part.end == at) {
            Some(part) => {
                part.words.push(*word);
                part.end = at + 1;
            }
            None => parts.push(Run {
                at,
                end: at + 1,
                words: vec![*word],
            }),
        }
    }
    parts
}

/// Returns true if the direction or the port of the bytes is before the run.
fn is_named(tokens: &[Token<'_>], run: &Run<'_>) -> bool {
    let named = direction(tokens, run.at).is_some_and(|(at, _)| is_between(&tokens[at + 1..run.at]));
    named || names_port(&tokens[..run.at])
}

/// The bytes of decimal numbers behind a direction, up to the end of the line. One of them has three digits, here or in
/// an earlier line.
fn decimals(tokens: &[Token<'_>], habits: &mut Habits) -> Result<Option<Found>, Doubt> {
    let Some((at, from)) = direction(tokens, tokens.len()) else {
        return Ok(None);
    };
    let Some(words) = numbers_behind(&tokens[at + 1..]) else {
        return Ok(None);
    };
    // Some programs write three digits of each.
    let are_padded = words.iter().all(|word| word.len() == 3 && is_decimal(word));
    let byte = |word: &&str| if are_padded { word.parse().ok() } else { decimal(word) };
    let bytes: Option<Vec<u8>> = words.iter().map(byte).collect();
    if are_padded && bytes.is_none() && words.len() >= MIN_RUN {
        let text = "numbers of three digits, of which one is more than a byte in decimal";
        return Err(Doubt::new("unknown form of bytes", text));
    }
    let is_decimal = habits.has_decimals || words.iter().any(|word| word.len() == 3);
    let Some(bytes) = bytes.filter(|bytes| is_decimal && !bytes.is_empty()) else {
        return Ok(None);
    };
    let before = direction(tokens, at).and_then(|(before, _)| numbers_behind(&tokens[before + 1..at]));
    let is_byte = |word: &&str| decimal(word).is_some();
    if before.is_some_and(|words| words.len() >= MIN_RUN && words.iter().all(is_byte)) {
        return Err(two_runs());
    }
    habits.has_decimals = true;
    Ok(Some(Found::new(Some(from), bytes)))
}

/// The words behind a direction, if only commas or angle brackets are between them. Other marks before a number make it
/// no byte: `sent #123`, `got -100`.
fn numbers_behind<'a>(tokens: &[Token<'a>]) -> Option<Vec<&'a str>> {
    // Docklight writes `[TX] - 170 006`.
    let tokens = match tokens {
        [Token::Mark(']'), Token::Mark('-'), rest @ ..] => rest,
        _ => tokens,
    };
    let is_before = |token: &Token<'_>| {
        matches!(token, Token::Mark('<' | ']') | Token::Arrow(_)) || is_between(std::slice::from_ref(token))
    };
    let start = tokens.iter().position(|token| !is_before(token))?;
    let is_separator = |token: &&Token<'_>| matches!(token, Token::Comma | Token::Mark('<' | '>'));
    let words = tokens[start..].iter().filter(|token| !is_separator(token));
    words
        .map(|token| match token {
            Token::Word(word) => Some(word.text),
            _ => None,
        })
        .collect()
}

/// The bytes in hexadecimal.
pub(super) fn find(line: &str, tokens: &[Token<'_>], habits: &mut Habits) -> Result<Option<Found>, Doubt> {
    if let Some(found) = decimals(tokens, habits)? {
        return Ok(Some(found));
    }
    let runs = runs(tokens, habits)?;
    let direction = direction(tokens, tokens.len())
        .filter(|(at, _)| runs.iter().any(|run| run.at > *at))
        .map(|(at, from)| (at + 1, from));
    let (start, from) = direction.map_or((0, None), |(at, from)| (at, Some(from)));
    if runs.iter().any(|run| run.at < start && may_be_message(tokens, run)) {
        return Err(two_runs());
    }
    let mut found: Option<Run<'_>> = None;
    for mut run in runs.into_iter().filter(|run| run.at >= start) {
        let next = tokens.get(run.end);
        if run.is_offset(next) || run.is_heading() {
            continue;
        }
        let is_apart = is_marked(tokens, &run);
        let is_named = is_named(tokens, &run);
        let has_column = cut_at_column(line, &mut run);
        let is_cut =
            !has_column && matches!(next, Some(Token::Word(word)) if run.words.len() < MIN_RUN || may_be_bytes(word));
        if let Some(Token::Word(word)) = next
            && is_cut
            && (is_apart || is_named)
            && (run.words.len() >= MIN_RUN || run.words.len() > 1 && is_wrong_byte(word.text))
        {
            let text = format!("'{}' is not a byte or bytes in hexadecimal", cut(word.text));
            return Err(Doubt::new("no bytes in hexadecimal", text));
        }
        let is_short = run.bytes().len() < MIN_RUN && !is_apart;
        if is_cut || !is_named && (run.is_weak() || is_short) {
            continue;
        }
        // The column of characters, behind the bytes.
        if let Some(before) = &found {
            // A byte alone, such as a checksum.
            if before.bytes().len() >= MIN_RUN && run.bytes().len() == 1 {
                continue;
            }
            let is_behind_bar = tokens[before.end..run.at].contains(&Token::Mark('|'));
            if is_behind_bar && !may_be_message(tokens, &run) {
                continue;
            }
            return Err(two_runs());
        }
        check_first(&mut run, is_apart || is_named, habits)?;
        found = Some(run);
        if has_column {
            break;
        }
    }
    let Some(run) = found else {
        return match looks_like_bytes(tokens) {
            true => Err(Doubt::new(
                "unknown form of bytes",
                "the line may have bytes, in a form that is not read",
            )),
            false => Ok(None),
        };
    };
    habits.has_short_bytes |= run.has_short_bytes();
    let is_alone = run.at == 0;
    let bytes = run.bytes();
    Ok(Some(Found { from, bytes, is_alone }))
}

/// Returns true for a byte alone that other lines of its kind may go on, and for words behind a direction most of which
/// have the digits of a byte: `AA/06/00`, `&HAA &H06 &H00`. One of them has a letter: other numbers have none.
fn looks_like_bytes(tokens: &[Token<'_>]) -> bool {
    let has_letter = |digits: &&str| !is_decimal(digits);
    if let [Token::Word(word)] = tokens {
        return byte_digits(word.text).is_some_and(|digits| has_letter(&digits) && digits.len() == word.text.len());
    }
    let Some((at, _)) = direction(tokens, tokens.len()) else {
        return false;
    };
    let words = tokens[at + 1..].iter().filter_map(|token| match token {
        Token::Word(word) => Some(word.text),
        _ => None,
    });
    let parts = words.flat_map(|word| word.split(|character: char| !character.is_alphanumeric()));
    let parts: Vec<_> = parts.filter(|part| !part.is_empty()).collect();
    let bytes: Vec<_> = parts.iter().filter_map(|part| byte_digits(part)).collect();
    bytes.len() >= MIN_RUN && 4 * bytes.len() >= 3 * parts.len() && bytes.iter().any(has_letter)
}

/// The two digits of a byte, without a prefix or a suffix of a language.
fn byte_digits(word: &str) -> Option<&str> {
    let digits = word.strip_prefix("0x").unwrap_or(word);
    let digits = digits.trim_start_matches(['H', 'h', 'x']).trim_end_matches(['u', 'U']);
    let is_byte = digits.len() == 2 && digits.bytes().all(|digit| digit.is_ascii_hexdigit());
    is_byte.then_some(digits)
}

/// Returns true for a run that may be a frame before another one, and is no offset, heading, address or time.
fn may_be_message(tokens: &[Token<'_>], run: &Run<'_>) -> bool {
    let next = tokens.get(run.end);
    let is_prefix = match run.words[..] {
        [word] => {
            let is_plain = !word.text.contains([':', '-']);
            let is_before_arrow = matches!(next, Some(Token::Arrow(_)));
            run.is_weak() || is_plain && !is_before_arrow && !is_named(tokens, run)
        }
        _ => run.is_heading() || run.words.iter().all(|word| is_time(word.text)),
    };
    run.bytes().len() >= MIN_RUN && !run.is_offset(next) && !is_prefix
}

fn two_runs() -> Doubt {
    let text = "two runs of bytes are in the line, and either may be a part of the prefix";
    Doubt::new("ambiguous bytes", text)
}

/// Leaves out the words of a column of characters, and an offset that the column does not show. Returns true if there is
/// a column.
fn cut_at_column(line: &str, run: &mut Run<'_>) -> bool {
    let [first, rest @ ..] = &run.words[..] else {
        return false;
    };
    let behind = before_column(line, rest, run_bytes);
    let count = before_column(line, &run.words, run_bytes);
    // Dots fit to any bytes: a longer word is an offset if it may be one.
    let is_longer = rest.iter().all(|word| word.text.len() < first.text.len());
    match (count, behind) {
        (_, Some(count)) if is_longer && count > 0 => {
            run.words.truncate(1 + count);
            run.words.remove(0);
        }
        (Some(count), _) => run.words.truncate(count),
        (None, Some(count)) => {
            run.words.truncate(1 + count);
            run.words.remove(0);
        }
        (None, None) => return false,
    }
    true
}

/// Checks that the first word of a run is no number of the prefix. Leaves out an address.
fn check_first(run: &mut Run<'_>, is_apart: bool, habits: &mut Habits) -> Result<(), Doubt> {
    let [first, ref rest @ ..] = run.words[..] else {
        return Ok(());
    };
    if rest.is_empty() {
        return Ok(());
    }
    let ambiguous = |what: &str| {
        let text = format!(
            "'{}' may be {what} before the bytes, or the first of them",
            cut(first.text)
        );
        Err(Doubt::new("ambiguous bytes", text))
    };
    if is_time(first.text) && !rest.iter().any(|word| word.text.contains([':', '-'])) {
        run.words.remove(0);
        return check_first(run, true, habits);
    }
    let are_digits = |word: &str| {
        word.trim_start_matches("0x")
            .bytes()
            .all(|digit| digit.is_ascii_hexdigit())
    };
    let is_longer =
        first.text.len() > MIN_OFFSET && are_digits(first.text) && rest.iter().all(|word| word.text.len() <= 2);
    if is_longer {
        let digits = first.text.strip_prefix("0x").unwrap_or_default();
        if digits.len() < MIN_ADDRESS {
            return ambiguous("an offset");
        }
        run.words.remove(0);
        return Ok(());
    }
    if !is_decimal(first.text) {
        habits.has_no_count |= is_apart;
        habits.start = Some(run.at);
        return Ok(());
    }
    let is_other = rest.iter().all(|word| word.text.len() > first.text.len())
        || rest.iter().all(|word| word.text.len() < first.text.len());
    let count = run.bytes().len() - 1;
    let is_known = habits.start == Some(run.at);
    let is_count = !habits.has_no_count && !is_known && first.text.parse() == Ok(count);
    let may_be_prefix = !is_apart && run.at > 0 && !is_known;
    match may_be_prefix || is_other || is_count {
        true => ambiguous("a number"),
        false => Ok(()),
    }
}
