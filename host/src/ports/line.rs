//! A transport of bytes, and what it knows about a missing answer.

use std::io::{self, ErrorKind};
use std::time::Duration;

use crate::describe::Protocol;
use crate::error::Error;
use crate::error::text::{Remedy, Text};

/// A transport of bytes.
pub(crate) trait Line: Send {
    /// The name that the user gave it.
    fn name(&self) -> &str;

    /// Reads the available bytes, waiting at most `wait` for the first one. Returns 0 on timeout.
    fn read(&mut self, buf: &mut [u8], wait: Duration) -> Result<usize, Error>;

    /// Writes some of the bytes, at least one, and returns how many. On a line that carries whole messages the bytes are
    /// one.
    fn write(&mut self, bytes: &[u8]) -> Result<usize, Error>;

    /// Writes all bytes.
    fn write_all(&mut self, mut bytes: &[u8]) -> Result<(), Error> {
        while !bytes.is_empty() {
            let n = self.write(bytes)?;
            bytes = &bytes[n..];
        }
        Ok(())
    }

    /// A hint for a line without an answer. It is known without I/O.
    fn hint(&self, reception: Reception, arm: Names) -> Text;
}

/// Names of the expected arm and of the other arm that may be on the line.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Names {
    /// The arm's name, with its article.
    pub(crate) arm: &'static str,
    /// The other arm that may be on such a line, with its article.
    pub(crate) other: (&'static str, Protocol),
}

impl Names {
    /// The other arm, with the remedy.
    pub(crate) fn other(&self) -> Text {
        let (name, protocol) = self.other;
        Text::from(name).remedy(Remedy::TryAs(protocol))
    }
}

/// The bytes received instead of an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Reception {
    /// Nothing.
    Silence,
    /// Bytes, but not the answer.
    Garbage,
}

/// Returns true if a read or write failed only because it would block.
pub(crate) fn is_nothing_yet(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        ErrorKind::TimedOut | ErrorKind::WouldBlock | ErrorKind::Interrupted
    )
}
