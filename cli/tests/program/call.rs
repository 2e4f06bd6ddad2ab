//! `armwire call` on serial ports: each request, its bytes, and errors of wrong ones.

use crate::common::{Arm, NO_ANSWER, angles, failure, retry_while, run, run_against, success, usage};

#[test]
fn ling_requests_can_all_be_made() {
    let arm = Arm::start("ling", "call", &["--plant", "ideal", "--serial", "ADFS990101000001"]);
    let call = |args: &str| {
        let args: Vec<_> = ["call", "ling", &arm.port].into_iter().chain(args.split(' ')).collect();
        success(&args)
    };
    for (args, answer) in [
        (
            "read-info",
            "arm: Ling follower, serial: ADFS990101000001, hardware: v1.10, firmware: v6.10\n",
        ),
        ("read-stroke", "stroke: 50 mm\n"),
        (
            "set-stroke 75",
            "set gripper stroke 75 mm: sent, the arm does not answer it\n",
        ),
        ("read-stroke", "stroke: 75 mm\n"),
        (
            "read-joints",
            "joints: +0.00° +0.00° +0.00° +0.00° +0.00° +0.00°, gripper: 0.0 % open, status: locked\n",
        ),
        ("set-torque off", "torque off: sent, the arm does not answer it\n"),
        ("set-torque on", "torque on: sent, the arm does not answer it\n"),
        (
            "set-temperature-limit 60",
            "set temperature limit 60 °C: sent, the arm does not answer it\n",
        ),
        (
            "read-velocities",
            "velocities: 0.0 0.0 0.0 0.0 0.0 0.0 0.0 0.0 0.0 0.0 °/s\n",
        ),
        ("self-check", "self-check: all 10 servos normal\n"),
        ("set-zero", "set zero position: sent, the arm does not answer it\n"),
    ] {
        assert_eq!(call(args), answer, "{args}");
    }
    assert!(call("read-temperatures").starts_with("temperatures: "));
}

#[test]
fn moved_arm_reaches_its_target() {
    let arm = Arm::start("ling", "move", &[]);
    let joints = ["call", "ling", &arm.port, "read-joints"];
    let target = "-45,0,90,0,0,-0.1";
    let args = [
        "--joints",
        target,
        "--speed",
        "400",
        "--gripper",
        "50",
        "--gripper-speed",
        "5500",
    ];
    let moved = success(&[&["call", "ling", &arm.port, "move"], &args[..]].concat());
    assert!(
        moved.starts_with("move -45.00° at 400.0°/s +0.00° at 400.0°/s +90.00° at 400.0°/s")
            && moved.contains("50.0 % at 5500 ticks/s"),
        "{moved}"
    );
    let target = [-45.0, 0.0, 90.0, 0.0, 0.0, -0.1];
    let mut at = angles(&arm.port);
    for _ in 0..1000 {
        if at.iter().zip(target).all(|(at, target)| (at - target).abs() < 1.2) {
            assert!(success(&joints).contains("gripper: 50.0 % open, "));
            return;
        }
        at = angles(&arm.port);
    }
    panic!("the arm does not arrive: {at:?}");
}

#[test]
fn out_of_range_ling_values_are_never_sent() {
    for (args, error) in [
        (
            &["move", "--joints", "0,0,0,0,0,180", "--speed", "20", "--gripper", "50"][..],
            "joint angle is 180 degrees, must be -180..=179.91",
        ),
        (
            &["move", "--joints", "0,0,0,0,0,0", "--speed", "500", "--gripper", "50"],
            "joint speed is 500 degrees/s, must be 4.4",
        ),
        (
            &["move", "--joints", "0,0,0,0,0,0", "--speed", "4", "--gripper", "50"],
            "joint speed (an arm may take less than 50 ticks/s for 0) is 4 degrees/s, must be 4.4",
        ),
        (
            &["move", "--joints", "0,0,0,0,0,0", "--speed", "20", "--gripper", "-1"],
            "gripper opening as a fraction is -1 %, must be 0..=100",
        ),
        (
            &["move", "--joints", "0,0,0,0,0", "--speed", "20", "--gripper", "1"],
            "there are 6 joints, not 5",
        ),
        (
            &["set-temperature-limit", "254"],
            "254 is not a limit: the arm takes it as a read; allowed: 0 to 253, and 255",
        ),
        (
            &["set-temperature-limit", "-1"],
            "'-1' is not a limit from 0 to 253, or 255",
        ),
        (&["set-stroke", "60"], "[possible values: 50, 75, 100]"),
        (&["move", "--joints", "0,0,0,0,0,0"], "--speed"),
    ] {
        let text = usage(&[&["call", "ling", "/dev/no-such-port"], args].concat());
        assert!(text.contains(error), "{text}");
    }
    let line = failure(&run(&["call", "ling", "/dev/no-such-port", "self-check"]));
    assert!(line.starts_with("/dev/no-such-port: no such port"), "{line}");
}

