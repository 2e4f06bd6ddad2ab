//! `armwire move` and `armwire torque` on a virtual arm.

use armwire::ling::{JointState, Ling, MAX_FRAME, MotionStatus, Response};
use armwire::messages::Messages;
use armwire_sim::pty::Pty;

use crate::common::terminal::Terminal;
use crate::common::{Arm, NO_ANSWER, angles, failure, retry_while, retry_while_busy, run, run_against, success, usage};

/// The arguments of a move of the second joint.
fn to<'a>(port: &'a str, joints: &'a str, speed: &'a str) -> Vec<&'a str> {
    vec!["move", port, "--joints", joints, "--speed", speed, "--gripper", "50"]
}

#[test]
fn awaited_move_ends_at_its_target() {
    let arm = Arm::start("ling", "move-wait", &[]);
    let out = success(&[&to(&arm.port, "0,10,0,0,0,-20", "400")[..], &["--wait"]].concat());
    assert!(out.starts_with("target reached: joints: "), "{out}");
    let out = success(&to(&arm.port, "0,0,0,0,0,0", "400"));
    assert!(
        out.starts_with("sent: move +0.00° at 400.0°/s ") && out.contains("\nnow: joints: "),
        "{out}"
    );
}

#[test]
fn awaited_move_ends_with_gripper_at_target() {
    let arm = Arm::start("ling", "move-gripper", &[]);
    let joints = ["--joints", "0,0,0,0,0,0", "--speed", "400"];
    let gripper = ["--gripper", "80", "--gripper-speed", "1000", "--wait"];
    let out = success(&[&["move", &arm.port][..], &joints, &gripper].concat());
    let (_, opening) = out.split_once("gripper: ").unwrap();
    let percent: f32 = opening.split(' ').next().unwrap().parse().unwrap();
    assert!(
        out.starts_with("target reached: ") && (79.5..=80.5).contains(&percent),
        "{out}"
    );
}

#[test]
fn gripper_that_holds_something_ends_the_wait() {
    const READ_JOINTS: [u8; 7] = [0xAA, 0x06, 0x00, 0x01, 0xFE, 0x9A, 0xFF];
    let state = JointState {
        joints: [2048; 6],
        gripper: 400,
        status: MotionStatus::Locked,
    };
    let mut answer = [0; MAX_FRAME];
    let n = Ling
        .encode_response(&Response::Joints(state), None, &mut answer)
        .unwrap();
    let args = [
        "move",
        "PORT",
        "--joints",
        "0,0,0,0,0,0",
        "--speed",
        "20",
        "--gripper",
        "0",
        "--wait",
    ];
    let output = retry_while(NO_ANSWER, || {
        run_against(&args, |_, pty, request| {
            if request.ends_with(&READ_JOINTS) {
                pty.write(&answer[..n]).unwrap();
            }
        })
    });
    let out = String::from_utf8(output.stdout).unwrap();
    let expected = "joints reached; gripper is 40.0 % off and has stopped: is it holding something? joints: ";
    assert!(output.status.success() && out.starts_with(expected), "{out}");
}

#[test]
fn late_gripper_reports_the_distance_left() {
    let arm = Arm::start("ling", "gripper-late", &[]);
    let joints = ["--joints", "0,0,0,0,0,0", "--speed", "400"];
    let gripper = ["--gripper", "100", "--gripper-speed", "1", "--wait", "--timeout", "0"];
    let args = [&["move", &arm.port][..], &joints, &gripper].concat();
    let line = failure(&retry_while(NO_ANSWER, || run(&args)));
    assert!(line.contains(": target not reached after 0 s: gripper is "), "{line}");
    assert!(line.contains(" % off (status "), "{line}");
}

#[test]
fn late_move_reports_the_distance_left() {
    let arm = Arm::start("ling", "move-late", &[]);
    let args = [&to(&arm.port, "0,170,0,0,0,0", "5")[..], &["--wait", "--timeout", "0"]].concat();
    let line = failure(&retry_while(NO_ANSWER, || run(&args)));
    assert!(line.contains(": target not reached after 0 s: joint 2 is 1"), "{line}");
    assert!(
        !line.contains("joint 1 ") && line.contains("° off, gripper is "),
        "{line}"
    );
    assert!(line.ends_with("'armwire stop PORT' stops the arm"), "{line}");
}

#[test]
fn arm_at_rest_does_not_count_as_moving() {
    let arm = Arm::start("ling", "move-nowhere", &["--plant", "ideal"]);
    let pose = ["--joints", "0,0,0,0,0,0", "--gripper", "0", "--speed", "5"];
    let args = [&["move", &arm.port, "--wait", "--timeout", "0"][..], &pose].concat();
    let line = failure(&retry_while_busy(|| run(&args)));
    assert!(line.contains(": not seen at rest after 0 s (status locked)"), "{line}");
}

#[test]
fn torque_is_switched_and_read_back() {
    let arm = Arm::start("ling", "torque", &[]);
    let off = success(&["torque", &arm.port, "off", "--yes"]);
    assert_eq!(off, "torque off: the arm can be moved by hand (status idle)\n");
    let status = || success(&["call", "ling", &arm.port, "read-joints"]);
    assert!(status().ends_with("idle\n"), "{}", status());
    let on = success(&["torque", &arm.port, "on"]);
    assert_eq!(on, "torque on: the arm holds its position (status locked)\n");
    assert!(status().ends_with("locked\n"), "{}", status());
}

