//! `armwire sim so101`, used through its pty, with orders on standard input.

use std::fs::{File, OpenOptions};
use std::io::{BufRead, BufReader, Read, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::{io, thread};

use rustix::fs::OFlags;
use rustix::process::{Pid, Signal, kill_process};

use crate::common::{Arm, PROGRAM, failure, finish, free_path, run, usage};

const PING: [u8; 6] = [0xFF, 0xFF, 0x01, 0x02, 0x01, 0xFB];

/// A running arm that takes orders.
struct Ordered {
    child: Child,
    orders: ChildStdin,
    out: BufReader<ChildStdout>,
    port: File,
}

impl Ordered {
    fn start(name: &str, args: &[&str]) -> Self {
        let path = free_path(name);
        let mut command = Command::new(PROGRAM);
        command.args(["sim", "so101", "--stdin", "--pty"]).arg(&path).args(args);
        command
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        let mut child = command.spawn().unwrap();
        let orders = child.stdin.take().unwrap();
        let mut out = BufReader::new(child.stdout.take().unwrap());
        let mut line = String::new();
        out.read_line(&mut line).unwrap();
        assert!(
            line.starts_with("SO-101 with ") && line.contains(path.to_str().unwrap()),
            "{line}"
        );
        // The pty must not become the controlling terminal.
        let flags = OFlags::NOCTTY.bits() as i32;
        let port = OpenOptions::new()
            .read(true)
            .write(true)
            .custom_flags(flags)
            .open(&path);
        let port = port.unwrap();
        Self {
            child,
            orders,
            out,
            port,
        }
    }

    /// The lines that answer an order.
    fn order(&mut self, line: &[u8]) -> Vec<String> {
        self.orders.write_all(&[line, b"\n"].concat()).unwrap();
        let mut lines = Vec::new();
        loop {
            let mut line = String::new();
            assert!(self.out.read_line(&mut line).unwrap() > 0, "it ended");
            let line = line.trim_end().to_owned();
            let is_last = line == "ok" || line.starts_with("error: ");
            lines.push(line);
            if is_last {
                return lines;
            }
        }
    }

    fn exchange<const N: usize>(&mut self, request: &[u8]) -> [u8; N] {
        self.port.write_all(request).unwrap();
        let mut answer = [0; N];
        self.port.read_exact(&mut answer).unwrap();
        answer
    }

    /// Ends it, and returns the rest of its output.
    fn stop(mut self) -> String {
        kill_process(Pid::from_child(&self.child), Signal::INT).unwrap();
        let mut rest = String::new();
        self.out.read_to_string(&mut rest).unwrap();
        let output = finish(self.child);
        assert!(output.status.success() && output.stderr.is_empty(), "{output:?}");
        rest
    }
}

#[test]
fn arm_answers_and_ends_in_a_flood_of_orders() {
    let arm = Ordered::start("so101-flood", &[]);
    let (mut child, mut orders, mut out, mut port) = (arm.child, arm.orders, arm.out, arm.port);
    let flood = thread::spawn(move || while orders.write_all(b"gremlins\n").is_ok() {});
    let reader = thread::spawn(move || io::copy(&mut out, &mut io::sink()).unwrap());
    port.write_all(&PING).unwrap();
    let mut answer = [0; 6];
    port.read_exact(&mut answer).unwrap();
    assert_eq!(answer, [0xFF, 0xFF, 0x01, 0x02, 0x00, 0xFC]);
    kill_process(Pid::from_child(&child), Signal::INT).unwrap();
    assert!(child.wait().unwrap().success());
    flood.join().unwrap();
    assert!(reader.join().unwrap() > 0);
}

#[test]
fn servos_answer_and_fail_on_order() {
    let mut arm = Ordered::start("so101", &[]);
    assert_eq!(arm.exchange(&PING), [0xFF, 0xFF, 0x01, 0x02, 0x00, 0xFC]);
    assert_eq!(arm.order(b"error 1 33"), ["ok"]);
    assert_eq!(arm.exchange(&PING), [0xFF, 0xFF, 0x01, 0x02, 0x21, 0xDB]);
    assert_eq!(arm.order(b"twice"), ["ok"]);
    let twice: [u8; 12] = arm.exchange(&PING);
    assert_eq!(twice[..6], twice[6..]);
    assert_eq!(arm.order(b"echo"), ["ok"]);
    let echoed: [u8; 12] = arm.exchange(&PING);
    assert_eq!(echoed[..6], PING);
    let rest = arm.stop();
    assert!(rest.contains("4 requests (4 answered, 0 refused)"), "{rest}");
}

#[test]
fn hand_moves_a_servo_and_state_shows_it() {
    let mut arm = Ordered::start("so101-hand", &["--ids", "1,2,9"]);
    assert_eq!(arm.order(b"hand 9 1500"), ["ok"]);
    let state = [
        "servo 1: position 2048, encoder 2048, torque off",
        "servo 2: position 2048, encoder 2048, torque off",
        "servo 9: position 1500, encoder 1500, torque off",
        "ok",
    ];
    assert_eq!(arm.order(b"state"), state);
    // Position of servo 9.
    let read = [0xFF, 0xFF, 0x09, 0x04, 0x02, 0x38, 0x02, 0xB6];
    assert_eq!(arm.exchange(&read), [0xFF, 0xFF, 0x09, 0x04, 0x00, 0xDC, 0x05, 0x11]);
    arm.stop();
}

#[test]
fn wrong_orders_are_answered_with_their_reason() {
    let mut arm = Ordered::start("so101-wrong", &[]);
    let names = "late, damaged, twice, brownout, silent, unplugged, error, echo, sag, hand, clear, state";
    for (line, reason) in [
        (&b"late x"[..], "'late x': expected late N[:MS]"),
        (b"hand 2", "'hand 2': expected hand ID POSITION"),
        (b"hand 2 4096", "servo 2: position is 4096 steps, must be 0..=4095"),
        (b"silent 7", "no servo has id 7"),
        (
            b"gremlins",
            &format!("unknown order 'gremlins': expected one of {names}"),
        ),
        (b"", &format!("unknown order '': expected one of {names}")),
        (
            b"\xFF\xFE",
            &format!("unknown order '\u{FFFD}\u{FFFD}': expected one of {names}"),
        ),
        (
            b"\x1b[2J",
            &format!("unknown order '\\u{{1b}}[2J': expected one of {names}"),
        ),
    ] {
        assert_eq!(arm.order(line), [format!("error: {reason}")]);
    }
    // None of them ended it, or changed it.
    assert_eq!(arm.exchange(&PING), [0xFF, 0xFF, 0x01, 0x02, 0x00, 0xFC]);
    arm.stop();
}

#[test]
fn orders_of_the_command_line_hold_from_the_start() {
    let args = [
        "--error",
        "1 1",
        "--damaged",
        "2",
        "--volts",
        "3.9",
        "--models",
        "2825",
        "--sag",
        "-20",
        "--late",
        "9:1",
    ];
    let mut arm = Ordered::start("so101-options", &args);
    assert_eq!(arm.exchange(&PING), [0xFF, 0xFF, 0x01, 0x02, 0x01, 0xFB]);
    let damaged: [u8; 6] = arm.exchange(&PING);
    assert_ne!(damaged, [0xFF, 0xFF, 0x01, 0x02, 0x01, 0xFB]);
    let model = [0xFF, 0xFF, 0x02, 0x04, 0x02, 0x03, 0x02, 0xF2];
    assert_eq!(arm.exchange(&model), [0xFF, 0xFF, 0x02, 0x04, 0x01, 0x09, 0x0B, 0xE4]);
    arm.stop();
}

#[test]
fn wrong_arguments_are_refused_with_their_reason() {
    for (args, reason) in [
        (["--late", "x"], "'late x': expected late N[:MS]"),
        (["--late", "0"], "'late 0': expected late N[:MS]"),
        (["--error", "1"], "'error 1': expected error ID BITS"),
        (["--error", "1 256"], "'error 1 256': expected error ID BITS"),
        (["--sag", "501"], "'sag 501': expected sag TICKS, -500 to 500"),
        (["--silent", "254"], "'silent 254': expected silent ID"),
        (["--silent", "7"], "no servo has id 7"),
        (["--ids", "1,2,1"], "two servos have id 1"),
        (["--ids", "254"], "servo id is 254, must be 0..=253"),
        (["--ids", "3-1"], "'3-1' is a descending range"),
        (["--ids", ""], "'' is not an id from 0 to 253"),
        (
            ["--models", "777,778"],
            "there are 2 models for 6 servos: expected one, or one for each",
        ),
        (["--models", "x"], "invalid digit found in string"),
        (["--volts", "26"], "supply is 26 V, must be 0..=25.4"),
        (["--volts", "-1"], "supply is -1 V, must be 0..=25.4"),
        (
            ["--faults", "gremlins=1"],
            "unknown fault 'gremlins': expected drop, corrupt, duplicate, delay or noise",
        ),
    ] {
        let error = usage(&[&["sim", "so101"][..], &args].concat());
        let line = error.lines().next().unwrap_or_default();
        assert!(line.ends_with(&format!(": {reason}")), "{args:?}: {error}");
    }
}

#[test]
fn another_arm_at_the_path_is_an_error() {
    let arm = Arm::start("ling", "so101-taken", &[]);
    let error = failure(&run(&["sim", "so101", "--pty", &arm.port]));
    let reason = "is in use by another server: end that one, or choose another path";
    assert_eq!(error, format!("cannot serve a virtual arm: {} {reason}", arm.port));
    arm.stop(Signal::INT);
}
