//! Bytes in the lines of a log: behind a prefix, in hexadecimal, as bytes of Python, or as a list or an array.

use crate::args::Speaker;
use crate::printable::cut;

/// Words before bytes that name their direction, as the program that controls the arm sees it. Those that are usual in
/// other places count with a colon only.
const DIRECTIONS: [(&str, Speaker, bool); 38] = [
    ("tx", Speaker::Host, false),
    ("txd", Speaker::Host, false),
    ("send", Speaker::Host, false),
    ("sent", Speaker::Host, false),
    ("sending", Speaker::Host, false),
    ("write", Speaker::Host, false),
    ("writing", Speaker::Host, false),
    ("wrote", Speaker::Host, false),
    ("written", Speaker::Host, false),
    ("transmit", Speaker::Host, false),
    ("transmitted", Speaker::Host, false),
    ("request", Speaker::Host, false),
    ("req", Speaker::Host, false),
    ("out", Speaker::Host, true),
    ("cmd", Speaker::Host, true),
    ("command", Speaker::Host, true),
    ("host", Speaker::Host, true),
    ("to arm", Speaker::Host, true),
    ("w", Speaker::Host, true),
    ("t", Speaker::Host, true),
    ("rx", Speaker::Arm, false),
    ("rxd", Speaker::Arm, false),
    ("recv", Speaker::Arm, false),
    ("received", Speaker::Arm, false),
    ("receive", Speaker::Arm, false),
    ("receiving", Speaker::Arm, false),
    ("read", Speaker::Arm, false),
    ("reading", Speaker::Arm, false),
    ("response", Speaker::Arm, false),
    ("resp", Speaker::Arm, false),
    ("reply", Speaker::Arm, false),
    ("answer", Speaker::Arm, false),
    ("in", Speaker::Arm, true),
    ("ack", Speaker::Arm, true),
    ("from arm", Speaker::Arm, true),
    ("got", Speaker::Arm, false),
    ("r", Speaker::Arm, true),
    ("rcvd", Speaker::Arm, false),
];

/// The fewest bytes that a word without a mark may precede: words such as "be" are hexadecimal, too.
const MIN_RUN: usize = 3;

/// The bytes of a line.
#[derive(Debug, PartialEq)]
pub(in super::super) struct Found {
    /// The sender, if the line names it.
    pub(in super::super) from: Option<Speaker>,
    pub(in super::super) bytes: Vec<u8>,
}

/// A part of a line.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Token<'a> {
    Word(&'a str),
    /// A bracket, a quote, a colon behind a word, or the like.
    Mark(char),
    Arrow(Speaker),
    Comma,
}

/// The bytes of a line, if there are any. The error is the reason in words.
pub(in super::super) fn find(line: &str) -> Result<Option<Found>, String> {
    if let Some((before, literal)) = python_literal(line)? {
        let tokens = tokens(before);
        let from = direction(&tokens, tokens.len()).map(|(_, from)| from);
        return Ok(Some(Found { from, bytes: literal }));
    }
    let tokens = tokens(line);
    match list(&tokens)? {
        Some((at, bytes)) => Ok(Some(Found {
            from: direction(&tokens, at).map(|(_, from)| from),
            bytes,
        })),
        None => run(&tokens),
    }
}

/// Returns true if the first word of a line may be a time of day or a date as well as bytes, with others behind it.
pub(in super::super) fn begins_with_time_or_bytes(line: &str) -> bool {
    let mut words = line.split_whitespace();
    words.next().is_some_and(is_time) && words.next().is_some()
}

/// Returns true for `12:34:56` and `24-01-31`.
fn is_time(word: &str) -> bool {
    let parts = |mark| {
        let parts: Vec<u8> = word.split(mark).filter_map(|part| part.parse().ok()).collect();
        let is_all = word.len() == 8 && word.split(mark).all(|part| part.len() == 2);
        is_all.then_some(parts).filter(|parts| parts.len() == 3)
    };
    parts(':').is_some_and(|time| time[0] < 24 && time[1] < 60 && time[2] < 61)
        || parts('-').is_some_and(|date| (1..=12).contains(&date[1]) && (1..=31).contains(&date[2]))
}

/// The bytes of `b'...'`, and the text before it.
fn python_literal(line: &str) -> Result<Option<(&str, Vec<u8>)>, String> {
    let mut found = None;
    let mut rest = 0;
    while let Some(at) = line[rest..]
        .find("b'")
        .into_iter()
        .chain(line[rest..].find("b\""))
        .min()
    {
        let at = rest + at;
        rest = at + 2;
        if line[..at].ends_with(|before: char| before.is_alphanumeric() || before == '_') {
            continue;
        }
        if found.is_some() {
            return Err("two byte strings are in the line, and either may be the bytes of the arm's line".to_owned());
        }
        let (bytes, len) = unescaped(&line[rest..], &line[at + 1..rest])?;
        rest += len;
        found = Some((&line[..at], bytes));
    }
    Ok(found)
}

