//! dfu-util as a child process: its commands, its output and its end.
//!
//! Nothing ends it in the middle of a write. It has a process group of its own, which Ctrl-C and the hang-up of the
//! terminal do not reach, and prints into a pipe that is read although this program's own reader may be gone. If this
//! program is killed, the pipe breaks, and dfu-util ends at its next line.

use std::io::{self, ErrorKind, Read, Write, pipe, stdout};
#[cfg(unix)]
use std::os::unix::process::CommandExt;
#[cfg(windows)]
use std::os::windows::process::CommandExt;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::thread;
use std::time::{Duration, Instant};

#[cfg(unix)]
use rustix::process::{Pid, Signal, kill_process_group};

use super::dfuse::BOOT_LOADER;

/// The program that talks to the boot loader.
pub(super) const DFU_UTIL: &str = "dfu-util";

/// Maximum durations of a search or a start, and of a write. The write of the largest image takes half a minute.
const LIMIT: Duration = Duration::from_secs(10);
const WRITE_LIMIT: Duration = Duration::from_secs(120);
/// Period of the checks for its end.
const POLL_PERIOD: Duration = Duration::from_millis(20);

/// The commands that write an image to flash and start it.
pub(super) struct Commands {
    write: Command,
    leave: Command,
}

impl Commands {
    /// The flash is alternate setting 0 of the boot loader. Only sectors with data in the image are erased. dfu-util 0.11
    /// does not do both in one call: see docs/update.md.
    pub(super) fn new(image: &Path) -> Self {
        let (vendor, product) = BOOT_LOADER;
        let flash = || {
            let mut command = Command::new(DFU_UTIL);
            command.args(["-d", &format!(",{vendor:04x}:{product:04x}"), "-a", "0"]);
            command
        };
        let (mut write, mut leave) = (flash(), flash());
        write.arg("-D").arg(image);
        leave.args(["-s", "0x08000000:leave"]);
        Self { write, leave }
    }

    /// The commands for a user to type.
    pub(super) fn by_hand(&self) -> String {
        format!("'{}' and then '{}'", shown(&self.write), shown(&self.leave))
    }

    /// Writes the image. Prints the command by `report`, and the output of dfu-util.
    pub(super) fn write(&mut self, report: impl FnOnce(String)) -> io::Result<ExitStatus> {
        report(shown(&self.write));
        run(&mut self.write, WRITE_LIMIT, &mut stdout())
    }

    /// Starts the new firmware. Prints the command by `report`, and the output of dfu-util.
    pub(super) fn leave(&mut self, report: impl FnOnce(String)) {
        report(shown(&self.leave));
        // The chip is gone before it has answered, which some versions take for an error.
        let _ = run(&mut self.leave, LIMIT, &mut stdout());
    }
}

/// Returns true if a boot loader is on USB.
pub(super) fn is_listed() -> io::Result<bool> {
    let mut output = Vec::new();
    run(Command::new(DFU_UTIL).arg("--list"), LIMIT, &mut output)?;
    let (vendor, product) = BOOT_LOADER;
    let found = format!("Found DFU: [{vendor:04x}:{product:04x}]");
    Ok(String::from_utf8_lossy(&output).contains(&found))
}

/// Runs a command to its end, or kills it after `limit`. Passes its output on.
fn run(command: &mut Command, limit: Duration, output: &mut (impl Write + Send)) -> io::Result<ExitStatus> {
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
        scope.spawn(|| pass_on(reader, output));
        let deadline = Instant::now() + limit;
        loop {
            match child.try_wait()? {
                Some(status) => return Ok(status),
                None if deadline <= Instant::now() => break,
                None => thread::sleep(POLL_PERIOD),
            }
        }
        kill(&mut child)?;
        child.wait()?;
        Err(io::Error::new(
            ErrorKind::TimedOut,
            format!("killed, because it did not end in {} s", limit.as_secs()),
        ))
    })
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

/// Passes everything on. An output without a reader ends nothing.
fn pass_on(mut from: impl Read, to: &mut impl Write) {
    let mut bytes = [0; 1024];
    loop {
        match from.read(&mut bytes) {
            Ok(0) => return,
            Ok(n) => drop(to.write_all(&bytes[..n]).and_then(|()| to.flush())),
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(_) => return,
        }
    }
}

/// A command as one would type it.
fn shown(command: &Command) -> String {
    let mut text = command.get_program().to_string_lossy().into_owned();
    for arg in command.get_args().map(|arg| arg.to_string_lossy()) {
        match arg.contains(char::is_whitespace) {
            true => text += &format!(" \"{arg}\""),
            false => text += &format!(" {arg}"),
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn name_with_a_space_is_shown_in_quotes() {
        assert!(shown(&Commands::new(Path::new("my image.dfu")).write).ends_with(" -D \"my image.dfu\""));
    }

    #[cfg(unix)]
    #[test]
    fn program_that_does_not_end_is_killed() {
        let mut output = Vec::new();
        // It ends only if it is killed, with the pipe that is its output.
        let mut endless = Command::new("sh");
        endless.args(["-c", "exec tail -f /dev/null"]);
        let error = run(&mut endless, Duration::ZERO, &mut output).unwrap_err();
        assert_eq!(error.to_string(), "killed, because it did not end in 0 s");
    }
}
