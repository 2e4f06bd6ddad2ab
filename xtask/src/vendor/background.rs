//! Programs that run beside us.

use std::path::Path;
use std::process::{Child, Command, ExitStatus};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};

use crate::process::{cannot_run, run, shown};

/// A process that does not outlive us.
pub(super) struct Background {
    child: Child,
    name: String,
}

impl Background {
    /// Starts it.
    ///
    /// # Errors
    ///
    /// If it cannot be started.
    pub(super) fn start(command: &mut Command) -> Result<Self> {
        let name = shown(command);
        let child = command.spawn().with_context(|| cannot_run(command))?;
        Ok(Self { child, name })
    }

    /// Waits until it has made a file.
    ///
    /// # Errors
    ///
    /// If it ends before, or makes none in time.
    pub(super) fn wait_for_file(&mut self, file: &Path, patience: Duration) -> Result<()> {
        let status = self.wait(patience, || file.exists())?;
        match status {
            Some(status) => bail!("`{}` ended early: {status}", self.name),
            None if file.exists() => Ok(()),
            None => bail!("`{}` made no {} within {patience:?}", self.name, file.display()),
        }
    }

    /// Waits until it ends, successfully.
    ///
    /// # Errors
    ///
    /// If it fails, or does not end in time.
    pub(super) fn succeed_within(&mut self, patience: Duration) -> Result<()> {
        match self.wait(patience, || false)? {
            Some(status) if status.success() => Ok(()),
            Some(status) => bail!("`{}` failed: {status}", self.name),
            None => bail!("`{}` did not end within {patience:?}", self.name),
        }
    }

    /// Waits until it ends, `or` something else happens, or patience does.
    fn wait(&mut self, patience: Duration, or: impl Fn() -> bool) -> Result<Option<ExitStatus>> {
        let start = Instant::now();
        while start.elapsed() < patience && !or() {
            if let Some(status) = self.child.try_wait()? {
                return Ok(Some(status));
            }
            thread::sleep(Duration::from_millis(20));
        }
        Ok(None)
    }

    /// Asks it to end, as Ctrl-C does.
    ///
    /// # Errors
    ///
    /// If it has ended.
    pub(super) fn interrupt(&self) -> Result<()> {
        run(Command::new("kill").args(["-INT", &self.child.id().to_string()]))
    }
}

impl Drop for Background {
    fn drop(&mut self) {
        // Both fail when it has ended, as it should have.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
