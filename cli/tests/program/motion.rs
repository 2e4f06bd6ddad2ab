//! `armwire move` and `armwire torque` on a virtual arm.

use crate::common::{Arm, NO_ANSWER, again_while, failure, run, success, usage};

/// The arguments of a move of the second joint.
fn to<'a>(port: &'a str, joints: &'a str, speed: &'a str) -> Vec<&'a str> {
    vec!["move", port, "--joints", joints, "--speed", speed, "--gripper", "50"]
}

#[test]
fn a_move_that_is_waited_for_is_there_at_its_end() {
    let arm = Arm::start("ling", "move-wait", &[]);
    let out = success(&[&to(&arm.port, "0,10,0,0,0,-20", "400")[..], &["--wait"]].concat());
    assert!(out.starts_with("there: joints: "), "{out}");
    let out = success(&to(&arm.port, "0,0,0,0,0,0", "400"));
    assert!(
        out.starts_with("move +0.00° at 400.0°/s ") && out.ends_with("sent, the arm does not answer it\n"),
        "{out}"
    );
}

#[test]
fn a_move_that_takes_longer_than_it_may_says_how_far_off_the_arm_is() {
    let arm = Arm::start("ling", "move-late", &[]);
    let args = [&to(&arm.port, "0,170,0,0,0,0", "1")[..], &["--wait", "--timeout", "0"]].concat();
    let line = failure(&again_while(NO_ANSWER, || run(&args)));
    assert!(line.contains(": not there after 0 s: joint 2 is 1"), "{line}");
    assert!(!line.contains("joint 1 ") && line.contains("° off (status "), "{line}");
}

#[test]
fn torque_is_switched_and_the_arm_tells_of_it() {
    let arm = Arm::start("ling", "torque", &[]);
    let off = success(&["torque", &arm.port, "off"]);
    assert!(off.starts_with("torque off: "), "{off}");
    let status = || success(&["call", "ling", &arm.port, "read-joints"]);
    assert!(status().ends_with("idle\n"), "{}", status());
    success(&["torque", &arm.port, "on"]);
    assert!(status().ends_with("locked\n"), "{}", status());
}

#[test]
fn help_says_that_the_arm_moves_and_falls() {
    assert!(success(&["move", "--help"]).contains("The arm moves at once"));
    assert!(success(&["torque", "--help"]).contains("the arm falls: hold it"));
    let text = usage(&to("/dev/no-such-port", "0,0,0,0,0,200", "10"));
    assert!(text.contains("joint angle is 200 degrees, must be"), "{text}");
    let text = usage(&[&to("/dev/no-such-port", "0,0,0,0,0,0", "10")[..], &["--timeout", "3"]].concat());
    assert!(text.contains("--wait"), "{text}");
}
