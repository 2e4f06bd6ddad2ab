//! The output of a monitor: a full screen, or lines.

use std::io::{IsTerminal, stdout};
use std::thread;
use std::time::{Duration, Instant};

use armwire_bridge::time;
use armwire_host::describe::line;
use ratatui::DefaultTerminal;
use ratatui::crossterm::event::{self, Event, KeyCode, KeyEventKind, KeyModifiers};
#[cfg(unix)]
use rustix::event::{PollFd, PollFlags, poll};
#[cfg(unix)]
use rustix::io::Errno;
use serde_json::Value;

use super::model::Model;
use super::{table, view};
use crate::error::Error;
use crate::output::{self, print, print_line};
use crate::printable::escaped_json;
use crate::status::{Status, StatusArg};

/// Minimum time between two drawings of the screen.
const DRAW_PERIOD: Duration = Duration::from_millis(50);

/// The form of the output.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Form {
    /// A full screen.
    Screen,
    /// A line of text per reading.
    Lines,
    /// Comma-separated values.
    Csv,
    /// A JSON object per line.
    Json,
    /// The sum, at the end, and the progress until then.
    Sum(StatusArg),
}

/// The last event of a session.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Step {
    /// A reading.
    Reading,
    /// A missing answer.
    TimedOut,
    /// A notice for the user.
    Notice,
    /// None of these.
    Nothing,
}

/// An output of a model.
pub(super) trait Output {
    /// Shows the model after this step.
    fn show(&mut self, model: &Model, now: time::Instant, step: Step) -> Result<(), Error>;

    /// Waits. Returns true if the user ends the monitor.
    fn wait(&mut self, wait: Duration) -> Result<bool, Error> {
        thread::sleep(wait);
        Ok(false)
    }
}

impl Form {
    /// The form for these options. The default is a full screen on a capable terminal, and lines otherwise.
    pub(super) fn new(csv: bool, json: bool) -> Self {
        let is_dumb = std::env::var_os("TERM").is_some_and(|term| term == "dumb");
        match (csv, json) {
            (true, _) => Self::Csv,
            (_, true) => Self::Json,
            _ if stdout().is_terminal() && !is_dumb => Self::Screen,
            _ => Self::Lines,
        }
    }

    /// The form of a recording: a full screen on a capable terminal, and the sum otherwise.
    pub(crate) fn of_recording(status: StatusArg) -> Self {
        match Self::new(false, false) {
            Self::Screen => Self::Screen,
            _ => Self::Sum(status),
        }
    }

    /// Returns true if the sum is printed at the end.
    pub(super) fn has_sum(self) -> bool {
        matches!(self, Self::Screen | Self::Sum(_))
    }

    /// Returns true if the form shows temperatures.
    pub(super) fn shows_celsius(self) -> bool {
        !matches!(self, Self::Lines | Self::Sum(_))
    }

    pub(super) fn open(self) -> Result<Box<dyn Output>, Error> {
        Ok(match self {
            Self::Screen => Box::new(Screen::open()?),
            Self::Sum(status) => Box::new(status.line()),
            form => Box::new(Printed { form, has_head: false }),
        })
    }
}

/// The whole terminal. Its contents are restored on drop and after a panic.
struct Screen {
    terminal: DefaultTerminal,
    drawn: Option<Instant>,
}

impl Screen {
    fn open() -> Result<Self, Error> {
        let terminal = ratatui::try_init().map_err(Error::Output)?;
        Ok(Self { terminal, drawn: None })
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        ratatui::restore();
    }
}

impl Output for Screen {
    fn show(&mut self, model: &Model, now: time::Instant, _: Step) -> Result<(), Error> {
        if self.drawn.is_some_and(|drawn| drawn.elapsed() < DRAW_PERIOD) {
            return Ok(());
        }
        self.drawn = Some(Instant::now());
        self.terminal
            .draw(|frame| view::draw(frame, model, now))
            .map_err(Error::Output)?;
        Ok(())
    }

