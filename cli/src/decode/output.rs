//! The destination of decoded items.

use std::cell::RefCell;
use std::fmt::{self, Arguments, Display};
use std::io::{self, BufWriter, Stdout, Write};

use armwire_host::describe::Protocol;

use crate::args::Speaker;

/// A frame of a recording, or bytes between frames.
pub(super) struct Item<'a> {
    /// The offset in the recording, or the time and the bus.
    pub(super) place: Arguments<'a>,
    pub(super) bytes: &'a [u8],
    pub(super) text: &'a str,
    /// `None` for bytes that were not on an arm's line.
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

/// Takes items one by one. After its first error an output discards them.
pub(super) trait Output {
    /// Takes an item.
    fn item(&self, item: &Item<'_>);

    /// Takes a line about the recording, such as the sum at its end.
    fn remark(&self, text: Arguments<'_>);

    /// Shows all items so far. Returns false after an error.
    fn flush(&self) -> bool {
        true
    }

    /// Shows the last items, and returns the first error.
    fn finish(&self) -> io::Result<()> {
        Ok(())
    }
}

/// A buffered writer. After its first error it writes nothing more.
pub(super) struct Writer<W: Write> {
    out: BufWriter<W>,
    error: Option<io::Error>,
}

impl<W: Write> Writer<W> {
    pub(super) fn new(out: BufWriter<W>) -> Self {
        Self { out, error: None }
    }

    pub(super) fn write(&mut self, write: impl FnOnce(&mut BufWriter<W>) -> io::Result<()>) {
        if self.error.is_none() {
            self.error = write(&mut self.out).err();
        }
    }

    /// Returns false after an error.
    pub(super) fn flush(&mut self) -> bool {
        self.write(BufWriter::flush);
        self.error.is_none()
    }

    /// Flushes, and returns the first error.
    pub(super) fn finish(&mut self) -> io::Result<()> {
        self.flush();
        self.error.take().map_or(Ok(()), Err)
    }
}

/// Standard output. It is written in large pieces, and before each wait for input.
pub(super) struct Console(RefCell<Writer<Stdout>>);

impl Console {
    pub(super) fn new() -> Self {
        Self(RefCell::new(Writer::new(BufWriter::new(io::stdout()))))
    }
}

impl Output for Console {
    fn item(&self, item: &Item<'_>) {
        self.remark(format_args!("{item}"));
    }

    fn remark(&self, text: Arguments<'_>) {
        self.0.borrow_mut().write(|out| writeln!(out, "{text}"));
    }

    fn flush(&self) -> bool {
        self.0.borrow_mut().flush()
    }

    fn finish(&self) -> io::Result<()> {
        self.0.borrow_mut().finish()
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
    fn item(&self, item: &Item<'_>) {
        self.remark(format_args!("{item}"));
    }

    fn remark(&self, text: Arguments<'_>) {
        self.0.borrow_mut().push(text.to_string());
    }
}
