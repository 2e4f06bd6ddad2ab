//! `armwire sim xarm`: output, access and end.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::process::{Child, Command};

use rustix::process::{Pid, Signal, kill_process};

use crate::common::{PROGRAM, TIMEOUT, failure, finish, run, start, success, usage};

/// A running `armwire sim xarm` on free ports.
pub(crate) struct SimXArm {
    /// `None` after [`finish`](Self::finish).
    child: Option<Child>,
    /// Its first output.
    line: String,
}

impl SimXArm {
    pub(crate) fn start(args: &[&str]) -> Self {
        let listen = ["sim", "xarm", "--listen", "127.0.0.1:0"];
        Self::run(Command::new(PROGRAM).args(listen).args(args))
    }

    fn run(command: &mut Command) -> Self {
        let mut child = start(command);
        let mut line = String::new();
        // A buffer of one byte leaves the output after the line to other readers.
        let mut out = BufReader::with_capacity(1, child.stdout.as_mut().unwrap());
        out.read_line(&mut line).unwrap();
        let child = Some(child);
        Self { child, line }
    }

    /// The addresses in its first output.
    pub(crate) fn addresses(&self) -> Vec<&str> {
        let words = self.line.split([' ', ',', ';']);
        words.filter(|word| word.starts_with("127.0.0.1:")).collect()
    }

    /// The next line on stderr that contains this text.
    fn wait_for(&mut self, text: &str) -> String {
        let mut out = BufReader::with_capacity(1, self.child.as_mut().unwrap().stderr.as_mut().unwrap());
        loop {
            let mut line = String::new();
            assert_ne!(out.read_line(&mut line).unwrap(), 0, "it ended without '{text}'");
            if line.contains(text) {
                return line;
            }
        }
    }

    /// Waits until it succeeds. Returns its output and its messages about clients.
    fn finish(mut self) -> (String, String) {
        let output = finish(self.child.take().unwrap());
        assert!(output.status.success(), "{output:?}");
        (
            String::from_utf8(output.stdout).unwrap(),
            String::from_utf8(output.stderr).unwrap(),
        )
    }

    fn interrupt(self) -> (String, String) {
        kill_process(Pid::from_child(self.child.as_ref().unwrap()), Signal::INT).unwrap();
        self.finish()
    }
}

