//! The destination of decoded entries.

use std::cell::RefCell;
use std::fmt::Arguments;
use std::io::{self, BufWriter, Stdout, Write};

/// Takes entries one by one.
pub(super) trait Output {
    /// Takes an entry, one line or two.
    fn entry(&self, entry: Arguments<'_>) -> io::Result<()>;

    /// Shows all entries so far. An error shows with the next entry.
    fn flush(&self) {}
}

/// Standard output. It is written in large pieces, and whenever the input has nothing more for now.
pub(super) struct Console(RefCell<Printer>);

struct Printer {
    out: BufWriter<Stdout>,
    failed: Option<io::Error>,
}

impl Console {
    pub(super) fn new() -> Self {
        let out = BufWriter::new(io::stdout());
        Self(RefCell::new(Printer { out, failed: None }))
    }

    /// Shows the last entries.
    pub(super) fn finish(&self) -> io::Result<()> {
        let Printer { out, failed } = &mut *self.0.borrow_mut();
        failed.take().map_or_else(|| out.flush(), Err)
    }
}

impl Output for Console {
    fn entry(&self, entry: Arguments<'_>) -> io::Result<()> {
        let Printer { out, failed } = &mut *self.0.borrow_mut();
        failed.take().map_or_else(|| writeln!(out, "{entry}"), Err)
    }

    fn flush(&self) {
        let Printer { out, failed } = &mut *self.0.borrow_mut();
        if failed.is_none() {
            *failed = out.flush().err();
        }
    }
}

/// A list of entries.
#[derive(Default)]
pub(super) struct Entries(RefCell<Vec<String>>);

impl Entries {
    pub(super) fn into_lines(self) -> Vec<String> {
        self.0.into_inner()
    }
}

impl Output for Entries {
    fn entry(&self, entry: Arguments<'_>) -> io::Result<()> {
        self.0.borrow_mut().push(entry.to_string());
        Ok(())
    }
}
