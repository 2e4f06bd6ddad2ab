//! A terminal that a program runs on.

use std::fs::File;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use armwire_sim::pty::Pty;
use rustix::termios::{Winsize, tcsetwinsize};

use super::{PROGRAM, TIMEOUT, finish};

/// A terminal that a program runs on.
pub(crate) struct Terminal {
    pub(crate) pty: Pty,
    /// The program's output so far.
    pub(crate) seen: String,
}

pub(crate) fn winsize(columns: u16, rows: u16) -> Winsize {
    Winsize {
        ws_row: rows,
        ws_col: columns,
        ws_xpixel: 0,
        ws_ypixel: 0,
    }
}

impl Terminal {
    pub(crate) fn new(columns: u16, rows: u16) -> Self {
        let pty = Pty::open(None).unwrap();
        tcsetwinsize(File::open(pty.path()).unwrap(), winsize(columns, rows)).unwrap();
        let seen = String::new();
        Self { pty, seen }
    }

    /// Starts the program, whose errors are not on the terminal.
    pub(crate) fn start(&self, args: &[&str]) -> Child {
        self.command(args).stderr(Stdio::piped()).spawn().unwrap()
    }

    /// Starts the program, with all of its output on the terminal.
    pub(crate) fn start_whole(&self, args: &[&str]) -> Child {
        self.command(args).stderr(self.end()).spawn().unwrap()
    }

    /// Starts a command, with all of its output on the terminal.
    pub(crate) fn start_command(&self, command: &mut Command) -> Child {
        self.attach(command).stderr(self.end()).spawn().unwrap()
    }

    fn command(&self, args: &[&str]) -> Command {
        let mut command = Command::new(PROGRAM);
        self.attach(command.args(args));
        command
    }

    fn attach<'a>(&self, command: &'a mut Command) -> &'a mut Command {
        command
            .env("TERM", "xterm-256color")
            .stdin(self.end())
            .stdout(self.end())
    }

    fn end(&self) -> File {
        File::options().read(true).write(true).open(self.pty.path()).unwrap()
    }

    /// Reads until the program has written this text. Returns false if it ends without it, or on timeout.
    pub(crate) fn wait_for(&mut self, text: &str, child: &mut Child) -> bool {
        let deadline = Instant::now() + TIMEOUT;
        loop {
            let has_ended = child.try_wait().unwrap().is_some();
            self.read();
            if self.seen.contains(text) {
                return true;
            }
            if has_ended || Instant::now() > deadline {
                return false;
            }
        }
    }

    pub(crate) fn read(&mut self) {
        let mut bytes = [0; 4096];
        self.pty.wait(Some(Duration::from_millis(5))).unwrap();
        loop {
            match self.pty.read(&mut bytes).unwrap() {
                0 => return,
                n => self.seen += &String::from_utf8_lossy(&bytes[..n]),
            }
        }
    }

    pub(crate) fn finish(&mut self, mut child: Child) -> Output {
        // Otherwise a full buffer of the terminal would block the program.
        self.wait_for("no such text", &mut child);
        finish(child)
    }
}
