//! A line that shows what a long command does, on a terminal.

use std::io::{IsTerminal, Write, stdout};
use std::time::{Duration, Instant};

use crate::printable::escaped;

/// Time between two changes of the line.
const PERIOD: Duration = Duration::from_millis(100);

/// The line. It is removed on drop.
pub(crate) struct Status {
    /// The time of the last change. `None` if the output is no terminal.
    shown: Option<Instant>,
    is_empty: bool,
}

impl Status {
    pub(crate) fn new() -> Self {
        let is_dumb = std::env::var_os("TERM").is_some_and(|term| term == "dumb");
        let is_on = stdout().is_terminal() && !is_dumb;
        let before = Instant::now().checked_sub(PERIOD).unwrap_or_else(Instant::now);
        Self {
            shown: is_on.then_some(before),
            is_empty: true,
        }
    }

    /// Shows this text, unless the line has just changed.
    pub(crate) fn show(&mut self, text: impl FnOnce() -> String) {
        if let Some(shown) = &mut self.shown
            && shown.elapsed() >= PERIOD
        {
            *shown = Instant::now();
            self.is_empty = false;
            // The cursor to the start, the text, and the rest of the line erased. Without a reader it is lost.
            let mut out = stdout();
            let _ = write!(out, "\r{}\x1b[K", escaped(&text())).and_then(|()| out.flush());
        }
    }

    /// Removes the line, for one that stays.
    pub(crate) fn clear(&mut self) {
        if !std::mem::replace(&mut self.is_empty, true) {
            let mut out = stdout();
            let _ = write!(out, "\r\x1b[K").and_then(|()| out.flush());
        }
    }
}

impl Drop for Status {
    fn drop(&mut self) {
        self.clear();
    }
}
