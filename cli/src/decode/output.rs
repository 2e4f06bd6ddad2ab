//! The destination of decoded items.

use std::cell::RefCell;
use std::fmt::{self, Arguments, Display};
use std::io::{self, BufWriter, Stdout, Write};

use crate::args::Speaker;
use crate::describe::Protocol;

/// A frame of a recording, or bytes between frames.
pub(super) struct Item<'a> {
    /// The offset in the recording, or the time and the bus.
    pub(super) place: Arguments<'a>,
    pub(super) bytes: &'a [u8],
    pub(super) text: &'a str,
    /// `None` for bytes that were not on an arm's line.
    #[cfg_attr(not(feature = "recordings"), expect(dead_code, reason = "for pcapng files only"))]
    pub(super) on_line: Option<OnLine>,
}

/// The line of an item.
#[derive(Clone, Copy, Debug)]
#[cfg_attr(not(feature = "recordings"), expect(dead_code, reason = "for pcapng files only"))]
pub(super) struct OnLine {
    pub(super) protocol: Protocol,
    /// The sender; `None` if it is unknown.
    pub(super) from: Option<Speaker>,
    /// Time in the recording, in ns; 0 if the recording has no times.
    pub(super) nanos: u64,
}

/// Two lines: bytes, and their meaning.
impl Display for Item<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ", self.place)?;
        for byte in self.bytes {
            write!(f, " {byte:02X}")?;
        }
        write!(f, "\n          {}", self.text)
    }
}

/// Takes items one by one.
pub(super) trait Output {
    /// Takes an item.
    fn item(&self, item: &Item<'_>) -> io::Result<()>;

    /// Takes a line about the recording, such as the sum at its end.
    fn remark(&self, text: Arguments<'_>) -> io::Result<()>;

    /// Shows all items so far. An error shows with the next item.
    fn flush(&self) {}

    /// Shows the last items.
    fn finish(&self) -> io::Result<()> {
        Ok(())
    }
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

    fn print(&self, text: Arguments<'_>) -> io::Result<()> {
        let Printer { out, failed } = &mut *self.0.borrow_mut();
        failed.take().map_or_else(|| writeln!(out, "{text}"), Err)
    }
}

impl Output for Console {
    fn item(&self, item: &Item<'_>) -> io::Result<()> {
        self.print(format_args!("{item}"))
    }

    fn remark(&self, text: Arguments<'_>) -> io::Result<()> {
        self.print(text)
    }

    fn flush(&self) {
        let Printer { out, failed } = &mut *self.0.borrow_mut();
        if failed.is_none() {
            *failed = out.flush().err();
        }
    }

    fn finish(&self) -> io::Result<()> {
        let Printer { out, failed } = &mut *self.0.borrow_mut();
        failed.take().map_or_else(|| out.flush(), Err)
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
    fn item(&self, item: &Item<'_>) -> io::Result<()> {
        self.0.borrow_mut().push(item.to_string());
        Ok(())
    }

    fn remark(&self, text: Arguments<'_>) -> io::Result<()> {
        self.0.borrow_mut().push(text.to_string());
        Ok(())
    }
}
