//! The emulator's process.

use std::io::{self, BufReader, Read, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use super::messages::{Commands, Event, events};
use crate::error::Error;
use crate::trace::Trace;

/// The program, and the package that it needs.
const PROGRAM: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/rp2040/main.mjs");
const PACKAGE: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../examples/rp2040/emulator/node_modules/rp2040js"
);

/// A running emulator. It ends with its input.
#[derive(Debug)]
pub(super) struct Process {
    child: Child,
    /// `None` once it ends.
    input: Option<ChildStdin>,
    output: BufReader<ChildStdout>,
    trace: Trace,
}

impl Process {
    /// Starts the emulator.
    ///
    /// # Errors
    ///
    /// [`Error::NoEmulator`] if Node.js or the package is not installed, or cannot be started.
    pub(super) fn start() -> Result<Self, Error> {
        let missing = |missing| Error::NoEmulator { missing };
        if !Path::new(PACKAGE).is_dir() {
            return Err(missing("rp2040js"));
        }
        let mut child = Command::new("node")
            .arg(PROGRAM)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .map_err(|error| match error.kind() {
                io::ErrorKind::NotFound => missing("Node.js"),
                _ => ended(&error),
            })?;
        let (input, output) = (child.stdin.take(), child.stdout.take());
        let output = output.ok_or_else(|| Error::Ended("the emulator has no output".to_owned()))?;
        Ok(Self {
            child,
            input,
            output: BufReader::new(output),
            trace: Trace::default(),
        })
    }

    /// Executes commands, the last of which runs the chip or is for a debugger. Returns the events.
    ///
    /// # Errors
    ///
    /// [`Error::Ended`] if the emulator cannot continue.
    pub(super) fn execute(&mut self, commands: &mut Commands) -> Result<Vec<Event>, Error> {
        let batch = commands.take();
        let answer = self.exchange(&batch).map_err(|error| ended(&error))?;
        self.trace.bytes(&batch);
        self.trace.bytes(&answer);
        let events = events(&answer).ok_or_else(|| Error::Ended("the emulator sent nonsense".to_owned()))?;
        match events.last() {
            Some(Event::Failed(reason)) => Err(Error::Ended(format!("the emulator failed: {reason}"))),
            _ => Ok(events),
        }
    }

    /// A hash of all messages so far.
    pub(super) fn trace(&self) -> Trace {
        self.trace
    }

    fn exchange(&mut self, batch: &[u8]) -> io::Result<Vec<u8>> {
        if let Some(input) = &mut self.input {
            input.write_all(batch)?;
        }
        let mut length = [0; 4];
        self.output.read_exact(&mut length)?;
        let mut answer = vec![0; u32::from_le_bytes(length) as usize];
        self.output.read_exact(&mut answer)?;
        Ok(answer)
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        self.input = None;
        // There is nobody to tell of an error.
        let _ = self.child.wait();
    }
}

fn ended(error: &io::Error) -> Error {
    Error::Ended(format!("the emulator ended: {error}"))
}
