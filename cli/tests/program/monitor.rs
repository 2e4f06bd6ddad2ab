//! `armwire monitor` for other programs, and on a terminal.

use std::io::{BufRead, BufReader};
use std::process::{Child, Command};
use std::time::Instant;

use armwire_sim::pty::Pty;
use rustix::process::{Pid, Signal, kill_process};

use crate::common::board::Board;
use crate::common::terminal::Terminal;
use crate::common::{Arm, NO_ANSWER, PROGRAM, TIMEOUT, failure, finish, retry_while, run, start, success, usage};
use crate::legacy::STOPPED;

/// The rows of a monitor's JSON, each a line.
fn rows(out: &str) -> Vec<serde_json::Value> {
    out.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

#[test]
fn csv_names_have_units() {
    let arm = Arm::start("ling", "csv", &["--plant", "ideal"]);
    let out = success(&["monitor", &arm.port, "--rate", "200", "--csv", "--count", "3"]);
    let lines: Vec<_> = out.lines().collect();
    assert_eq!(
        lines[0],
        "time_s,adapter_time_us,latency_us,joint_1_deg,joint_2_deg,joint_3_deg,joint_4_deg,joint_5_deg,joint_6_deg,\
         gripper_percent,status,temperature_1_celsius,temperature_2_celsius,temperature_3_celsius,temperature_4_celsius,\
         temperature_5_celsius,temperature_6_celsius,temperature_7_celsius,temperature_8_celsius,temperature_9_celsius,\
         temperature_10_celsius"
    );
    assert_eq!(lines.len(), 4);
    for line in &lines[1..] {
        let fields: Vec<_> = line.split(',').collect();
        assert_eq!(fields.len(), 21, "{line}");
        assert_eq!(
            (fields[1], &fields[3..11]),
            ("", &["0.0", "0.0", "0.0", "0.0", "0.0", "0.0", "0.0", "locked"][..])
        );
        assert!(
            fields[0].parse::<f64>().is_ok() && fields[2].parse::<u64>().is_ok(),
            "{line}"
        );
        assert!(
            fields[11..].iter().all(|celsius| celsius.parse::<u8>().is_ok()),
            "{line}"
        );
    }
}

#[test]
fn missing_values_of_an_arm_are_null() {
    let arm = Arm::start("ling", "json", &["--leader"]);
    for row in rows(&success(&[
        "monitor", &arm.port, "--rate", "200", "--json", "--count", "2",
    ])) {
        assert!(row["temperature_6_celsius"].is_u64(), "{row}");
        assert!(
            row["temperature_7_celsius"].is_null() && row["adapter_time_us"].is_null(),
            "{row}"
        );
    }
    let robot = Arm::start("alpha1", "json-alpha1", &[]);
    let args = ["monitor", "--arm", "alpha1", &robot.port, "--json", "--count", "1"];
    let row = &rows(&success(&args))[0];
    assert!(
        row["servo_1_runs"].is_u64() && row.get("servo_32_runs").is_some_and(serde_json::Value::is_null),
        "{row}"
    );
    assert!(row["status"].is_null() && row.get("joint_1_deg").is_none(), "{row}");
}

#[test]
fn legacy_arm_has_its_own_columns() {
    let arm = Arm::start("ling", "json-older", &["--legacy"]);
    let args = ["monitor", &arm.port, "--json", "--count", "1"];
    let output = retry_while(NO_ANSWER, || retry_while(STOPPED, || run(&args)));
    let row = &rows(&String::from_utf8(output.stdout).unwrap())[0];
    assert_eq!(
        (&row["joint_6_deg"], &row["potentiometer_raw"]),
        (&0.0.into(), &2048.into())
    );
}

#[test]
fn conflicting_arguments_are_refused() {
    for args in [
        &["--csv", "--json"][..],
        &["--from-adapter", "--rate", "5"],
        &["--from-adapter", "--arm", "xarm"],
    ] {
        let text = usage(&[&["monitor", "/dev/no-such-port"], args].concat());
        assert!(text.contains("cannot be used with"), "{text}");
    }
}

/// The escape sequences that enter and leave the alternate screen.
const ENTER: &str = "\x1b[?1049h";
const LEAVE: &str = "\x1b[?1049l";

/// A monitor on a terminal that has drawn this text. It is repeated if it ends early: on a busy system, an arm may be
/// silent.
fn start_until_drawn(terminal: &mut Terminal, args: &[&str], text: &str) -> Child {
    let deadline = Instant::now() + TIMEOUT;
    loop {
        let mut child = terminal.start(args);
        if terminal.wait_for(text, &mut child) {
            return child;
        }
        let output = finish(child);
        assert!(
            Instant::now() < deadline,
            "{text:?} is not drawn: {output:?}, {}",
            terminal.seen
        );
    }
}

#[test]
fn screen_shows_the_arm_until_a_key() {
    let arm = Arm::start("ling", "screen", &[]);
    for key in ["q", "\x1b", "\x03"] {
        let mut terminal = Terminal::new(100, 30);
        let child = start_until_drawn(&mut terminal, &["monitor", &arm.port], "q ends");
        for text in [ENTER, "joint 6", "locked", "°C", "readings/s", "unanswered", "q ends"] {
            assert!(terminal.seen.contains(text), "{text:?} is not in {:?}", terminal.seen);
        }
        assert!(!terminal.seen.contains(LEAVE));
        terminal.pty.write(key.as_bytes()).unwrap();
        let output = terminal.finish(child);
        assert!(output.status.success() && output.stderr.is_empty(), "{output:?}");
        assert!(terminal.seen.contains(LEAVE), "{:?}", terminal.seen);
    }
}

#[test]
fn screen_shows_the_adapter_too() {
    let board = Board::start("screen");
    let mut terminal = Terminal::new(100, 40);
    let args = ["monitor", &board.port, "--control", &board.control, "--count", "20"];
    let child = start_until_drawn(&mut terminal, &args, "requests_usb");
    // The cursor moves between words.
    for text in ["virtual,", "1.2.3", "(1a2b3c4d5e6f)", "answer", "control_requests"] {
        assert!(terminal.seen.contains(text), "{text:?} is not in {:?}", terminal.seen);
    }
    assert!(terminal.finish(child).status.success());
    assert!(terminal.seen.contains(LEAVE), "{:?}", terminal.seen);
}

#[test]
fn screen_leaves_a_summary() {
    let arm = Arm::start("ling", "summary", &[]);
    let mut terminal = Terminal::new(120, 24);
    let child = start_until_drawn(&mut terminal, &["monitor", &arm.port, "--count", "5"], LEAVE);
    assert!(terminal.finish(child).status.success());
    let (_, left) = terminal.seen.rsplit_once(LEAVE).unwrap();
    let begin = format!("{} (Ling arm), ", arm.port);
    assert!(
        left.contains(&begin) && left.contains(" s: readings 5, unanswered "),
        "{left:?}"
    );
    assert!(left.contains(", port lost 0, latency "), "{left:?}");
}

#[test]
fn monitor_waits_until_the_same_arm_is_back() {
    let arm = Arm::start("ling", "gone", &[]);
    let port = arm.port.clone();
    let mut monitor = start(Command::new(PROGRAM).args(["monitor", &port, "--json"]));
    let mut out = BufReader::new(monitor.stdout.take().unwrap()).lines();
    let mut stderr = BufReader::new(monitor.stderr.take().unwrap()).lines();
    let mut reading = || {
        out.by_ref()
            .map(Result::unwrap)
            .find(|line| !line.contains("\"joint_1_deg\":null"))
            .unwrap()
    };
    let mut notice = || {
        let mut lines = stderr.by_ref().map(Result::unwrap);
        lines.find(|line| !line.contains(NO_ANSWER)).unwrap()
    };
    reading();
    drop(arm);
    let lost = notice();
    assert!(
        lost.starts_with("armwire: waiting for the port: ") && lost.contains("the port is gone"),
        "{lost}"
    );
    let other = Arm::start_at("ling", port.as_ref(), &["--serial", "ADFS990000000001"]);
    let replaced = notice();
    assert!(
        replaced.contains("another arm is on this port: ADFS990000000001"),
        "{replaced}"
    );
    drop(other);
    let _arm = Arm::start_at("ling", port.as_ref(), &[]);
    assert_eq!(notice(), format!("armwire: {port}: the port is back"));
    // The first lines may be from before the loss.
    for _ in 0..100 {
        reading();
    }
    kill_process(Pid::from_child(&monitor), Signal::INT).unwrap();
    assert!(finish(monitor).status.success());
}

#[test]
fn loss_of_the_port_ends_a_script() {
    let arm = Arm::start("ling", "gone-script", &[]);
    let mut monitor = start(Command::new(PROGRAM).args(["monitor", &arm.port, "--json", "--exit-on-loss"]));
    let mut out = BufReader::new(monitor.stdout.take().unwrap()).lines();
    assert!(out.next().unwrap().unwrap().contains("joint"));
    drop(arm);
    let error = failure(&finish(monitor));
    assert!(error.contains("the port is gone"), "{error}");
}

#[test]
fn screen_waits_for_a_lost_port() {
    let arm = Arm::start("ling", "gone-screen", &[]);
    let mut terminal = Terminal::new(200, 24);
    let mut child = start_until_drawn(&mut terminal, &["monitor", &arm.port], "q ends");
    drop(arm);
    assert!(terminal.wait_for("waiting", &mut child), "{:?}", terminal.seen);
    terminal.pty.write(b"q").unwrap();
    assert!(terminal.finish(child).status.success());
    assert!(
        terminal.seen.contains(LEAVE) && terminal.seen.contains("port lost 1"),
        "{:?}",
        terminal.seen
    );
}

#[test]
fn monitor_starts_on_a_noisy_line() {
    for seed in ["1", "2", "3", "4"] {
        let arm = Arm::start("ling", "noisy", &["--faults", "10000", "--seed", seed]);
        let output = run(&["monitor", &arm.port, "--rate", "100", "--count", "2", "--json"]);
        assert!(output.status.success(), "{output:?}");
    }
}

#[test]
fn noise_alone_is_shown() {
    let pty = Pty::open(None).unwrap();
    let mut terminal = Terminal::new(120, 24);
    let mut child = terminal.start(&["monitor", pty.path().to_str().unwrap()]);
    let mut request = [0; 64];
    while !terminal.seen.contains("nothing received yet") && child.try_wait().unwrap().is_none() {
        if pty.read(&mut request).unwrap() > 0 {
            pty.write(&[0x55; 8]).unwrap();
        }
        terminal.read();
    }
    terminal.pty.write(b"q").unwrap();
    assert!(terminal.finish(child).status.success(), "{:?}", terminal.seen);
}

#[test]
fn silent_arm_takes_no_screen() {
    let silent = Pty::open(None).unwrap();
    let mut terminal = Terminal::new(80, 24);
    let child = terminal.start(&["monitor", silent.path().to_str().unwrap()]);
    let output = terminal.finish(child);
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    assert!(String::from_utf8(output.stderr).unwrap().contains(NO_ANSWER));
    assert!(!terminal.seen.contains(ENTER), "{:?}", terminal.seen);
}