impl Drop for SimXArm {
    fn drop(&mut self) {
        if let Some(mut child) = self.child.take() {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

fn connect(address: &str) -> TcpStream {
    let stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(TIMEOUT)).unwrap();
    stream
}

#[test]
fn virtual_xarm_reports_its_address_and_traffic() {
    let arm = SimXArm::start(&[
        "--report-listen",
        "127.0.0.1:0",
        "--axes",
        "7",
        "--serial",
        "XS12345678",
    ]);
    let [control, report] = arm.addresses()[..] else {
        panic!("{}", arm.line)
    };
    assert_eq!(
        arm.line,
        format!(
            "xArm 7 XS12345678, control box AC130202B02L02 is at {control}, its reports at {report}; Ctrl-C ends it.\n"
        )
    );
    let mut first = [0; 495];
    connect(report).read_exact(&mut first).unwrap();
    assert_eq!(first[145..147], [7, 7]);

    let mut client = connect(control);
    client.write_all(&[0, 1, 0, 2, 0, 1, 5, 0, 0, 0, 9]).unwrap();
    let mut answer = Vec::new();
    client.read_to_end(&mut answer).unwrap();
    assert_eq!(answer, [0, 1, 0, 2, 0, 3, 5, 0x10, 0]);

    let (rest, notices) = arm.interrupt();
    assert!(
        rest.starts_with("2 connections, 1 broken; 1 requests, 0 unknown frames; "),
        "{rest}"
    );
    let broken = format!(
        "armwire: {}: connection closed, not an xArm frame after 7 bytes: byte 3 is 0x09, expected 0x00 or 0x01 or 0x02 or 0x03",
        client.local_addr().unwrap()
    );
    assert!(
        notices.lines().any(|line| line == broken),
        "{broken} is not in\n{notices}"
    );
}

#[test]
fn virtual_xarm_starts_with_given_error_and_warning() {
    let arm = SimXArm::start(&["--no-report", "--error", "2", "--warning", "13"]);
    assert!(arm.line.contains(", without reports;"), "{}", arm.line);
    let mut client = connect(arm.addresses()[0]);
    client.write_all(&[0, 1, 0, 2, 0, 1, 15]).unwrap();
    let mut answer = [0; 10];
    client.read_exact(&mut answer).unwrap();
    assert_eq!(answer, [0, 1, 0, 2, 0, 4, 15, 0x70, 2, 13]);
    arm.interrupt();
}

#[test]
fn virtual_xarm_ends_on_a_clients_shutdown() {
    let arm = SimXArm::start(&["--no-report"]);
    let mut client = connect(arm.addresses()[0]);
    client.write_all(&[0, 1, 0, 2, 0, 2, 10, 1]).unwrap();
    let mut answer = Vec::new();
    client.read_to_end(&mut answer).unwrap();
    assert_eq!(answer, [0, 1, 0, 2, 0, 2, 10, 0x10]);
    drop(client);
    let (_, notices) = arm.finish();
    assert!(notices.contains("shuts the arm down"), "{notices}");
}

#[test]
fn remote_access_needs_an_option() {
    for open in [
        ["--listen", "0.0.0.0:0"],
        ["--listen", "[::]:0"],
        ["--report-listen", "0.0.0.0:0"],
    ] {
        let args = [
            &["sim", "xarm"][..],
            if open[0] == "--listen" {
                &[]
            } else {
                &["--listen", "127.0.0.1:0"]
            },
            &open,
        ];
        let text = usage(&args.concat());
        assert!(text.contains("--allow-remote") && text.contains(open[1]), "{text}");
    }
    let arm = SimXArm::start(&["--report-listen", "0.0.0.0:0", "--allow-remote"]);
    assert!(arm.line.contains("its reports at 0.0.0.0:"), "{}", arm.line);
    arm.interrupt();
    assert!(success(&["sim", "xarm", "--help"]).contains("any program that reaches the arm can move, reboot and shut"));
}

#[test]
fn occupied_port_is_reported() {
    let occupied = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = occupied.local_addr().unwrap().to_string();
    let listen = ["--listen", &*address, "--no-report"];
    let report = ["--listen", "127.0.0.1:0", "--report-listen", &*address];
    for (args, option) in [
        (&listen[..], "--listen 127.0.0.1:0"),
        (&report[..], "--report-listen 127.0.0.1:0, or --no-report"),
    ] {
        let output = run(&[&["sim", "xarm"], args].concat());
        let expected = format!(
            "cannot serve a virtual arm: {address}: in use by another program: close that one, or choose any free port \
             ({option})"
        );
        assert_eq!(failure(&output), expected);
    }
}

#[test]
fn two_ports_at_one_address_blame_nobody() {
    for (listen, report) in [
        ("127.0.0.1:15020", "127.0.0.1:15020"),
        ("127.0.0.1:15020", "0.0.0.0:15020"),
    ] {
        let args = [
            "sim",
            "xarm",
            "--allow-remote",
            "--listen",
            listen,
            "--report-listen",
            report,
        ];
        let text = usage(&args);
        assert!(
            text.contains("requests and reports are both to be at port 15020"),
            "{text}"
        );
    }
    let text = usage(&["sim", "xarm", "--listen", "127.0.0.1:30002"]);
    assert!(text.contains("both to be at port 30002"), "{text}");
}

#[test]
fn impossible_arms_and_addresses_are_refused() {
    for (wrong, why) in [
        (["--axes", "4"], "expected 5, 6 or 7"),
        (["--serial", "a serial"], "character of a serial number is 32"),
        (["--error", "256"], "'256' is not a whole number from 0 to 255"),
        (["--warning", "-1"], "'-1' is not a whole number from 0 to 255"),
    ] {
        let text = usage(&[&["sim", "xarm", "--listen", "127.0.0.1:0", "--no-report"][..], &wrong].concat());
        assert!(text.contains(why), "{text}");
    }
    for address in ["localhost:15020", "127.0.0.1", "15020"] {
        let text = usage(&["sim", "xarm", "--listen", address]);
        assert!(text.contains("such as 127.0.0.1:15020"), "{text}");
    }
}

const STATE: [u8; 7] = [0, 9, 0, 3, 0, 1, 13];
const STATE_ANSWER: [u8; 9] = [0, 9, 0, 3, 0, 3, 13, 0x10, 4];

fn assert_answers(mut client: &TcpStream) {
    client.write_all(&STATE).unwrap();
    let mut answer = [0; STATE_ANSWER.len()];
    client.read_exact(&mut answer).unwrap();
    assert_eq!(answer, STATE_ANSWER);
}

#[test]
fn silent_clients_do_not_block_others() {
    let arm = SimXArm::start(&["--report-listen", "127.0.0.1:0"]);
    let [control, report] = arm.addresses()[..] else {
        panic!("{}", arm.line)
    };
    let silent: Vec<_> = (0..64).map(|_| (connect(control), connect(report))).collect();
    assert_answers(&connect(control));
    let mut first = [0; 495];
    connect(report).read_exact(&mut first).unwrap();
    drop(silent);
    arm.interrupt();
}

#[test]
fn virtual_xarm_survives_running_out_of_files() {
    // The limit of open files is below the number of clients.
    let limited = [
        "-c",
        r#"ulimit -n 24; exec "$@""#,
        "sh",
        PROGRAM,
        "sim",
        "xarm",
        "--listen",
        "127.0.0.1:0",
        "--no-report",
    ];
    let mut arm = SimXArm::run(Command::new("sh").args(limited));
    let control = arm.addresses()[0].to_owned();
    let clients: Vec<_> = (0..30).map(|_| connect(&control)).collect();
    let line = arm.wait_for("cannot accept");
    assert!(line.contains("Too many open files"), "{line}");
    drop(clients);
    assert_answers(&connect(&control));
    let (_, notices) = arm.interrupt();
    assert!(!notices.contains("cannot accept"), "{notices}");
}
