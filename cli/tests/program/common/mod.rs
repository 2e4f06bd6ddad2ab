//! The program as a child process, and its virtual counterparts.

pub(crate) mod adapter;
pub(crate) mod board;
pub(crate) mod dfu;
pub(crate) mod terminal;
pub(crate) mod uf2;

use std::fs;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Output, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc;
use std::thread;
use std::time::{Duration, Instant};

use armwire_sim::pty::Pty;
use rustix::process::{Pid, Signal, kill_process};

pub(crate) const PROGRAM: &str = env!("CARGO_BIN_EXE_armwire");
/// Timeout of a program that hangs.
pub(crate) const TIMEOUT: Duration = Duration::from_secs(30);

/// Waits for the end of a program. Kills it on timeout.
pub(crate) fn finish(child: Child) -> Output {
    let pid = Pid::from_child(&child);
    let (sender, ended) = mpsc::channel();
    // It reads all along: a program that prints much would wait for that.
    thread::spawn(move || sender.send(child.wait_with_output()));
    let output = ended.recv_timeout(TIMEOUT).unwrap_or_else(|_| {
        kill_process(pid, Signal::KILL).unwrap();
        panic!("it hangs: {:?}", ended.recv());
    });
    output.unwrap()
}

pub(crate) fn start(command: &mut Command) -> Child {
    let command = command
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    command.spawn().unwrap()
}

pub(crate) fn run(args: &[&str]) -> Output {
    finish(start(Command::new(PROGRAM).args(args)))
}

/// Copies a program to where it is started. `install` writes the copy: a process that another test starts would inherit
/// this one's open file, and a file open for writing cannot be executed.
pub(crate) fn install(program: &Path, to: &Path) {
    let mut install = Command::new("install");
    let status = install.args(["-m", "755"]).arg(program).arg(to).status().unwrap();
    assert!(status.success(), "{install:?}: {status}");
}

/// Message for an arm that does not answer.
pub(crate) const NO_ANSWER: &str = "no answer in";

/// Messages on a busy system, if an arm or adapter does not answer in time, or answers an earlier request.
const BUSY: [&str; 5] = [
    NO_ANSWER,
    "the answer came too late",
    "the adapter does not answer in",
    "no answer to SLCAN",
    "frames arrive, but not the answer",
];

/// Repeats a program while it prints this error: on a busy system, an arm may be silent.
pub(crate) fn retry_while(error: &str, run: impl FnMut() -> Output) -> Output {
    retry_while_any(&[error], run)
}

/// Repeats a program on a [busy](BUSY) system.
pub(crate) fn retry_while_busy(run: impl FnMut() -> Output) -> Output {
    retry_while_any(&BUSY, run)
}

/// Repeats a program while it prints one of these errors.
fn retry_while_any(errors: &[&str], mut run: impl FnMut() -> Output) -> Output {
    let deadline = Instant::now() + TIMEOUT;
    loop {
        let output = run();
        let stderr = String::from_utf8_lossy(&output.stderr);
        let has_error = errors.iter().any(|error| stderr.contains(error));
        if !has_error || Instant::now() > deadline {
            return output;
        }
    }
}

/// The output of a program that succeeds without a warning. The program is repeated on a [busy](BUSY) system.
pub(crate) fn success(args: &[&str]) -> String {
    let output = retry_while_busy(|| run(args));
    assert!(output.status.success() && output.stderr.is_empty(), "{output:?}");
    String::from_utf8(output.stdout).unwrap()
}

/// The only line of a failing program's error output, without the program's name.
pub(crate) fn failure(output: &Output) -> String {
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    let stderr = String::from_utf8(output.stderr.clone()).unwrap();
    assert_eq!(stderr.lines().count(), 1, "{stderr}");
    stderr.strip_prefix("armwire: ").unwrap().trim_end().to_owned()
}

/// The output of a program with wrong arguments.
pub(crate) fn usage(args: &[&str]) -> String {
    let output = run(args);
    assert_eq!(output.status.code(), Some(2), "{output:?}");
    String::from_utf8(output.stderr).unwrap()
}

