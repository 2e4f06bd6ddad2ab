//! `armwire bench`: measurements of a virtual arm.

use std::fs;

use armwire::ling::{Ling, MAX_FRAME, Request, Torque};
use armwire::messages::Messages;
use armwire_sim::pty::Pty;
use rustix::process::{Pid, Signal, kill_process};

use crate::common::{Arm, NO_ANSWER, angles, failure, free_path, retry_while, run, run_against, success, usage};
use crate::signals::Stepped;

/// The runs of a measurement in JSON.
fn runs(out: &str) -> Vec<serde_json::Value> {
    let report: serde_json::Value = serde_json::from_str(out).unwrap();
    assert!(report["processors"].as_u64() >= Some(1), "{report}");
    assert!(report["adapter"].is_null(), "{report}");
    report["runs"].as_array().unwrap().clone()
}

#[test]
fn reads_and_newest_poses_are_measured() {
    let arm = Arm::start("ling", "bench", &[]);
    let drawing = free_path("bench.svg");
    let svg = drawing.to_str().unwrap();
    let args = [
        "bench",
        &arm.port,
        "--rate",
        "50,200",
        "--seconds",
        "0.5",
        "--json",
        "--svg",
        svg,
    ];
    let runs = runs(&success(&args));
    let names: Vec<_> = runs
        .iter()
        .map(|run| (run["rate_hz"].clone(), run["call"].clone()))
        .collect();
    let expected = [(50, "read"), (50, "latest"), (200, "read"), (200, "latest")];
    assert_eq!(names, expected.map(|(rate, call)| (rate.into(), call.into())));
    for run in &runs {
        let calls = run["calls"].as_u64().unwrap() + run["missed"].as_u64().unwrap();
        assert_eq!(calls, run["rate_hz"].as_u64().unwrap() / 2, "{run}");
        assert!(run["p50_us"].as_f64() <= run["max_us"].as_f64(), "{run}");
        assert_eq!(run["age_p50_us"].is_null(), run["call"] == "read", "{run}");
        assert_eq!(run["load"], false);
    }
    assert!(fs::read_to_string(&drawing).unwrap().starts_with("<svg "));
    let output = run_again(&args);
    assert!(output.contains("the file exists"), "{output}");
    fs::remove_file(drawing).unwrap();
}

#[test]
fn progress_is_shown_if_so_asked() {
    let arm = Arm::start("ling", "bench-progress", &[]);
    let output = run(&["bench", &arm.port, "--rate", "50", "--seconds", "0.1", "--progress"]);
    assert!(output.status.success(), "{output:?}");
    let errors = String::from_utf8(output.stderr).unwrap();
    assert_eq!(errors, "armwire: 50 Hz, read\narmwire: 50 Hz, latest\n");
}

#[test]
fn times_and_counts_begin_at_something() {
    let arm = Arm::start("ling", "bench-zero", &[]);
    for (args, expected) in [
        (
            &["bench", &arm.port, "--seconds", "0"][..],
            "the time is 0 s, must be more",
        ),
        (&["bench", &arm.port, "--seconds", "-1"], "'-1' is not a valid time"),
        (&["bench", &arm.port, "--seconds", "1e9"], "must be at most 3600"),
        (
            &["monitor", &arm.port, "--csv", "--count", "0"],
            "'0' is not a whole number from 1 to ",
        ),
        (
            &["record", &arm.port, "never.mcap", "--count", "-1"],
            "'-1' is not a whole number from 1 to ",
        ),
    ] {
        let output = run_again(args);
        assert!(output.contains(expected), "{output}");
    }
}

#[test]
fn port_without_an_answer_is_an_error() {
    let silent = Pty::open(None).unwrap();
    let output = run_again(&[
        "bench",
        silent.path().to_str().unwrap(),
        "--rate",
        "50",
        "--seconds",
        "0.3",
    ]);
    assert!(output.contains("none of the calls was answered"), "{output}");
}

#[test]
fn drawing_that_cannot_be_written_is_refused_before_the_arm_is_asked() {
    let output = run_again(&["bench", "/dev/absent", "--svg", "/absent/calls.svg"]);
    assert_eq!(
        output,
        "armwire: /absent/calls.svg: its folder: No such file or directory (os error 2)\n"
    );
    let output = run_again(&["bench", "/dev/absent", "--svg", "/tmp"]);
    assert_eq!(output, "armwire: /tmp: the file exists: delete it, or name another\n");
}

/// The errors of the program with these arguments.
fn run_again(args: &[&str]) -> String {
    String::from_utf8(run(args).stderr).unwrap()
}

#[test]
fn holding_arm_keeps_its_pose() {
    let arm = Arm::start("ling", "bench-hold", &[]);
    success(&[
        "move",
        &arm.port,
        "--joints",
        "0,0,0,0,0,10",
        "--speed",
        "200",
        "--gripper",
        "0",
        "--wait",
    ]);
    let args = [
        "bench",
        &arm.port,
        "--rate",
        "100",
        "--seconds",
        "0.2",
        "--hold",
        "--yes",
        "--load",
    ];
    let table = success(&args);
    let rows: Vec<_> = table.lines().skip(3).collect();
    assert_eq!(rows.len(), 4, "{table}");
    assert_eq!(rows.iter().filter(|row| row.ends_with("busy")).count(), 2, "{table}");
    let state = success(&["call", "ling", &arm.port, "read-joints"]);
    let angles = angles(&arm.port);
    let near = |joint: usize, degrees: f64| (angles[joint] - degrees).abs() < 0.6;
    assert!(near(0, 0.0) && near(5, 10.0) && state.contains("locked"), "{state}");
}

#[test]
fn interrupt_ends_the_hold_by_a_stop() {
    let mut torque_on = [0; MAX_FRAME];
    let request = Request::SetTorque(Torque::On);
    let n = Ling.encode_request(&request, &mut torque_on).unwrap();
    let mut received = Vec::new();
    let output = retry_while(NO_ANSWER, || {
        let (mut stepped, mut bursts) = (Stepped::new(), 0);
        received.clear();
        let args = ["bench", "--hold", "--yes", "--rate", "50", "--seconds", "60", "PORT"];
        run_against(&args, |program, pty, bytes| {
            received.extend(bytes);
            stepped.answer(pty, bytes);
            bursts += 1;
            if bursts == 10 {
                kill_process(Pid::from_child(program), Signal::INT).unwrap();
            }
        })
    });
    assert_eq!(failure(&output), "interrupted");
    // The end of a stop.
    assert!(received.ends_with(&torque_on[..n]), "{received:02X?}");
}

#[test]
fn hold_asks_first() {
    let arm = Arm::start("ling", "bench-ask", &[]);
    let error = usage(&["bench", &arm.port, "--hold"]);
    assert!(
        error.contains("present pose as the goal") && error.contains("--yes"),
        "{error}"
    );
}

#[test]
fn rates_and_arms_without_a_pose_are_refused() {
    let arm = Arm::start("alpha1", "bench-alpha1", &[]);
    let error = usage(&["bench", &arm.port, "--arm", "alpha1"]);
    assert!(error.contains("bench measures ling and xarm"), "{error}");
    for (rate, reason) in [
        ("49", "must be 50 to 1000"),
        ("1001", "1000"),
        ("x", "not a whole number"),
    ] {
        let error = usage(&["bench", &arm.port, "--rate", rate]);
        assert!(error.contains(reason), "{error}");
    }
}
