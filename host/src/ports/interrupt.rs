//! A program's check during waits, such as for Ctrl-C.

use std::error;
use std::time::{Duration, Instant};

use crate::error::Error;

/// Maximum wait for a line between two runs of a check.
pub(crate) const PERIOD: Duration = Duration::from_millis(100);

/// The result of a check during waits. Its error ends the wait.
pub type Interrupt = Result<(), Box<dyn error::Error + Send + Sync>>;

/// The check of a program.
pub(crate) type Check = Box<dyn FnMut() -> Interrupt + Send>;

/// The check, if any, and its last error.
#[derive(Default)]
pub(super) struct Interrupter {
    check: Option<Check>,
    /// Text of the check's last error that was not taken. A check may report once, and its error may be dropped.
    interrupted: Option<String>,
    /// The time of the check's last run.
    ran: Option<Instant>,
}

impl Interrupter {
    pub(super) fn set(&mut self, check: Option<Check>) {
        self.check = check;
    }

    /// Removes the check.
    pub(super) fn take(&mut self) -> Option<Check> {
        self.check.take()
    }

    /// Runs the check.
    pub(super) fn run(&mut self) -> Result<(), Error> {
        let Some(check) = &mut self.check else {
            return Ok(());
        };
        self.ran = Some(Instant::now());
        check().map_err(|reason| {
            self.interrupted = Some(reason.to_string());
            Error::Interrupted(reason)
        })
    }

    /// Runs the check, if its last run was a [`PERIOD`] ago.
    pub(super) fn run_if_due(&mut self) -> Result<(), Error> {
        match self.ran.is_some_and(|ran| ran.elapsed() < PERIOD) {
            true => Ok(()),
            false => self.run(),
        }
    }

    /// The text of the last error that the check returned since this was last called.
    pub(super) fn take_interrupted(&mut self) -> Option<String> {
        self.interrupted.take()
    }

    /// The longest part of a wait after which the check runs.
    pub(super) fn part(&self, wait: Duration) -> Duration {
        match &self.check {
            None => wait,
            Some(_) => wait.min(PERIOD),
        }
    }
}