    fn wait(&mut self, wait: Duration) -> Result<bool, Error> {
        let until = Instant::now() + wait;
        loop {
            let left = until.saturating_duration_since(Instant::now());
            if is_gone(left)? {
                return Ok(true);
            }
            if !event::poll(Duration::ZERO).map_err(Error::Output)? {
                match left.is_zero() {
                    true => return Ok(false),
                    false => continue,
                }
            }
            match event::read().map_err(Error::Output)? {
                Event::Key(key) if key.kind != KeyEventKind::Release && is_end(key.code, key.modifiers) => {
                    return Ok(true);
                }
                // The next drawing must not wait.
                Event::Resize(..) => self.drawn = None,
                _ => {}
            }
        }
    }
}

/// Waits for an event of the terminal, at most for `wait`. Returns true if the terminal is gone: the library would read
/// its end forever.
#[cfg(unix)]
fn is_gone(wait: Duration) -> Result<bool, Error> {
    let stdout = stdout();
    let mut terminal = [PollFd::new(&stdout, PollFlags::IN)];
    let wait = wait.try_into().expect("it is no longer than a second");
    match poll(&mut terminal, Some(&wait)) {
        Ok(_) | Err(Errno::INTR) => Ok(terminal[0].revents().contains(PollFlags::HUP)),
        Err(error) => Err(Error::Output(error.into())),
    }
}

/// Waits for an event of the terminal, at most for `wait`.
#[cfg(not(unix))]
fn is_gone(wait: Duration) -> Result<bool, Error> {
    event::poll(wait).map(|_| false).map_err(Error::Output)
}

/// Returns true if a key ends the monitor. A raw terminal delivers Ctrl-C as a key.
fn is_end(code: KeyCode, modifiers: KeyModifiers) -> bool {
    match code {
        KeyCode::Char('q' | 'Q') | KeyCode::Esc => true,
        KeyCode::Char('c') => modifiers.contains(KeyModifiers::CONTROL),
        _ => false,
    }
}

/// The notice that this step shows to the user.
fn notice(model: &Model, step: Step) -> Option<&String> {
    match step {
        Step::TimedOut | Step::Notice => model.notice.as_ref(),
        Step::Reading | Step::Nothing => None,
    }
}

/// The progress. The sum is printed by the session.
impl Output for Status {
    fn show(&mut self, model: &Model, now: time::Instant, step: Step) -> Result<(), Error> {
        if let Some(notice) = notice(model, step) {
            self.beside(|| output::print_error(notice));
        }
        Status::show(self, || model.summary(now));
        Ok(())
    }
}

/// Lines on standard output: text, or a row of values for each reading and for each missing answer.
struct Printed {
    form: Form,
    /// True if the line of names was printed.
    has_head: bool,
}

impl Output for Printed {
    fn show(&mut self, model: &Model, now: time::Instant, step: Step) -> Result<(), Error> {
        if let Some(notice) = notice(model, step) {
            output::print_error(notice);
        }
        let Some(latest) = &model.latest else {
            return Ok(());
        };
        let reading = match step {
            Step::Reading => Some(latest),
            Step::TimedOut if self.form != Form::Lines => None,
            _ => return Ok(()),
        };
        if self.form == Form::Lines {
            let seconds = latest.at.as_micros() as f64 / 1e6;
            return print_line(format_args!("{seconds:9.3} s  {}", line(&latest.facts)));
        }
        let row = table::row(model, now, reading);
        if self.form == Form::Json {
            return print(&(escaped_json(&Value::Object(row).to_string()) + "\n"));
        }
        if !std::mem::replace(&mut self.has_head, true) {
            print(&(table::csv_head(&row) + "\n"))?;
        }
        print(&(table::csv_line(&row) + "\n"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_q_escape_and_ctrl_c_end_it() {
        let none = KeyModifiers::NONE;
        assert!(is_end(KeyCode::Char('q'), none) && is_end(KeyCode::Esc, none));
        assert!(is_end(KeyCode::Char('c'), KeyModifiers::CONTROL));
        assert!(!is_end(KeyCode::Char('c'), none) && !is_end(KeyCode::Enter, none));
    }
}