/// An unused path for one test.
pub(crate) fn free_path(name: &str) -> PathBuf {
    static CALLS: AtomicUsize = AtomicUsize::new(0);
    let (process, call) = (std::process::id(), CALLS.fetch_add(1, Ordering::Relaxed));
    let path = std::env::temp_dir().join(format!("armwire-cli-{name}-{process}-{call}"));
    let _ = fs::remove_file(&path);
    path
}

/// A running `armwire sim` on a pty.
pub(crate) struct Arm {
    child: Child,
    out: BufReader<ChildStdout>,
    pub(crate) port: String,
}

impl Arm {
    pub(crate) fn start(kind: &str, name: &str, args: &[&str]) -> Self {
        Self::start_at(kind, &free_path(name), args)
    }

    /// Starts it with a link at this path.
    pub(crate) fn start_at(kind: &str, link: &Path, args: &[&str]) -> Self {
        let port = link.to_str().unwrap().to_owned();
        let mut child = start(Command::new(PROGRAM).args(["sim", kind, "--pty", &port]).args(args));
        let mut out = BufReader::new(child.stdout.take().unwrap());
        let mut line = String::new();
        out.read_line(&mut line).unwrap();
        assert!(line.contains(&port), "{line}");
        Self { child, out, port }
    }

    /// Sends it a signal.
    pub(crate) fn signal(&self, signal: Signal) {
        kill_process(Pid::from_child(&self.child), signal).unwrap();
    }

    /// Kills it without a chance to clean up.
    pub(crate) fn kill(mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
        // The link of a killed program stays.
        self.port.clear();
    }

    /// Ends it with a signal. Returns the rest of its output.
    pub(crate) fn stop(self, signal: Signal) -> String {
        self.signal(signal);
        self.finish()
    }

    /// Waits for its end. Returns the rest of its output.
    pub(crate) fn finish(mut self) -> String {
        let deadline = Instant::now() + TIMEOUT;
        let status = loop {
            match self.child.try_wait().unwrap() {
                Some(status) => break status,
                None => assert!(Instant::now() < deadline, "it does not end"),
            }
            thread::sleep(Duration::from_millis(5));
        };
        assert!(status.success());
        let mut rest = String::new();
        self.out.read_to_string(&mut rest).unwrap();
        rest
    }
}

impl Drop for Arm {
    fn drop(&mut self) {
        // The link goes first: another test may get the pty, and a program that waits for this arm would open it.
        if !self.port.is_empty() {
            let _ = fs::remove_file(&self.port);
            let _ = fs::remove_file(format!("{}.lock", self.port));
        }
        // Both fail if the program has ended.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The angles of the joints of a Ling arm, in degrees.
pub(crate) fn angles(port: &str) -> Vec<f64> {
    let joints = success(&["call", "ling", port, "read-joints"]);
    let angles = joints
        .split('°')
        .filter_map(|text| text.rsplit(' ').next()?.parse().ok());
    let angles: Vec<f64> = angles.collect();
    assert_eq!(angles.len(), 6, "{joints}");
    angles
}

/// Runs a program with a pty for PORT in its arguments, and calls `arm` with all bytes that the program writes to the
/// pty.
pub(crate) fn run_against(args: &[&str], mut arm: impl FnMut(&Child, &Pty, &[u8])) -> Output {
    let pty = Pty::open(None).unwrap();
    let port = pty.path().to_str().unwrap();
    let args = args.iter().map(|arg| arg.replace("PORT", port));
    let mut child = start(Command::new(PROGRAM).args(args));
    let deadline = Instant::now() + TIMEOUT;
    loop {
        // The last output is still readable after the end.
        let ended = child.try_wait().unwrap().is_some() || Instant::now() > deadline;
        let mut request = [0; 64];
        if !ended {
            pty.wait(Some(Duration::from_millis(10))).unwrap();
        }
        match pty.read(&mut request).unwrap() {
            0 if ended => break,
            0 => {}
            n => arm(&child, &pty, &request[..n]),
        }
    }
    finish(child)
}