/// The bytes up to the quote, and the number of characters with it.
fn unescaped(text: &str, quote: &str) -> Result<(Vec<u8>, usize), String> {
    let mut bytes = Vec::new();
    let mut rest = text;
    loop {
        if let Some(after) = rest.strip_prefix(quote) {
            return Ok((bytes, text.len() - after.len()));
        }
        let mut characters = rest.chars();
        let byte = match (characters.next(), characters.clone().next()) {
            (None, _) => return Err("the byte string does not end on its line".to_owned()),
            (Some('\\'), Some(escape)) => {
                characters.next();
                match escape {
                    'n' => b'\n',
                    'r' => b'\r',
                    't' => b'\t',
                    'a' => 7,
                    'b' => 8,
                    'f' => 12,
                    'v' => 11,
                    '\\' | '\'' | '"' => escape as u8,
                    'x' => {
                        let digits = rest
                            .get(2..4)
                            .filter(|digits| digits.bytes().all(|byte| byte.is_ascii_hexdigit()));
                        characters.nth(1);
                        digits
                            .and_then(|digits| u8::from_str_radix(digits, 16).ok())
                            .ok_or("an escape of the byte string has not two digits")?
                    }
                    other => return Err(format!("'\\{}' is no escape of a byte string", other.escape_default())),
                }
            }
            (Some(character), _) if character.is_ascii() => character as u8,
            (Some(_), _) => return Err("a byte string has ASCII characters only".to_owned()),
        };
        bytes.push(byte);
        rest = characters.as_str();
    }
}

fn tokens(line: &str) -> Vec<Token<'_>> {
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
            '[' | ']' | '(' | ')' | '{' | '}' | '|' | '"' | '\'' | ':' | '#' => {
                tokens.push(Token::Mark(first));
                first.len_utf8()
            }
            _ => {
                let is_end = |character: char| character.is_whitespace() || ",;[](){}|\"'#=<>→←".contains(character);
                let word = &rest[..rest.find(is_end).unwrap_or(rest.len())];
                let trimmed = word.trim_end_matches([':', '-']);
                // A dash between a word and an angle bracket belongs to the arrow.
                let trimmed = if trimmed.is_empty() { word } else { trimmed };
                tokens.push(Token::Word(trimmed));
                trimmed.len()
            }
        };
        rest = &rest[len..];
    }
    tokens
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