#[test]
fn help_warns_of_motion_and_a_falling_arm() {
    let help = |command: &str| {
        success(&[command, "--help"])
            .split_whitespace()
            .collect::<Vec<_>>()
            .join(" ")
    };
    assert!(help("move").contains("The arm moves at once"));
    assert!(help("torque").contains("the arm falls: hold it"));
    let text = usage(&to("/dev/no-such-port", "0,0,0,0,0,200", "10"));
    assert!(text.contains("joint angle is 200 degrees, must be"), "{text}");
    let text = usage(&[&to("/dev/no-such-port", "0,0,0,0,0,0", "10")[..], &["--timeout", "3"]].concat());
    assert!(text.contains("--wait"), "{text}");
}

#[test]
fn silent_port_gets_no_command() {
    let silent = Pty::open(None).unwrap();
    let port = silent.path().to_str().unwrap();
    for args in [
        &to(port, "0,0,0,0,0,0", "20")[..],
        &["torque", port, "on"],
        &["torque", port, "off", "--yes"],
        &["set-zero", port, "--yes"],
    ] {
        let output = run(args);
        assert!(
            failure(&output).contains(NO_ANSWER) && output.stdout.is_empty(),
            "{output:?}"
        );
    }
}

#[test]
fn move_without_torque_is_not_sent() {
    let arm = Arm::start("ling", "move-limp", &[]);
    success(&["torque", &arm.port, "off", "--yes"]);
    let line = failure(&retry_while(NO_ANSWER, || run(&to(&arm.port, "0,10,0,0,0,0", "400"))));
    assert!(line.contains("the torque is off, so nothing was sent"), "{line}");
    // It sinks.
    assert!(angles(&arm.port)[1] < 1.0);
}

#[test]
fn move_without_gripper_goal_keeps_the_reading() {
    let arm = Arm::start("ling", "move-reading", &[]);
    let joints = ["--joints", "0,0,0,0,0,5", "--speed", "100"];
    let opened = [&["move", &arm.port][..], &joints, &["--gripper", "30", "--wait"]].concat();
    success(&opened);
    for command in [&["move", &arm.port, "--wait"][..], &["call", "ling", &arm.port, "move"]] {
        let output = retry_while(NO_ANSWER, || run(&[command, &joints].concat()));
        let error = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.success(), "{error}");
        assert!(
            error.contains("the gripper's goal is its reading, 30.0 %: a grip may loosen"),
            "{error}"
        );
        let reading = success(&["call", "ling", &arm.port, "read-joints"]);
        assert!(reading.contains("gripper: 30.0 % open"), "{reading}");
    }
}

#[test]
fn unexecuted_command_is_reported() {
    let arm = Arm::start("ling", "overheated", &[]);
    success(&["call", "ling", &arm.port, "set-temperature-limit", "0"]);
    let line = failure(&retry_while(NO_ANSWER, || run(&["torque", &arm.port, "on"])));
    assert!(
        line.ends_with("torque on was sent, but the status is overheat protection"),
        "{line}"
    );
}

#[test]
fn set_zero_shows_the_new_joint_angles() {
    let arm = Arm::start("ling", "zero", &[]);
    success(&[&to(&arm.port, "0,10,0,0,0,0", "400")[..], &["--wait"]].concat());
    let out = success(&["set-zero", &arm.port, "--yes"]);
    assert!(
        out.starts_with("zero set: joints: ") && out.ends_with("status: idle\n"),
        "{out}"
    );
    let angles = angles(&arm.port);
    // It sinks from there.
    assert!(angles[0].abs() < 0.2 && angles[1] < 0.2, "{angles:?}");
}

#[test]
fn commands_that_release_the_arm_need_confirmation() {
    for args in [&["torque", "/dev/null", "off"][..], &["set-zero", "/dev/null"]] {
        let text = usage(args);
        assert!(text.contains("hold it.") && text.contains("--yes"), "{text}");
        // A refusal of the command is not one of its arguments.
        assert!(text.starts_with("armwire: ") && text.lines().count() == 1, "{text}");
    }
}

#[test]
fn missing_port_asks_for_no_confirmation() {
    let mut terminal = Terminal::new(80, 24);
    for args in [
        &["torque", "/dev/no-such-port", "off"][..],
        &["set-zero", "/dev/no-such-port"],
    ] {
        let child = terminal.start(args);
        let line = failure(&terminal.finish(child));
        assert!(line.starts_with("/dev/no-such-port: no such port"), "{line}");
    }
}

#[test]
fn slow_speed_is_refused() {
    for speed in ["0", "4.3", "20,20,20,20,20,0"] {
        let text = usage(&to("/dev/null", "0,0,0,0,0,0", speed));
        assert!(text.contains("degrees/s, must be 4.4..="), "{text}");
    }
    let args = [&to("/dev/null", "0,0,0,0,0,0", "20")[..], &["--gripper-speed", "0"]].concat();
    assert!(
        usage(&args).contains("'0' is not a whole number from 1 to 65535"),
        "{}",
        usage(&args)
    );
}

#[test]
fn terminal_prompts_before_the_arm_falls() {
    let arm = Arm::start("ling", "prompt", &[]);
    let args = ["torque", &arm.port, "off"];
    let mut terminal = Terminal::new(80, 24);
    let child = terminal.start(&args);
    terminal.pty.write(b"\n").unwrap();
    let output = terminal.finish(child);
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert!(
        stderr.contains("the arm falls: hold it. Continue? [y/N] ") && stderr.contains("cancelled"),
        "{stderr}"
    );
    let child = terminal.start(&args);
    terminal.pty.write(b"y\n").unwrap();
    terminal.finish(child);
    let joints = success(&["call", "ling", &arm.port, "read-joints"]);
    assert!(joints.ends_with("status: idle\n"), "{joints}");
}
