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

    /// Runs the check, and notes this time of the run.
    pub(super) fn run(&mut self, now: Instant) -> Result<(), Error> {
        let Some(check) = &mut self.check else {
            return Ok(());
        };
        self.ran = Some(now);
        check().map_err(|reason| {
            self.interrupted = Some(reason.to_string());
            Error::Interrupted(reason)
        })
    }

    /// Runs the check, if its last run was a [`PERIOD`] ago.
    pub(super) fn run_if_due(&mut self, now: Instant) -> Result<(), Error> {
        match self.ran.is_some_and(|ran| now.duration_since(ran) < PERIOD) {
            true => Ok(()),
            false => self.run(now),
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

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::atomic::{AtomicU32, Ordering};

    use super::*;

    #[test]
    fn check_runs_once_in_a_period() {
        let runs = Arc::new(AtomicU32::new(0));
        let mut interrupter = Interrupter::default();
        let counted = Arc::clone(&runs);
        interrupter.set(Some(Box::new(move || {
            counted.fetch_add(1, Ordering::Relaxed);
            Ok(())
        })));
        let start = Instant::now();
        let runs_at = [0, 99, 100, 199, 250, 300].map(|millis| {
            interrupter.run_if_due(start + Duration::from_millis(millis)).unwrap();
            runs.load(Ordering::Relaxed)
        });
        assert_eq!(runs_at, [1, 1, 2, 2, 3, 3]);
    }
}
