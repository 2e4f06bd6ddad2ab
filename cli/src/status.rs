//! A line on standard error that shows what a long command does.

use std::io::{IsTerminal, stderr};
use std::time::{Duration, Instant};

use clap::Args;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::output::print_error;
use crate::printable::escaped;

/// The time until a command is long.
const LONG: Duration = Duration::from_secs(1);
/// Time between two changes of the line, and between two lines that stay.
const PERIOD: Duration = Duration::from_millis(100);
const LINE_PERIOD: Duration = Duration::from_secs(1);

/// The option to show progress.
#[derive(Args, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct StatusArg {
    /// Show progress on standard error, in a line per second. On a terminal it is always shown, in one line.
    #[arg(long)]
    progress: bool,
}

/// The line. It is removed on drop.
pub(crate) struct Status {
    form: Form,
    /// The time from which on it may change.
    due: Instant,
}

enum Form {
    /// Nobody is to see it.
    Hidden,
    /// A line on a terminal.
    Bar(ProgressBar),
    /// Lines that stay, for a file or a program.
    Lines,
}

impl StatusArg {
    /// The line of a command whose end is unknown.
    pub(crate) fn line(self) -> Status {
        self.with(ProgressBar::no_length, "{msg}")
    }

    /// The line of a command that ends at `len`, with a bar.
    pub(crate) fn bar(self, len: u64) -> Status {
        self.with(|| ProgressBar::new(len), "[{bar:30}] {msg}")
    }

    /// Returns true if progress is shown, as on a terminal.
    pub(crate) fn is_shown(self) -> bool {
        self.progress || is_on_terminal()
    }

    fn with(self, bar: impl FnOnce() -> ProgressBar, template: &str) -> Status {
        let form = match (is_on_terminal(), self.progress) {
            (true, _) => {
                let style = ProgressStyle::with_template(template).map(|style| style.progress_chars("=> "));
                let bar = bar().with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
                bar.set_draw_target(ProgressDrawTarget::stderr());
                Form::Bar(bar)
            }
            (false, true) => Form::Lines,
            (false, false) => Form::Hidden,
        };
        let due = Instant::now() + LONG;
        Status { form, due }
    }
}

/// Returns true if standard error is a terminal that can change a line.
fn is_on_terminal() -> bool {
    let is_dumb = std::env::var_os("TERM").is_some_and(|term| term == "dumb");
    stderr().is_terminal() && !is_dumb
}

impl Status {
    /// Shows this text once the command is long, unless the line has just changed.
    pub(crate) fn show(&mut self, text: impl FnOnce() -> String) {
        if self.is_due() {
            self.draw(text());
        }
    }

    /// The same, with the bar at `at`.
    pub(crate) fn show_at(&mut self, at: u64, text: impl FnOnce() -> String) {
        if self.is_due() {
            self.begin(at, text());
        }
    }

    /// Shows at once that a part begins, with the bar at `at`.
    pub(crate) fn begin(&mut self, at: u64, text: String) {
        if let Form::Bar(bar) = &self.form {
            bar.set_position(at);
        }
        self.draw(text);
    }

    /// Prints lines that stay, with the line out of their way.
    pub(crate) fn beside<T>(&self, print: impl FnOnce() -> T) -> T {
        match &self.form {
            Form::Bar(bar) => bar.suspend(print),
            Form::Hidden | Form::Lines => print(),
        }
    }

    fn is_due(&self) -> bool {
        !matches!(self.form, Form::Hidden) && self.due <= Instant::now()
    }

    fn draw(&mut self, text: String) {
        let period = match &self.form {
            Form::Hidden => return,
            Form::Bar(bar) => {
                bar.set_message(escaped(&text));
                bar.tick();
                PERIOD
            }
            Form::Lines => {
                print_error(&text);
                LINE_PERIOD
            }
        };
        self.due = Instant::now() + period;
    }
}

impl Drop for Status {
    fn drop(&mut self) {
        if let Form::Bar(bar) = &self.form {
            bar.finish_and_clear();
        }
    }
}
