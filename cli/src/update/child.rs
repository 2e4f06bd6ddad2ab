//! Other programs as child processes.
//!
//! Nothing ends one in the middle of its work. It has a process group of its own, which Ctrl-C and the hang-up of the
//! terminal do not reach, and prints into a pipe that is read although this program's own reader may be gone. If this
//! program is killed, the pipe breaks, and the child ends at its next line.

use std::io::{self, ErrorKind, Read, Write, pipe, stderr};
#[cfg(unix)]
use std::os::unix::process::CommandExt;
#[cfg(windows)]
use std::os::windows::process::CommandExt;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::thread;
use std::time::{Duration, Instant};

#[cfg(unix)]
use rustix::process::{Pid, Signal, kill_process_group};

use crate::printable::{cut, escaped_lines};

/// Period of the checks for its end.
const POLL_PERIOD: Duration = Duration::from_millis(20);

/// A child that has ended.
pub(super) struct Ended {
    pub(super) status: ExitStatus,
    /// Everything that it printed.
    pub(super) output: Vec<u8>,
}

impl Ended {
    /// The last line of its output, which has the reason for a failure.
    pub(super) fn last_line(&self) -> String {
        last_line(&self.output)
    }
}

/// Runs a command to its end, or kills it after `limit`. Its output is kept, and shown on standard error if `is_shown`.
pub(super) fn run(command: &mut Command, limit: Duration, is_shown: bool) -> io::Result<Ended> {
    #[cfg(unix)]
    command.process_group(0);
    #[cfg(windows)]
    command.creation_flags(CREATE_NEW_PROCESS_GROUP);
    let (reader, writer) = pipe()?;
    command.stdin(Stdio::null()).stdout(writer.try_clone()?).stderr(writer);
    let mut child = command.spawn()?;
    // The command has the pipe's other end, which would keep it open.
    command.stdout(Stdio::null()).stderr(Stdio::null());
    thread::scope(|scope| {
        let output = scope.spawn(|| keep(reader, is_shown));
        let status = wait(&mut child, limit)?;
        let output = output.join().unwrap_or_default();
        match status {
            Some(status) => Ok(Ended { status, output }),
            None => {
                let limit = limit.as_secs();
                let last_line = last_line(&output);
                let text = format!("killed, because it did not end in {limit} s{last_line}");
                Err(io::Error::new(ErrorKind::TimedOut, text))
            }
        }
    })
}

/// Waits for the end of the child. `None` if it was killed.
fn wait(child: &mut Child, limit: Duration) -> io::Result<Option<ExitStatus>> {
    let deadline = Instant::now() + limit;
    loop {
        match child.try_wait()? {
            Some(status) => return Ok(Some(status)),
            None if deadline <= Instant::now() => break,
            None => thread::sleep(POLL_PERIOD),
        }
    }
    kill(child)?;
    child.wait()?;
    Ok(None)
}

/// Kills the child and those that it has started: each has the pipe.
#[cfg(unix)]
fn kill(child: &mut Child) -> io::Result<()> {
    Ok(kill_process_group(Pid::from_child(child), Signal::KILL)?)
}

/// Kills the child.
#[cfg(not(unix))]
fn kill(child: &mut Child) -> io::Result<()> {
    child.kill()
}

/// Keeps Ctrl-C from the child.
#[cfg(windows)]
const CREATE_NEW_PROCESS_GROUP: u32 = 0x200;

/// Reads everything. Standard error without a reader ends nothing.
fn keep(mut from: impl Read, is_shown: bool) -> Vec<u8> {
    let mut kept = Vec::new();
    let mut bytes = [0; 1024];
    loop {
        match from.read(&mut bytes) {
            Ok(0) => return kept,
            Ok(n) => {
                kept.extend(&bytes[..n]);
                if is_shown {
                    // USB devices name themselves.
                    let shown = escaped_lines(&String::from_utf8_lossy(&bytes[..n]));
                    drop(stderr().write_all(shown.as_bytes()));
                }
            }
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(_) => return kept,
        }
    }
}

/// `: ` and the last line that is not empty, or nothing. A progress bar returns to the start of its line.
fn last_line(output: &[u8]) -> String {
    let text = String::from_utf8_lossy(output);
    let last = text.split(['\r', '\n']).map(str::trim).rfind(|line| !line.is_empty());
    last.map_or(String::new(), |line| format!(": {}", cut(line)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn last_line_is_the_reason() {
        let output = b"dfu-util 0.11\n\nDownload\t 20%\rDownload\t 40%\ndfu-util: Lost device after RESET?\n \n";
        assert_eq!(last_line(output), ": dfu-util: Lost device after RESET?");
        assert_eq!(last_line(b"Download\t 20%\rDownload\t 40%"), ": Download\t 40%");
        assert_eq!(last_line(b"\n"), "");
    }

    #[cfg(unix)]
    #[test]
    fn program_that_does_not_end_is_killed() {
        // It ends only if it is killed, with the pipe that is its output.
        let mut endless = Command::new("sh");
        endless.args(["-c", "exec tail -f /dev/null"]);
        let error = run(&mut endless, Duration::ZERO, false).err().unwrap();
        assert_eq!(error.to_string(), "killed, because it did not end in 0 s");
    }
}
