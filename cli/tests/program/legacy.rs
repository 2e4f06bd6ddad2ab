//! The built program against Ling arms of the older generation, which it identifies and reads. The tests in
//! `src/legacy.rs` check, in virtual time, that it sends them nothing.

use std::fs;

use armwire::ling::legacy::{Firmware, GripperState, JointState, Legacy, MAX_FRAME, Response, SERVOS};
use armwire::messages::Messages;

use crate::common::{Arm, NO_ANSWER, failure, free_path, retry_while, run, run_against, success, usage};

/// Message for an arm that has stopped transmitting.
pub(crate) const STOPPED: &str = "stopped sending";

/// The frames of an arm of the older generation: joints and gripper.
fn frames(joint: u16) -> Vec<u8> {
    let firmware = Firmware::V5;
    let servos = [joint; SERVOS];
    let joints = Response::Joints(JointState { firmware, servos });
    let gripper = Response::Gripper(GripperState {
        firmware,
        id: 1,
        servo: 2051,
        potentiometer: 2048,
        sync_button: 0,
        attitude_button: 1,
    });
    let mut bytes = Vec::new();
    for response in [joints, gripper] {
        let mut out = [0; MAX_FRAME];
        let n = Legacy.encode_response(&response, None, &mut out).unwrap();
        bytes.extend(&out[..n]);
    }
    bytes
}

#[test]
fn legacy_arm_is_named() {
    let arm = Arm::start("ling", "older", &["--legacy"]);
    for args in [&["info", &arm.port][..], &["call", "ling", &arm.port, "read-joints"]] {
        let line = failure(&retry_while(NO_ANSWER, || run(args)));
        let message = format!("{}: this is a Ling arm of the older generation (", arm.port);
        assert!(line.starts_with(&message), "{line}");
        assert!(
            line.contains("sends nothing to it. All other functions need a firmware update from the vendor"),
            "{line}"
        );
        assert!(line.contains("1000000 or 921600 baud"), "{line}");
        assert!(line.ends_with("'armwire monitor' shows its joints."), "{line}");
    }
}

#[test]
fn monitor_shows_joints_of_a_legacy_arm() {
    let arm = Arm::start("ling", "older-monitor", &["--legacy"]);
    let args = ["monitor", &arm.port, "--rate", "100", "--count", "5"];
    let output = retry_while(NO_ANSWER, || retry_while(STOPPED, || run(&args)));
    assert!(output.status.success(), "{output:?}");
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert!(
        stderr.contains("older generation") && stderr.lines().count() == 1,
        "{stderr}"
    );
    let out = String::from_utf8(output.stdout).unwrap();
    assert_eq!(out.lines().count(), 5, "{out}");
    for line in out.lines() {
        assert!(
            line.contains("joints: +0.00°") && line.contains("gripper: 2048, potentiometer: 2048"),
            "{out}"
        );
    }
}

#[test]
fn late_legacy_arm_is_named_too() {
    let output = retry_while(NO_ANSWER, || {
        run_against(&["info", "PORT"], |_, pty, _| {
            pty.write(&frames(2048).repeat(2)).unwrap();
        })
    });
    let line = failure(&output);
    assert!(line.contains("older generation"), "{line}");
}

#[test]
fn monitor_reports_a_legacy_arm_that_falls_silent() {
    let output = retry_while(NO_ANSWER, || {
        run_against(&["monitor", "PORT", "--rate", "1000"], |_, pty, _| {
            pty.write(&frames(2048).repeat(2)).unwrap();
        })
    });
    let stderr = String::from_utf8(output.stderr).unwrap();
    let lines: Vec<_> = stderr.lines().collect();
    assert!(
        lines[0].contains("older generation") && lines[1].contains(STOPPED),
        "{stderr}"
    );
    assert_eq!(output.status.code(), Some(1));
}

#[test]
fn decode_names_and_reads_a_legacy_recording() {
    let path = free_path("older-recording");
    fs::write(&path, [&[0x08, 0xFF][..], &frames(3072), &frames(1024)].concat()).unwrap();
    let out = success(&["decode", path.to_str().unwrap()]);
    let lines: Vec<_> = out.lines().collect();
    assert!(
        lines[0].starts_with("This is a Ling arm of the older generation"),
        "{out}"
    );
    assert!(
        out.contains("from the arm: joints: +90.00° +90.00° +90.00° +90.00° +90.00° +90.00°"),
        "{out}"
    );
    assert!(
        out.contains("from the arm: gripper: 2051, potentiometer: 2048, sync button: 0, attitude button: 1"),
        "{out}"
    );
    assert!(!out.contains("checksum"), "{out}");
    assert_eq!(lines.last(), Some(&"bytes: 72, frames: 4, noise bytes: 2"));
    fs::remove_file(path).unwrap();
}

/// The frame of a leader arm, as pasted in a bug report.
const PASTED: &str = "AA 14 12 A9 07 A9 07 E6 0C 19 03 6D 06 92 09 2F 07 ED 04 81 08 00 FF\n";

#[test]
fn one_pasted_legacy_frame_is_named() {
    let path = free_path("older-pasted");
    for (before, after) in [("", ""), ("AA 12 07 01 03 08\n", "AA 12 07 01\n")] {
        fs::write(&path, format!("{before}{PASTED}{after}")).unwrap();
        let out = success(&["decode", path.to_str().unwrap()]);
        assert!(out.starts_with("This is a Ling arm of the older generation"), "{out}");
        assert!(out.contains("from the arm: joints: -7.65° +110.21°"), "{out}");
    }
    let current = "AA 06 00 01 FE 9A FF\n";
    fs::write(&path, format!("{PASTED}{current}")).unwrap();
    let out = success(&["decode", path.to_str().unwrap()]);
    assert!(
        out.contains("to the arm: read joints\n") && !out.contains("older"),
        "{out}"
    );
    fs::remove_file(path).unwrap();
}

#[test]
fn decode_is_told_of_a_legacy_arm() {
    let path = free_path("older-told");
    fs::write(&path, "AA 0A 03 05 04 13 00 FF\n").unwrap();
    let out = success(&["decode", "--arm", "ling-legacy", path.to_str().unwrap()]);
    assert!(
        out.ends_with("frames: 1, noise bytes: 0, frames without a message: 1\n")
            && out.contains("command 0A: unknown"),
        "{out}"
    );
    fs::remove_file(path).unwrap();
}

#[test]
fn legacy_arm_by_option_is_only_read() {
    for command in ["info", "stop"] {
        let line = failure(&run(&[command, "--arm", "ling-legacy", "/dev/no-such-port"]));
        assert!(
            line.contains("nothing is sent to an arm of the older generation"),
            "{line}"
        );
    }
    let arm = Arm::start("ling", "older-option", &["--legacy"]);
    let args = [
        "monitor",
        "--arm",
        "ling-legacy",
        &arm.port,
        "--rate",
        "100",
        "--count",
        "3",
    ];
    let output = retry_while(STOPPED, || run(&args));
    assert!(output.status.success() && output.stderr.is_empty(), "{output:?}");
    assert_eq!(
        String::from_utf8(output.stdout)
            .unwrap()
            .matches("joints: +0.00°")
            .count(),
        3
    );
}

#[test]
fn virtual_legacy_arm_has_no_current_settings() {
    for setting in [&["--leader"][..], &["--stroke", "100"], &["--echo"]] {
        let error = usage(&[&["sim", "ling", "--legacy"], setting].concat());
        assert!(error.contains("cannot be used with"), "{error}");
    }
}
