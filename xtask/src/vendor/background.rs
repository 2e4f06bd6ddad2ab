//! Programs in the background.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail, ensure};

use crate::process::{cannot_run, run, shown};

/// A process that is killed when dropped.
pub(crate) struct Background {
    child: Child,
    name: String,
}

impl Background {
    /// Starts a command.
    ///
    /// # Errors
    ///
    /// If it cannot be started.
    pub(crate) fn start(command: &mut Command) -> Result<Self> {
        let name = shown(command);
        let child = command.spawn().with_context(|| cannot_run(command))?;
        Ok(Self { child, name })
    }

    /// Starts a command, and waits for the first line of its output: it is ready then.
    ///
    /// # Errors
    ///
    /// If it cannot be started, or ends without a line.
    pub(crate) fn start_with_line(command: &mut Command) -> Result<(Self, String)> {
        let mut started = Self::start(command.stdout(Stdio::piped()))?;
        let mut line = String::new();
        let output = started.child.stdout.take().context("the output is piped")?;
        BufReader::new(output).read_line(&mut line)?;
        ensure!(!line.is_empty(), "`{}` printed nothing", started.name);
        Ok((started, line))
    }

    /// Waits until the process has created a file.
    ///
    /// # Errors
    ///
    /// If it ends before, or the timeout is exceeded.
    pub(crate) fn wait_for_file(&mut self, file: &Path, timeout: Duration) -> Result<()> {
        let status = self.wait(timeout, || file.exists())?;
        match status {
            Some(status) => bail!("`{}` ended early: {status}", self.name),
            None if file.exists() => Ok(()),
            None => bail!("`{}` created no {} within {timeout:?}", self.name, file.display()),
        }
    }

    /// Waits until the process succeeds.
    ///
    /// # Errors
    ///
    /// If it fails, or the timeout is exceeded.
    pub(crate) fn succeed_within(&mut self, timeout: Duration) -> Result<()> {
        match self.wait(timeout, || false)? {
            Some(status) if status.success() => Ok(()),
            Some(status) => bail!("`{}` failed: {status}", self.name),
            None => bail!("`{}` did not end within {timeout:?}", self.name),
        }
    }

    /// Waits until the process ends, the condition is true, or the timeout is exceeded.
    fn wait(&mut self, timeout: Duration, condition: impl Fn() -> bool) -> Result<Option<ExitStatus>> {
        let start = Instant::now();
        while start.elapsed() < timeout && !condition() {
            if let Some(status) = self.child.try_wait()? {
                return Ok(Some(status));
            }
            thread::sleep(Duration::from_millis(20));
        }
        Ok(None)
    }

    /// Interrupts the process like Ctrl-C.
    ///
    /// # Errors
    ///
    /// If the process has ended.
    pub(crate) fn interrupt(&self) -> Result<()> {
        run(Command::new("kill").args(["-INT", &self.child.id().to_string()]))
    }
}

impl Drop for Background {
    fn drop(&mut self) {
        // The error of a script that used it would hide this.
        if let Ok(Some(status)) = self.child.try_wait()
            && !status.success()
        {
            println!("`{}` failed: {status}", self.name);
        }
        // Both fail if the process has ended.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