#[test]
fn leader_applies_the_mode_before_the_call_ends() {
    let arm = Arm::start("ling", "leader", &["--force-feedback=apply=300ms,blocked=2"]);
    let call = |args: &str| {
        let args: Vec<_> = ["call", "ling", &arm.port].into_iter().chain(args.split(' ')).collect();
        success(&args)
    };
    let zeros = "0.000 0.000 0.000 0.000 0.000 0.000";
    let state = |mode| {
        format!(
            "mode: {mode}, blocked: 2, valid: 1 2 3 4 5 6, residual torques: {zeros} Nm, requested currents: {zeros} A, \
             output currents: {zeros} A, measured currents: {zeros} A\n"
        )
    };
    assert_eq!(call("read-mode"), state("position"));
    call("set-torque on");
    assert_eq!(call("set-mode current"), state("current"));
    let feedback = "requested: on, effective: off, inhibit: not in teleoperation, sync: off, torque: on, requested \
                    torque: on, transition: 0, raw grip: 0, requested mode: 1\n";
    assert_eq!(call("set-force-feedback on"), feedback);
    assert_eq!(call("read-force-feedback"), feedback);
    let json = call("--json set-mode position");
    for fact in [
        "\"mode\": \"position\"",
        "\"blocked_mask\": 2",
        "\"measured_current_6_a\": 0.0",
    ] {
        assert!(json.contains(fact), "{json}");
    }
    assert!(call("read-joints").ends_with("status: idle\n"), "the torque stays off");
    assert!(call("set-force-feedback off").starts_with("requested: off, effective: off, "));
}

#[test]
fn leader_that_does_not_apply_a_mode_fails() {
    for (words, text) in [
        (
            "never",
            "set control mode current was accepted, but the mode is position after 2 s",
        ),
        (
            "refuse",
            "set control mode current: the arm answered: unsupported or not queued",
        ),
    ] {
        let arm = Arm::start("ling", "leader", &[&format!("--force-feedback={words}")]);
        let line = failure(&run(&["call", "ling", &arm.port, "set-mode", "current"]));
        assert!(line.ends_with(&format!(": {text}")), "{line}");
    }
}

#[test]
fn arm_without_force_feedback_is_named() {
    let arm = Arm::start("ling", "plain", &["--leader"]);
    let slow = "move --joints 0,0,0,0,0,0 --slow-speed 0.1 --gripper 50";
    for args in [
        "read-mode",
        "set-mode current",
        "set-force-feedback on",
        "read-force-feedback",
        slow,
    ] {
        let args: Vec<_> = ["call", "ling", &arm.port].into_iter().chain(args.split(' ')).collect();
        let line = failure(&run(&args));
        let text = ": not supported: the arm answers, but not for its control mode, so it is no force-feedback leader";
        assert!(line.ends_with(text), "{line}");
    }
}

#[test]
fn leader_with_force_feedback_moves_slowly() {
    let arm = Arm::start("ling", "slow", &["--force-feedback"]);
    success(&["call", "ling", &arm.port, "set-torque", "on"]);
    let target = ["--joints", "0.3,0,0,0,0,0", "--slow-speed", "0.2", "--gripper", "0"];
    let sent = success(&[&["call", "ling", &arm.port, "move"], &target[..]].concat());
    assert!(sent.starts_with("move +0.26° at 0.2°/s"), "{sent}");
}

