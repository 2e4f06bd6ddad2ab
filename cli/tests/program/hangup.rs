//! A terminal that hangs up, like a closed window.

use std::fs::File;
use std::io::Read;
use std::os::unix::fs::OpenOptionsExt;
use std::process::{Command, Stdio};

use rustix::fs::OFlags;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::tcsetwinsize;

use crate::common::terminal::winsize;
use crate::common::{Arm, PROGRAM, finish};

#[test]
fn monitor_ends_with_its_terminal() {
    let arm = Arm::start("ling", "hung-up", &[]);
    let terminal = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).unwrap();
    grantpt(&terminal).unwrap();
    unlockpt(&terminal).unwrap();
    tcsetwinsize(&terminal, winsize(80, 24)).unwrap();
    let path = ptsname(&terminal, Vec::new()).unwrap().into_string().unwrap();
    let end = || {
        File::options()
            .read(true)
            .write(true)
            .custom_flags(OFlags::NOCTTY.bits() as i32)
            .open(&path)
            .unwrap()
    };
    // It is the controlling terminal, like that of a window.
    let mut command = Command::new("setsid");
    let command = command
        .args(["--ctty", PROGRAM, "monitor", &arm.port])
        .env("TERM", "xterm-256color")
        .stdin(end())
        .stdout(end());
    let child = command.stderr(Stdio::null()).spawn().unwrap();
    let mut terminal = File::from(terminal);
    let mut seen = Vec::new();
    while !seen.ends_with(b"q ends") {
        let mut byte = [0];
        terminal.read_exact(&mut byte).unwrap();
        seen.extend(byte);
    }
    drop(terminal);
    finish(child);
}
