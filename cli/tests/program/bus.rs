//! `armwire bus` on a virtual SO-101.

use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::process::Command;

use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;

use crate::common::{Arm, PROGRAM, failure, finish, run, start, usage};

/// The report on a virtual arm with these options, and the exit status and errors of the command.
fn report(name: &str, sim: &[&str], bus: &[&str]) -> (String, Option<i32>, String) {
    let arm = Arm::start("so101", name, sim);
    let output = run(&[&["bus", &arm.port][..], bus].concat());
    arm.stop(Signal::INT);
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (text(output.stdout), output.status.code(), text(output.stderr))
}

#[test]
fn healthy_bus_has_a_line_for_each_servo() {
    let (text, status, progress) = report(
        "bus",
        &[],
        &["--seconds", "1", "--fail-on", "damaged,errors,differs,noise,echo"],
    );
    assert_eq!(status, Some(0), "{progress}");
    let lines: Vec<_> = text.lines().collect();
    assert!(lines[0].contains("model  firmware"), "{text}");
    for (servo, line) in lines[1..7].iter().enumerate() {
        let words: Vec<_> = line.split_whitespace().collect();
        assert_eq!(
            words[..4],
            [&*(servo + 1).to_string(), "777", "3.10", "7.4-7.4"],
            "{text}"
        );
        assert_eq!((words[6], words[words.len() - 1]), ("off", "-"), "{text}");
    }
    assert!(lines[7].starts_with("1000000 baud; 0 noise bytes"), "{text}");
    assert!(progress.contains("6 servos at 1000000 baud"), "{progress}");
}

#[test]
fn one_servo_is_in_the_singular() {
    let (_, status, progress) = report("bus-one", &[], &["--ids", "3", "--seconds", "1", "--baud", "1000000"]);
    assert_eq!(status, Some(0), "{progress}");
    assert!(progress.contains(" 1 servo at 1000000 baud;"), "{progress}");
}

#[test]
fn findings_have_advice_and_fail_on_demand() {
    let sim = ["--volts", "3.9", "--ids", "1,2", "--models", "777,2825", "--echo"];
    let (text, status, errors) = report(
        "bus-findings",
        &sim,
        &["--seconds", "1", "--fail-on", "errors,differs,echo"],
    );
    assert_eq!(status, Some(1));
    for line in [
        "errors: servo 1 reports voltage: its supply is 3.9 to 3.9 V, its registers 15 and 14 allow 4.0 to 8.0 V",
        "differs: model differs: 777 (servo 1), 2825 (servo 2)",
        "echo: the line returns the host's bytes: ",
    ] {
        assert!(text.lines().any(|found| found.starts_with(line)), "{text}");
    }
    assert!(errors.contains("found: errors, differs, echo"), "{errors}");
}

#[test]
fn noise_blames_no_other_program() {
    for (name, fault) in [("bus-twice", "--twice"), ("bus-damaged", "--damaged")] {
        let (text, ..) = report(name, &[fault, "40"], &["--seconds", "1"]);
        let noise = text.lines().find(|line| line.starts_with("noise: ")).unwrap();
        assert!(noise.contains(": of damaged or repeated answers, "), "{noise}");
    }
}

#[test]
fn json_has_counts_and_settings() {
    let (text, status, errors) = report("bus-json", &["--error", "2 32"], &["--seconds", "1", "--json"]);
    assert_eq!((status, &*errors), (Some(0), ""));
    let report: Value = serde_json::from_str(&text).unwrap();
    let servo = &report["servos"][1];
    assert_eq!(
        (&servo["id"], &servo["error_bits"], &servo["torque"]),
        (&2.into(), &32.into(), &false.into())
    );
    assert_eq!(servo["settings"]["return-delay"], 250);
    assert_eq!(report["findings"][0]["kind"], "errors");
}

#[test]
fn values_that_were_not_read_are_not_shown() {
    let arm = Arm::start("so101", "bus-unread", &[]);
    let [text, report] = [&[] as &[&str], &["--json"]].map(|format| {
        let output = run(&[&["bus", &arm.port, "--seconds", "0"][..], format].concat());
        String::from_utf8(output.stdout).unwrap()
    });
    arm.stop(Signal::INT);
    let words: Vec<_> = text.lines().nth(1).unwrap().split_whitespace().collect();
    assert_eq!(
        words,
        ["1", "-", "-.-", "-", "-", "-", "-", "0", "0", "0", "0", "-", "-"]
    );
    let report: Value = serde_json::from_str(&report).unwrap();
    let servo = &report["servos"][0];
    for field in ["volts", "temperature", "load_percent", "torque", "latency_ms"] {
        assert!(servo[field].is_null(), "{servo}");
    }
}

