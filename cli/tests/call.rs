//! `armwire call ling`: each request, and what a wrong one is answered.
#![cfg(unix)]
#![forbid(unsafe_code)]

mod common;

use common::{Arm, failure, run, success, usage};

#[test]
fn each_request_of_a_ling_arm_can_be_made() {
    let arm = Arm::start("ling", "call", &["--serial", "ADFS990101000001"]);
    let call = |args: &str| {
        let args: Vec<_> = ["call", "ling", &arm.port].into_iter().chain(args.split(' ')).collect();
        success(&args)
    };
    for (args, answer) in [
        (
            "read-info",
            "serial number ADFS990101000001, hardware v1.10, firmware v6.10\n",
        ),
        ("read-stroke", "gripper stroke 50 mm\n"),
        (
            "set-stroke 75",
            "set gripper stroke 75 mm: sent, the arm does not answer it\n",
        ),
        ("read-stroke", "gripper stroke 75 mm\n"),
        (
            "read-joints",
            "joints +0.00° +0.00° +0.00° +0.00° +0.00° +0.00°, gripper 0 ‰, locked\n",
        ),
        ("set-torque off", "torque off: sent, the arm does not answer it\n"),
        ("set-torque on", "torque on: sent, the arm does not answer it\n"),
        (
            "set-temperature-limit 60",
            "set temperature limit 60 °C: sent, the arm does not answer it\n",
        ),
        ("read-velocities", "velocities 0 0 0 0 0 0 0 0 0 0 ticks/s\n"),
        ("self-check", "self-check 0b1111111111, servo 1 last, 1 = normal\n"),
        ("set-zero", "set zero position: sent, the arm does not answer it\n"),
    ] {
        assert_eq!(call(args), answer, "{args}");
    }
    assert!(call("read-temperatures").starts_with("temperatures "));
}

#[test]
fn an_arm_that_is_told_to_move_gets_there() {
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
        moved.starts_with("move -45.00° at 4551 +0.00° at 4551 +90.00° at 4551") && moved.contains("500 ‰ at 5500"),
        "{moved}"
    );
    let there = "joints -45.00° +0.00° +90.00° +0.00° +0.00° -0.09°, gripper 500 ‰, ";
    let mut out = success(&joints);
    for _ in 0..1000 {
        if out.starts_with(there) {
            return;
        }
        out = success(&joints);
    }
    panic!("it does not get there: {out}");
}

#[test]
fn what_is_out_of_range_never_leaves_the_command_line() {
    for (args, error) in [
        (
            &["move", "--joints", "0,0,0,0,0,180", "--speed", "20", "--gripper", "50"][..],
            "joint angle is 180 °, must be -180..=179.91211",
        ),
        (
            &["move", "--joints", "0,0,0,0,0,0", "--speed", "500", "--gripper", "50"],
            "joint speed is 500 °/s, must be 0..=439.45",
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
            "temperature limit is 254 °C, must be 0..=253",
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