/// The bytes that `armwire call alpha1` sends for a request. Expects the output for `answer`.
fn sent_to_alpha1(args: &str, answer: &[u8], printed: &str) -> Vec<u8> {
    let args: Vec<_> = ["call", "alpha1", "PORT"].into_iter().chain(args.split(' ')).collect();
    let mut sent = Vec::new();
    let output = retry_while(NO_ANSWER, || {
        run_against(&args, |_, pty, bytes| {
            sent.extend_from_slice(bytes);
            pty.write(answer).unwrap();
        })
    });
    let out = String::from_utf8(output.stdout).unwrap();
    assert_eq!(
        out,
        format!("{printed}\n"),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    sent
}

#[test]
fn each_request_of_an_alpha1_can_be_made() {
    for (args, request, answer, printed) in [
        (
            "hardware-version",
            &[0xF1, 0x1F, 0, 0, 0, 0, 0, 0, 0, 0xED][..],
            &b"\xF1\x1F\x0CAlpha1_V2.0\x68\xED"[..],
            "arm: Alpha1, hardware: Alpha1_V2.0",
        ),
        (
            "servo-states",
            &[0xEF, 0xFE, 0, 0, 0, 0, 0, 0, 0, 0xED],
            &[0xEF, 0xFE, 0, 0, 0x80, 0x05, 0x85, 0xED],
            "servos that run: 1 3 16",
        ),
        (
            "stop",
            &[0xF2, 0x2F, 0, 0, 0, 0, 0, 0, 0, 0xED],
            &[0xF2, 0x2F, 0xAA, 0xED],
            "stop: done",
        ),
        (
            "firmware-version",
            &[0xF5, 0x5F, 1, 0, 0, 0, 0, 0, 1, 0xED],
            b"\xF5\x5F\xAA2015121519\xA5\xED",
            "firmware: 2015121519",
        ),
        (
            "act --angles 90,release,0,240,0,0,0,0,0,0,0,0,0,0,0,0 --time 0.5 --interval 6",
            &[
                0xFB, 0xBF, 1, 0, 0, 0, 0, 0, 90, 0xFF, 0, 240, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0xFF, 0xFF, 0xFF,
                0xFF, 25, 1, 44, 0x8C, 0xED,
            ],
            &[0xFB, 0xBF, 1, 0xAA, 0, 0, 0, 0, 0xAB, 0xED],
            "act: done",
        ),
        (
            "offset-tool connect",
            &[0xF4, 0x4F, 1, 1, 0, 0, 0, 0, 2, 0xED],
            &[0xF4, 0x4F, 0xAA, 0xED],
            "offset tool: done",
        ),
        (
            "offset-tool disconnect",
            &[0xF4, 0x4F, 1, 0, 0, 0, 0, 0, 1, 0xED],
            &[0xF4, 0x4F, 0xAA, 0xED],
            "offset tool: done",
        ),
        (
            "usb-type vcp",
            &[0xF9, 0x9F, 2, 0, 0, 0, 0, 0, 2, 0xED],
            &[0xF9, 0x9F, 0xAA, 0xED],
            "USB type: done",
        ),
        (
            "play dance",
            b"\xF3\x3F\x06dance\x01\xED",
            &[0xF3, 0x3F, 0xAA, 0xED],
            "play: done",
        ),
        (
            "servo move 1 90 --time 1 --lock 1",
            &[0xFA, 0xAF, 1, 1, 90, 50, 0, 50, 0xC0, 0xED],
            &[0xAB],
            "servo 1: understood",
        ),
        (
            "servo release 1",
            &[0xFA, 0xAF, 1, 1, 0xFF, 0, 0, 0, 1, 0xED],
            &[0xAB],
            "servo 1: understood",
        ),
        (
            "servo led 1 1",
            &[0xFA, 0xAF, 1, 4, 1, 0, 0, 0, 6, 0xED],
            &[0xAB],
            "servo 1: understood",
        ),
        (
            "servo led all 0",
            &[0xFA, 0xAF, 0, 4, 0, 0, 0, 0, 4, 0xED],
            &[],
            "light of all servos to 0: sent, the arm does not answer it",
        ),
        (
            "servo read-angles 1",
            &[0xFA, 0xAF, 1, 2, 0, 0, 0, 0, 3, 0xED],
            &[0xFA, 0xAF, 1, 0xAA, 0, 90, 0, 91, 0x60, 0xED],
            "servo 1: released, at 91°, sent to 90°",
        ),
        (
            "servo change-id 1 2",
            &[0xFA, 0xAF, 1, 0xCD, 0, 2, 0, 0, 0xD0, 0xED],
            &[0xFA, 0xAF, 2, 0xAA, 0, 1, 0, 0, 0xAD, 0xED],
            "servo 2: was 1",
        ),
        (
            "servo set-offset 1 -30",
            &[0xFA, 0xAF, 1, 0xD2, 0, 0, 0xFF, 0xA6, 0x78, 0xED],
            &[0xFA, 0xAF, 1, 0xAA, 0, 0, 0, 0, 0xAB, 0xED],
            "servo 1: offset set",
        ),
        (
            "servo read-offset 1",
            &[0xFA, 0xAF, 1, 0xD4, 0, 0, 0, 0, 0xD5, 0xED],
            &[0xFA, 0xAF, 1, 0xAA, 0, 0, 0xFF, 0xF7, 0xA1, 0xED],
            "servo 1: offset -3.00°",
        ),
        (
            "servo version 1",
            &[0xFC, 0xCF, 1, 1, 0, 0, 0, 0, 2, 0xED],
            &[0xFC, 0xCF, 1, 0xAA, 0x41, 0x16, 0x51, 0x01, 0x54, 0xED],
            "servo 1: version 41 16 51 01",
        ),
    ] {
        let sent = sent_to_alpha1(args, answer, printed);
        assert_eq!(sent, request.repeat((sent.len() / request.len()).max(1)), "{args}");
    }
}

#[test]
fn failures_of_robot_and_servo_are_reported() {
    for (args, answer, error) in [
        (
            &["play", "x"][..],
            &[0xF3, 0x3F, 0xEE, 0xED][..],
            "the robot reported failure without a reason",
        ),
        (
            &["servo", "read-offset", "7"],
            &[0xFA, 0xAF, 7, 0xEE, 0, 0, 0, 0, 0xF5, 0xED],
            "servo 7 reported failure without a reason",
        ),
    ] {
        let args = [&["call", "alpha1", "PORT"], args].concat();
        let output = retry_while(NO_ANSWER, || {
            run_against(&args, |_, pty, _| {
                pty.write(answer).unwrap();
            })
        });
        let line = failure(&output);
        assert!(line.ends_with(error), "{line}");
    }
}

#[test]
fn out_of_range_alpha1_values_are_never_sent() {
    let name = "x".repeat(255);
    let [few, many, all] = [15, 21, 20].map(|n| vec!["90"; n].join(","));
    let [high, omitted] = ["241", "-"].map(|first| [first, &few].join(","));
    let act = |angles, time, interval| ["act", "--angles", angles, "--time", time, "--interval", interval];
    for (args, error) in [
        (&act(&high, "1", "1")[..], "servo angle is 241 degrees, must be 0..=240"),
        (
            &act(&few, "1", "1"),
            "an action has 16 or 20 targets, not 15: no document says what",
        ),
        (&act(&many, "1", "1"), "an action has 16 or 20 targets, not 21"),
        (
            &act(&omitted, "1", "1"),
            "'-' is not a whole number of degrees from 0 to 240 ('release' has no target)",
        ),
        (&act(&all, "5.2", "1"), "move time is 5.2 s, must be 0..=5.1"),
        (&act(&all, "1", "1311"), "interval is 1311 s, must be 0..=1310.7"),
        (&act(&all, "-1", "1"), "'-1' is not a valid time in seconds"),
        (&["play", &name], "text length is 255 bytes, must be 0..=254"),
        (&["servo", "version", "0"], "servo id is 0, must be 1..=240"),
        (&["servo", "change-id", "1", "241"], "servo id is 241, must be 1..=240"),
        (
            &["servo", "release", "everyone"],
            "'everyone' is not an id from 1 to 240",
        ),
        (&["servo", "version", "-1"], "'-1' is not an id from 1 to 240"),
        (&["servo", "release", "-1"], "'-1' is not an id from 1 to 240"),
        (&["servo", "led", "1", "-1"], "'-1' is not a whole number from 0 to 255"),
        (
            &["servo", "move", "1", "-5", "--time", "1", "--lock", "1"],
            "'-5' is not a whole number of degrees from 0 to 240",
        ),
        (&["servo", "version", "all"], "'all' is not an id from 1 to 240"),
        (
            &["servo", "move", "1", "300", "--time", "1", "--lock", "1"],
            "'300' is not a whole number of degrees from 0 to 240",
        ),
        (
            &["servo", "move", "1", "90", "--time", "1", "--lock", "1311"],
            "completion time is 1311 s, must be 0..=1310.7",
        ),
        (
            &["servo", "set-offset", "1", "30.33"],
            "servo offset is 30.33 degrees, must be -30..=30",
        ),
        (
            &["servo", "set-offset", "1", "-3.5"],
            "a servo's offset has steps of a third of a degree: -3.67 or -3.33, not -3.5",
        ),
        (&["servo", "set-offset", "1", "nan"], "servo offset is NaN degrees"),
        (&["usb-type", "floppy"], "[possible values: disk, vcp, hid]"),
    ] {
        let text = usage(&[&["call", "alpha1", "/dev/no-such-port"], args].concat());
        assert!(text.contains(error), "{text}");
    }
}

#[test]
fn longer_ling_answer_is_shown_with_its_rest() {
    let answer = [0xAA, 0x04, 0x0E, 0x03, 0x02, 0x07, 0x08, 0xA1, 0xFF];
    for (json, printed) in [
        (&[][..], "stroke: 100 mm, extra: 07 08\n"),
        (&["--json"], "{\n  \"stroke_mm\": 100,\n  \"extra\": \"07 08\"\n}\n"),
    ] {
        let args = [&["call", "ling", "PORT", "read-stroke"], json].concat();
        let output = retry_while(NO_ANSWER, || {
            run_against(&args, |_, pty, _| {
                pty.write(&answer).unwrap();
            })
        });
        assert_eq!(String::from_utf8_lossy(&output.stdout), printed, "{output:?}");
    }
}

#[test]
fn ling_error_frame_fails_the_call_at_once() {
    let answer = [0xAA, 0xEE, 0x00, 0x02, 0x01, 0x03, 0x36, 0xFF];
    let mut requests = Vec::new();
    let output = retry_while(NO_ANSWER, || {
        requests.clear();
        run_against(&["call", "ling", "PORT", "read-joints"], |_, pty, bytes| {
            requests.extend_from_slice(bytes);
            pty.write(&answer).unwrap();
        })
    });
    let line = failure(&output);
    assert!(
        line.ends_with("the arm answered with an error frame, which no document explains: AA EE 00 02 01 03 36 FF"),
        "{line}"
    );
    assert_eq!(requests, [0xAA, 0x06, 0x00, 0x01, 0xFE, 0x9A, 0xFF]);
}

#[test]
fn info_names_no_robot_before_it_answers() {
    let output = run_against(&["info", "--arm", "alpha1", "PORT"], |_, _, _| {});
    assert!(
        failure(&output).contains("no answer in") && output.stdout.is_empty(),
        "{output:?}"
    );
}

#[test]
fn alpha1_monitor_only_requests_servo_states() {
    let request = [0xEF, 0xFE, 0, 0, 0, 0, 0, 0, 0, 0xED];
    let args = ["monitor", "--arm", "alpha1", "PORT", "--rate", "100", "--count", "3"];
    let output = retry_while(NO_ANSWER, || {
        run_against(&args, |_, pty, bytes| {
            // The request may be repeated.
            assert!(bytes.chunks(request.len()).all(|bytes| bytes == request), "{bytes:?}");
            pty.write(&[0xEF, 0xFE, 0, 0, 0, 6, 6, 0xED]).unwrap();
        })
    });
    let out = String::from_utf8(output.stdout).unwrap();
    assert_eq!(out.lines().count(), 3);
    assert!(
        out.lines().all(|line| line.ends_with(" s  servos that run: 2 3")),
        "{out}"
    );
}

#[test]
fn error_of_unknown_request_lists_known_ones() {
    for (arm, wrong, names) in [
        ("ling", "joints", "read-info, set-zero, set-stroke"),
        ("alpha1", "dance", "hardware-version, servo-states, stop"),
        ("xarm", "turn", "version, serials, reload-dynamics"),
    ] {
        let text = usage(&["call", arm, "/dev/null", wrong]);
        let error = format!("error: '{wrong}' is unknown, expected one of: {names}, ");
        assert!(text.starts_with(&error), "{text}");
    }
    let text = usage(&["call", "ling", "/dev/null", "read-info", "joints"]);
    assert!(text.contains("unexpected argument 'joints'"), "{text}");
}

#[test]
fn answer_is_json_for_programs() {
    let arm = Arm::start("ling", "call-json", &[]);
    let json = |args: &[&str]| {
        let args = [&["call", "--json", "ling", &arm.port], args].concat();
        serde_json::from_str::<serde_json::Value>(&success(&args)).unwrap()
    };
    let joints = json(&["read-joints"]);
    assert_eq!(
        (&joints["joint_6_deg"], &joints["gripper_percent"], &joints["status"]),
        (&0.0.into(), &0.0.into(), &"locked".into())
    );
    assert_eq!(json(&["self-check"])["servo_10_is_normal"], true);
    assert_eq!(json(&["set-torque", "on"])["sent"], "torque on");
}

#[test]
fn servos_that_a_leader_lacks_are_not_faulty() {
    let arm = Arm::start("ling", "call-leader", &["--leader"]);
    let out = success(&["call", "--json", "ling", &arm.port, "self-check"]);
    let check = serde_json::from_str::<serde_json::Value>(&out).unwrap();
    assert_eq!(check["servo_6_is_normal"], true);
    assert!(check["servo_7_is_normal"].is_null(), "{check}");
}