#[test]
fn interrupted_report_has_what_was_read() {
    let arm = Arm::start("so101", "bus-interrupted", &[]);
    let mut child = start(Command::new(PROGRAM).args(["bus", &arm.port, "--seconds", "600"]));
    let mut progress = String::new();
    BufReader::new(child.stderr.take().unwrap())
        .read_line(&mut progress)
        .unwrap();
    assert!(progress.contains("6 servos"), "{progress}");
    let error = failure(&run(&["bus", &arm.port, "--seconds", "1"]));
    assert!(
        error.contains("in use by another program, armwire (process "),
        "{error}"
    );
    kill_process(Pid::from_child(&child), Signal::INT).unwrap();
    let mut text = String::new();
    child.stdout.take().unwrap().read_to_string(&mut text).unwrap();
    assert!(text.contains("1000000 baud; "), "{text}");
    assert!(finish(child).status.success());
    arm.stop(Signal::INT);
}

#[test]
fn another_arm_and_no_port_are_errors() {
    let arm = Arm::start("ling", "bus-ling", &[]);
    let output = run(&["bus", &arm.port, "--ids", "1-2", "--baud", "1000000"]);
    let error = failure(&output);
    assert!(
        error.starts_with(&arm.port) && error.contains("no servo answers"),
        "{error}"
    );
    arm.stop(Signal::INT);
    for (port, reason) in [
        ("/nowhere/tty", "/nowhere/tty: no such port"),
        ("/dev/null", "/dev/null: not a serial port"),
        (
            "usb:no-such-number",
            "usb:no-such-number: no port has this USB serial number",
        ),
    ] {
        let error = failure(&run(&["bus", port]));
        assert!(error.starts_with(reason), "{error}");
    }
    // No option of this command opens an arm of another kind.
    let error = failure(&run(&["bus", "192.168.1.10"]));
    assert_eq!(
        error,
        "192.168.1.10: no such port; a server of a serial port is tcp:HOST:PORT"
    );
    for port in ["hid:", "control:/tmp/control"] {
        let error = usage(&["bus", port]);
        assert!(error.contains(port) && !error.contains("arm "), "{error}");
    }
}

#[test]
fn program_that_takes_the_answers_is_named() {
    let arm = Arm::start("so101", "bus-shared", &["--unplugged", "1"]);
    let other = File::open(&arm.port).unwrap();
    let error = failure(&run(&["bus", &arm.port, "--ids", "1", "--baud", "1000000"]));
    assert!(
        error.contains("no servo answers to the ids") && error.contains("the port is also open in another program"),
        "{error}"
    );
    drop(other);
    arm.stop(Signal::INT);
}

#[test]
fn progress_is_shown_if_so_asked() {
    // The search for these takes no second, and the reading is long enough for a line on a busy system.
    let options = ["--ids", "1-6", "--seconds", "2", "--json", "--progress"];
    let (text, status, errors) = report("bus-progress", &[], &options);
    assert_eq!(status, Some(0), "{errors}");
    assert!(serde_json::from_str::<Value>(&text).is_ok(), "{text}");
    assert!(
        errors.starts_with("armwire: 1 s: ") && errors.contains(" answers, "),
        "{errors}"
    );
}

#[test]
fn bytes_without_a_servo_are_named() {
    let arm = Arm::start("so101", "bus-echo", &["--echo", "--unplugged", "1"]);
    let error = failure(&run(&["bus", &arm.port, "--ids", "1-2", "--baud", "1000000"]));
    assert!(
        error.contains(
            "no servo answers to the ids of --ids; 0 noise bytes, 0 answers without a request, 2 echoes came"
        ),
        "{error}"
    );
    arm.stop(Signal::INT);
}

#[test]
fn lost_port_leaves_the_report_so_far() {
    let arm = Arm::start("so101", "bus-lost", &[]);
    let mut child = start(Command::new(PROGRAM).args(["bus", &arm.port, "--seconds", "600"]));
    let mut progress = String::new();
    let mut errors = BufReader::new(child.stderr.take().unwrap());
    errors.read_line(&mut progress).unwrap();
    assert!(progress.contains("6 servos"), "{progress}");
    arm.stop(Signal::INT);
    let mut text = String::new();
    child.stdout.take().unwrap().read_to_string(&mut text).unwrap();
    assert!(text.contains("1000000 baud; "), "{text}");
    assert_eq!(child.wait().unwrap().code(), Some(1));
}

#[test]
fn wrong_options_are_refused() {
    for (args, reason) in [
        (["--ids", "254"], "'254' is not an id from 0 to 253"),
        (["--ids", "3-1"], "descending range"),
        (["--ids", "1-3,2"], "id 2 is there twice"),
        (["--baud", "0"], "'0' is not a baud rate or 'auto'"),
        (["--baud", "fast"], "'fast' is not a baud rate or 'auto'"),
        (["--seconds", "-1"], "'-1' is not a valid time in seconds"),
        (["--fail-on", "lost,gremlins"], "gremlins"),
    ] {
        let error = usage(&[&["bus", "/dev/ttyACM0"][..], &args].concat());
        assert!(error.contains(reason), "{error}");
    }
}
