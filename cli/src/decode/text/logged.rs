//! Bytes in the lines of a log: behind a prefix, in hexadecimal, as bytes of Python, or as a list or an array.

use std::borrow::Cow;

use super::direction::direction;
use super::run::Found;
use super::token::{Token, tokens};
use super::{list, literal, run, stamp, table, time};
use crate::args::Speaker;
use crate::decode::doubts::Doubt;
use crate::decode::lines::LineReader;
use crate::decode::unit::{Bytes, Hint, Read, Unit};

/// A log that is being read.
#[derive(Default)]
pub(in super::super) struct Log {
    /// The list that goes on in the next line.
    list: Option<Open>,
    /// The last lines are a key of YAML, and perhaps items of its list.
    has_key: bool,
    /// The direction of a heading above the bytes.
    heading: Option<Speaker>,
    /// The column of bytes of a table.
    table: Option<table::Column>,
    habits: run::Habits,
    /// The time of the last line that has one, in ns.
    nanos: u64,
    /// The sender and the indentation of the line before, if it has bytes with a direction.
    before: Option<(Speaker, usize)>,
}

/// A list over several lines.
struct Open {
    from: Option<Speaker>,
}

impl Log {
    /// Takes the next line. Returns its bytes, if there are any. The error is the reason why they are not known.
    pub(in super::super) fn find(&mut self, line: &str) -> Result<Option<Found>, Doubt> {
        let line = with_plain_dashes(without_escapes(line));
        if let Some(nanos) = stamp::of_line(&line) {
            self.nanos = nanos;
        }
        let line = time::behind_times(&line).unwrap_or(&line);
        if line.trim().is_empty() {
            return Ok(None);
        }
        if let Some(open) = self.list.take()
            && let Some(part) = list::part(&tokens(&without_comments(line)))
        {
            let found = (!part.bytes.is_empty()).then(|| Found::new(open.from, part.bytes));
            self.list = part.is_open.then_some(open);
            return Ok(found);
        }
        if let Some(column) = table::Column::of(line) {
            self.table = Some(column);
            return Ok(None);
        }
        if let Some(column) = self.table.as_ref().filter(|column| column.is_row(line)) {
            self.nanos = column.nanos(line).unwrap_or(self.nanos);
            if let Some(byte) = column.byte(line) {
                let from = direction(&tokens(line), usize::MAX).map(|(_, from)| from);
                return Ok(Some(Found::new(from, vec![byte])));
            }
        }
        let mut found = self.find_in_line(line)?;
        if let (None, Some(column)) = (&found, &self.table)
            && column.has_columns(line)
        {
            return Err("no byte in the column of bytes".into());
        }
        match &mut found {
            Some(found) if found.from.is_none() && found.is_alone => found.from = self.heading,
            Some(_) => self.heading = None,
            None => self.read_heading(line),
        }
        Ok(found)
    }

    fn find_in_line(&mut self, line: &str) -> Result<Option<Found>, Doubt> {
        if let Some((before, bytes)) = literal::find(line)? {
            let tokens = tokens(before);
            return Ok(Some(Found::new(
                direction(&tokens, tokens.len()).map(|(_, from)| from),
                bytes,
            )));
        }
        let line = match opens_list(line) {
            true => without_comments(line),
            false => Cow::Borrowed(line),
        };
        let tokens = tokens(&line);
        if self.has_key
            && let Some(byte) = list::yaml_item(&tokens)
        {
            return Ok(Some(Found::new(None, vec![byte])));
        }
        self.has_key = line.trim_end().ends_with(':');
        if let Some(lists) = list::find(&tokens)? {
            self.list = lists.is_open.then_some(Open { from: lists.from });
            return Ok(Some(Found::new(lists.from, lists.bytes)));
        }
        if list::begins(&tokens) {
            let from = direction(&tokens, tokens.len()).map(|(_, from)| from);
            self.list = Some(Open { from });
        }
        run::find(&line, &tokens, &mut self.habits)
    }

    /// Keeps the direction of a line without bytes that has a number, such as a time. Text between frames has none.
    fn read_heading(&mut self, line: &str) {
        let tokens = tokens(line);
        if !tokens.iter().any(|token| matches!(token, Token::Word(_))) {
            return;
        }
        let named = direction(&tokens, tokens.len()).map(|(_, from)| from);
        self.heading = named.filter(|_| line.contains(|character: char| character.is_ascii_digit()));
    }
}

impl LineReader for Log {
    fn line<'a>(&mut self, line: &'a str) -> Read<'a> {
        let before = self.before.take();
        let Some(found) = self.find(line)? else {
            return Ok(Unit::NO_BYTES);
        };
        let indent = line.len() - line.trim_start().len();
        let hint = match (found.from, before) {
            (None, Some((from, first))) => {
                self.before = before;
                match found.is_alone && indent > first {
                    true => Hint::From(from),
                    false => Hint::Continued,
                }
            }
            (from, _) => {
                self.before = from.map(|from| (from, indent));
                from.into()
            }
        };
        Ok(Unit::Bytes(Bytes {
            nanos: self.nanos,
            ..Bytes::of(hint, found.bytes)
        }))
    }
}

/// The line without the colours of a terminal.
pub(in super::super) fn without_escapes(line: &str) -> Cow<'_, str> {
    const ESCAPE: &str = "\x1B[";
    if !line.contains(ESCAPE) {
        return Cow::Borrowed(line);
    }
    let mut parts = line.split(ESCAPE);
    let mut text = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let end = part.find(|character: char| !character.is_ascii_digit() && character != ';');
        text.push_str(end.and_then(|end| part.get(end + 1..)).unwrap_or_default());
    }
    Cow::Owned(text)
}

/// The line with a hyphen in place of each other dash, as word processors write it.
fn with_plain_dashes(line: Cow<'_, str>) -> Cow<'_, str> {
    const DASHES: [char; 5] = ['\u{2010}', '\u{2011}', '\u{2013}', '\u{2014}', '\u{2212}'];
    match line.contains(DASHES) {
        true => Cow::Owned(line.replace(DASHES, "-")),
        false => line,
    }
}

/// Returns true if a bracket of a list is open before a comment of C.
fn opens_list(line: &str) -> bool {
    let before = line.split("//").next().unwrap_or_default();
    let before = before.split("/*").next().unwrap_or_default();
    before.len() < line.len() && before.rfind(['[', '{']) > before.rfind([']', '}'])
}

/// The line without comments of C and Python.
fn without_comments(line: &str) -> Cow<'_, str> {
    let end = line.find("//").into_iter().chain(line.find('#')).min();
    let line = &line[..end.unwrap_or(line.len())];
    let Some(start) = line.find("/*") else {
        return Cow::Borrowed(line);
    };
    let behind = line[start..].split_once("*/").map_or("", |(_, behind)| behind);
    Cow::Owned(format!("{} {}", &line[..start], without_comments(behind)))
}