/// The last direction before the token `end`, and its place.
fn direction(tokens: &[Token<'_>], end: usize) -> Option<(usize, Speaker)> {
    let tokens = &tokens[..end.min(tokens.len())];
    let named = |(at, token): (usize, &Token<'_>)| match token {
        Token::Arrow(from) => Some((at, *from)),
        Token::Word(word) => {
            let has_colon = matches!(tokens.get(at + 1), Some(Token::Mark(':')));
            let word = word.to_ascii_lowercase();
            let found = DIRECTIONS.into_iter().find(|(name, _, needs_colon)| {
                (word == *name
                    || word
                        .strip_suffix(name)
                        .is_some_and(|front| front.ends_with(['.', '/', '_'])))
                    && (has_colon || !needs_colon)
            });
            found.map(|(_, from, _)| (at, from))
        }
        _ => None,
    };
    // `PC -> arm RX` has two: a word says more than an arrow.
    let all: Vec<_> = tokens.iter().enumerate().filter_map(named).collect();
    let is_word = |(at, _): &&(usize, Speaker)| matches!(tokens[*at], Token::Word(_));
    all.iter().rev().find(is_word).or(all.last()).copied()
}

/// The numbers of a list of Python, or of an array: decimal, and separated by commas. Also the place of its bracket.
fn list(tokens: &[Token<'_>]) -> Result<Option<(usize, Vec<u8>)>, String> {
    let mut found = None;
    for (at, _) in tokens
        .iter()
        .enumerate()
        .filter(|(_, token)| matches!(token, Token::Mark('[' | '{' | '(')))
    {
        let inner = &tokens[at + 1..];
        let is_item = |token: &Token<'_>| matches!(token, Token::Word(_) | Token::Comma);
        let len = inner.iter().position(|token| !is_item(token)).unwrap_or(inner.len());
        let words: Vec<_> = inner[..len]
            .iter()
            .filter_map(|token| match token {
                Token::Word(word) => Some(*word),
                _ => None,
            })
            .collect();
        let commas = len - words.len();
        let is_decimal = |word: &&str| word.parse::<u16>().is_ok() && (word.len() == 1 || !word.starts_with('0'));
        if words.is_empty() || !words.iter().all(is_decimal) {
            continue;
        }
        let is_closed = matches!(inner.get(len), Some(Token::Mark(']' | '}' | ')')));
        if !is_closed {
            if commas > 0 {
                return Err("a list in decimal does not end on its line".to_owned());
            }
            continue;
        }
        let is_last = inner.len() == len + 1 || inner[len + 1..].iter().all(|token| *token == Token::Comma);
        let is_alone = words.len() == 1 && is_last && (at == 0 || direction(tokens, at).is_some());
        let is_spaced = commas == 0 && words.len() >= MIN_RUN;
        if is_spaced && words.iter().all(|word| word.len() == 2) {
            return Err(
                "the numbers in brackets may be decimal or hexadecimal: separate decimal ones by commas".to_owned(),
            );
        }
        if !(commas > 0 && words.len() > 1 || is_alone || is_spaced) {
            continue;
        }
        let bytes: Option<Vec<u8>> = words.iter().map(|word| word.parse().ok()).collect();
        // Other numbers are no bytes, such as a size.
        let Some(bytes) = bytes else { continue };
        if found.replace((at, bytes)).is_some() {
            return Err("two lists are in the line, and either may be the bytes of the arm's line".to_owned());
        }
    }
    Ok(found)
}

/// The bytes of a word: pairs of digits, or 0x and one or two, separated by dashes or colons. `None` for other words.
fn bytes_of(word: &str) -> Option<Vec<u8>> {
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

/// Adjacent words in hexadecimal.
struct Run<'a> {
    at: usize,
    end: usize,
    words: Vec<&'a str>,
}

impl Run<'_> {
    fn is_decimal(word: &str) -> bool {
        word.bytes().all(|byte| byte.is_ascii_digit())
    }

    fn bytes(&self) -> Vec<u8> {
        self.words.iter().filter_map(|word| bytes_of(word)).flatten().collect()
    }

    /// Returns true for a number that may count something, or a word such as "be".
    fn is_weak(&self) -> bool {
        let [word] = self.words[..] else { return false };
        let is_word = word.bytes().all(|byte| byte.is_ascii_alphabetic());
        Self::is_decimal(word) || is_word || is_time(word)
    }
}

fn runs<'a>(tokens: &[Token<'a>]) -> Vec<Run<'a>> {
    let mut runs: Vec<Run<'a>> = Vec::new();
    for (at, token) in tokens.iter().enumerate() {
        match token {
            Token::Word(word) if bytes_of(word).is_some() => match runs.last_mut().filter(|run| run.end == at) {
                Some(run) => {
                    run.words.push(word);
                    run.end = at + 1;
                }
                None => runs.push(Run {
                    at,
                    end: at + 1,
                    words: vec![word],
                }),
            },
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

/// The bytes in hexadecimal.
fn run(tokens: &[Token<'_>]) -> Result<Option<Found>, String> {
    let runs = runs(tokens);
    let direction = direction(tokens, tokens.len())
        .filter(|(at, _)| runs.iter().any(|run| run.at > *at))
        .map(|(at, from)| (at + 1, from));
    let (start, from) = direction.map_or((0, None), |(at, from)| (at, Some(from)));
    let mut found: Option<&Run<'_>> = None;
    for run in runs.iter().filter(|run| run.at >= start) {
        let is_marked = match run.at.checked_sub(1).and_then(|before| tokens.get(before)) {
            None | Some(Token::Mark(_) | Token::Arrow(_)) => true,
            Some(Token::Word(_) | Token::Comma) => false,
        };
        let is_named = start > 0 && tokens[start..run.at].iter().all(|token| *token == Token::Mark(':'));
        let next = tokens.get(run.end);
        let is_cut = matches!(next, Some(Token::Word(_)));
        if is_cut && run.words.len() >= MIN_RUN && (is_marked || is_named) {
            let Some(Token::Word(word)) = next else { continue };
            return Err(format!("'{}' is not a byte or bytes in hexadecimal", cut(word)));
        }
        let is_short = run.bytes().len() < MIN_RUN && !is_marked;
        if is_cut || !is_named && (run.is_weak() || is_short) {
            continue;
        }
        // The column of characters, behind the bytes.
        if let Some(before) = found {
            if tokens[before.end..run.at].contains(&Token::Mark('|')) {
                continue;
            }
            return Err("two runs of bytes are in the line, and either may be a part of the prefix".to_owned());
        }
        check_first(run, is_marked || is_named)?;
        found = Some(run);
    }
    Ok(found.map(|run| {
        let bytes = match run.words[..] {
            // A time of day before the bytes.
            [time, ref rest @ ..] if run.at == 0 && is_time(time) && !rest.is_empty() => {
                rest.iter().filter_map(|word| bytes_of(word)).flatten().collect()
            }
            _ => run.bytes(),
        };
        Found { from, bytes }
    }))
}

/// Checks that the first word of a run is no number of the prefix.
fn check_first(run: &Run<'_>, is_marked: bool) -> Result<(), String> {
    let [first, ref rest @ ..] = run.words[..] else {
        return Ok(());
    };
    if rest.is_empty() || !Run::is_decimal(first) {
        return Ok(());
    }
    let is_other = rest.iter().all(|word| word.len() != first.len());
    let count = run.bytes().len() - 1;
    let is_count = count > 0 && first.len() == 2 && first.parse() == Ok(count);
    match (!is_marked && run.at > 0) || is_other || is_count {
        true => Err(format!(
            "'{}' may be a number before the bytes, or the first of them",
            cut(first)
        )),
        false => Ok(()),
    }
}
