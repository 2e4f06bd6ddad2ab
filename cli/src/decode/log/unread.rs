//! Parts of a log that its reader does not understand, and their places.

use std::fmt::{self, Display};

use crate::printable::cut;

/// The kind of a record that the log ends in.
const CUT: &str = "ends inside a record";

/// The reason why a record of a log is not understood.
#[derive(Debug, PartialEq)]
pub(in crate::decode) struct Unread {
    /// The kind, by which such records are counted.
    pub(in crate::decode) kind: &'static str,
    /// The reason in words.
    pub(in crate::decode) text: String,
}

impl Unread {
    pub(in crate::decode) fn new(kind: &'static str, text: impl Into<String>) -> Self {
        Self {
            kind,
            text: text.into(),
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
    pub(in crate::decode) fn short(announced: usize, there: usize) -> Self {
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

impl From<&'static str> for Unread {
    fn from(kind: &'static str) -> Self {
        Self::new(kind, kind)
    }
}

/// The place of a record.
#[derive(Clone, Copy)]
pub(in crate::decode) enum Place<'a> {
    /// The number of its line, counted from 1, and its text.
    Line(u64, &'a str),
    /// Its offset in bytes, in a container that of the container.
    Byte(u64),
}

impl Display for Place<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Line(number, text) => write!(f, "line {number}: '{}'", cut(text.trim())),
            Self::Byte(offset) => write!(f, "byte {offset}"),
        }
    }
}
