//! The parts of a recording that are not understood, counted by kind.

use std::fmt::{self, Display};

use super::output::Output;
use crate::printable::{cut, escaped};

/// Counts of what is not understood, in the order of the first of each kind.
#[derive(Default)]
pub(super) struct Doubts(Vec<(&'static str, u64)>);

impl Doubts {
    /// Counts a part, and shows the first of its kind.
    pub(super) fn add(&mut self, place: Place<'_>, reason: &Doubt, out: &dyn Output) {
        match self.0.iter_mut().find(|(kind, _)| *kind == reason.kind) {
            Some((_, count)) => *count += 1,
            None => {
                self.0.push((reason.kind, 1));
                let text = format!("not understood: {place}: {}", reason.text);
                out.remark(format_args!("{}", escaped(&text)));
            }
        }
    }

    /// The number of parts.
    pub(super) fn count(&self) -> u64 {
        self.0.iter().map(|(_, count)| count).sum()
    }

    /// Their part of the sum, if there are any: `not understood: 3 (no time: 2, NUL bytes: 1)`.
    pub(super) fn sum(&self) -> Option<String> {
        let kinds: Vec<_> = self.0.iter().map(|(kind, count)| format!("{kind}: {count}")).collect();
        (!kinds.is_empty()).then(|| format!("not understood: {} ({})", self.count(), kinds.join(", ")))
    }
}

/// The kind of a record that the log ends in.
const CUT: &str = "ends inside a record";

/// The reason why a record of a log is not understood.
#[derive(Debug, PartialEq)]
pub(crate) struct Doubt {
    /// The kind, by which such records are counted.
    pub(super) kind: &'static str,
    /// The reason in words.
    pub(crate) text: String,
    /// Nothing behind it can be read.
    pub(super) is_last: bool,
}

impl Doubt {
    pub(super) fn new(kind: &'static str, text: impl Into<String>) -> Self {
        Self {
            kind,
            text: text.into(),
            is_last: false,
        }
    }

    /// A reason why nothing more can be read.
    pub(super) fn last(text: impl Into<String>) -> Self {
        Self {
            is_last: true,
            ..Self::new("the rest", text)
        }
    }

    /// A field that is not there.
    pub(super) fn missing(what: &str) -> Self {
        Self::new("missing field", format!("no {what}"))
    }

    /// A word that is not what its place requires, such as `no time`.
    pub(super) fn word(word: &str, what: &'static str) -> Self {
        Self::new(what, format!("'{}' is {what}", cut(word)))
    }

    /// Less data than the record announces.
    pub(super) fn short(announced: usize, there: usize) -> Self {
        Self::new(
            "cut data",
            format!("{announced} bytes of data were announced, {there} are there"),
        )
    }

    /// Bytes that are no object.
    pub(super) fn stray() -> Self {
        "no object starts here".into()
    }

    /// A record that the log ends in.
    pub(super) fn cut() -> Self {
        Self::new(CUT, "the log ends inside this record")
    }
}

impl From<&'static str> for Doubt {
    fn from(kind: &'static str) -> Self {
        Self::new(kind, kind)
    }
}

/// The place of a record.
#[derive(Clone, Copy)]
pub(super) enum Place<'a> {
    /// The number of its line, counted from 1, and its text.
    Line(u64, &'a str),
    /// Its offset in bytes, in a container that of the container.
    Byte(u64),
    /// The end of the recording.
    End,
}

impl Display for Place<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Line(number, text) => write!(f, "line {number}: '{}'", cut(text.trim())),
            Self::Byte(offset) => write!(f, "byte {offset}"),
            Self::End => f.write_str("the end"),
        }
    }
}
