//! Stopping an arm: `armwire stop`, and the library's call.

use std::process::Output;
use std::time::Instant;

use armwire::ling::arrival::Tolerances;
use armwire::ling::stop::{Grip, Stopped};
use armwire::ling::{GripperSpeed, JointState, Move, Opening, Position, Rest, Speed};
use armwire_bridge::control::Initiator;
use armwire_host::{Error, Ling, Port};
use armwire_sim::pty::Pty;
use rustix::process::{Pid, Signal, kill_process};

use crate::common::adapter::{BIT_RATE, CanBus, NODE};
use crate::common::board::Board;
use crate::common::{Arm, NO_ANSWER, TIMEOUT, failure, retry_while, retry_while_busy, run, run_against, success};
use crate::pty::with_monitor;
use crate::signals::Stepped;

/// The output without its first line on standard error: a pty may be a board's, and the stop says that it uses the arm's
/// port.
pub(crate) fn by_the_port(mut output: Output) -> Output {
    let stderr = String::from_utf8(output.stderr).unwrap();
    let (warning, rest) = stderr.split_once('\n').unwrap_or_default();
    let reason = "the system does not show which adapter has this port: its control port must be named by --control";
    assert!(
        warning.contains(reason) && warning.ends_with("; trying the arm's port"),
        "{stderr}"
    );
    output.stderr = rest.into();
    output
}

/// The output of a stop by the arm's port.
pub(crate) fn stop_by_the_port(port: &str, options: &[&str]) -> String {
    let output = retry_while_busy(|| run(&[&["stop", port], options].concat()));
    assert!(output.status.success(), "{output:?}");
    let output = by_the_port(output);
    assert!(output.stderr.is_empty(), "{output:?}");
    String::from_utf8(output.stdout).unwrap()
}

fn open(port: &str) -> Ling {
    let connection = armwire_host::open(port).unwrap();
    let deadline = Instant::now() + TIMEOUT;
    loop {
        match connection.ling() {
            // A program that another test starts shares the closed port until it runs.
            Err(Error::InUse { .. }) if Instant::now() < deadline => {}
            arm => return arm.unwrap(),
        }
    }
}

fn read(arm: &mut Ling) -> JointState {
    loop {
        // On a busy system an answer may be late.
        if let Ok(state) = arm.read_joints() {
            return state;
        }
    }
}

/// Asserts that the arm has not moved between two readings.
fn assert_at_rest(before: &JointState, after: &JointState) {
    let mut pairs = before.joints.iter().zip(after.joints);
    let is_at_rest = pairs.all(|(before, after)| before.abs_diff(after) <= Rest::TOLERANCE);
    assert!(is_at_rest, "it still moves: {before:?} {after:?}");
}

/// A move that takes half a minute.
fn far_target() -> Move {
    Move {
        joints: [(Position::new(4_000).unwrap(), Speed::new(60).unwrap()); 6],
        gripper: (Opening::OPEN, GripperSpeed(1_000)),
    }
}

#[test]
fn stopped_arm_rests_between_start_and_target() {
    let virtual_arm = Arm::start("ling", "stop-library", &[]);
    for (is_known, grip) in [(true, Grip::Goal), (false, Grip::Reading)] {
        let mut arm = open(&virtual_arm.port);
        let start = read(&mut arm);
        arm.move_to(&far_target()).unwrap();
        while read(&mut arm).joints[0] < start.joints[0] + 3 {}
        if !is_known {
            drop(arm);
            arm = open(&virtual_arm.port);
        }
        let Stopped::AtRest { state, grip: held, .. } = arm.stop(None).unwrap() else {
            panic!("its torque is on");
        };
        assert_eq!(held, grip);
        assert_at_rest(&state, &read(&mut arm));
        for (start, ticks) in start.joints.into_iter().zip(state.joints) {
            // A stop without a known goal costs one sag.
            assert!((start - 12..4_000).contains(&ticks), "{state:?}");
        }
        assert!(state.joints[0] > start.joints[0], "{state:?}");
    }
}

#[test]
fn interrupt_does_not_end_a_stop() {
    let silent = Pty::open(None).unwrap();
    let mut arm = open(silent.path().to_str().unwrap());
    arm.set_interrupt(|| Err("Ctrl-C".into()));
    let error = arm.stop(None).unwrap_err();
    assert!(
        matches!(&error, Error::NotStopped { cause, .. } if cause.to_string().contains("no answer in")),
        "{error}"
    );
    let later = arm.read_joints();
    assert!(matches!(later, Err(Error::Interrupted(_))), "{later:?}");
}

#[test]
fn interrupt_ends_an_interruptible_stop() {
    let virtual_arm = Arm::start("ling", "stop-interruptibly", &[]);
    let mut arm = open(&virtual_arm.port);
    arm.set_interrupt(|| Err("again".into()));
    let error = arm.stop_interruptibly(None).unwrap_err();
    assert!(
        matches!(&error, Error::Interrupted(reason) if reason.to_string() == "again"),
        "{error}"
    );
}

/// Starts a move that takes half a minute.
fn start_move(port: &str) {
    let target = [
        "--joints",
        "170,170,170,170,170,170",
        "--speed",
        "6",
        "--gripper",
        "100",
    ];
    success(&[&["move", port][..], &target].concat());
}

/// Starts such a move, and reads the arm until it moves.
fn start_moving(port: &str) {
    start_move(port);
    while first_joint(&joints(port)) < 1.0 {}
}

/// The joints, as `read-joints` prints them.
fn joints(port: &str) -> String {
    success(&["call", "ling", port, "read-joints"])
}

/// The first joint's angle in a printed reading.
fn first_joint(reading: &str) -> f32 {
    let (_, angles) = reading.split_once("joints: ").unwrap();
    angles.split('°').next().unwrap().parse().unwrap()
}

#[test]
fn stop_holds_the_pose_and_warns_of_the_grip() {
    let arm = Arm::start("ling", "stop", &[]);
    start_moving(&arm.port);
    let output = by_the_port(retry_while(NO_ANSWER, || run(&["stop", &arm.port])));
    let (out, error) = [output.stdout, output.stderr]
        .map(|text| String::from_utf8(text).unwrap())
        .into();
    assert!(output.status.success(), "{error}");
    let later = first_joint(&joints(&arm.port));
    assert!((first_joint(&out) - later).abs() < 0.3, "it still moves: {out} {later}");
    assert!(
        (1.0..160.0).contains(&first_joint(&out)) && out.contains("status: locked"),
        "{out}"
    );
    assert!(
        error.contains("a grip may have loosened (--gripper sets the goal)"),
        "{error}"
    );
}

#[test]
fn stop_sends_the_given_gripper_goal() {
    let arm = Arm::start("ling", "stop-gripper", &[]);
    let out = stop_by_the_port(&arm.port, &["--gripper", "2"]);
    assert!(
        out.starts_with("stopped: ") && out.contains("gripper: 2.0 % open"),
        "{out}"
    );
}

#[test]
fn arm_without_torque_is_sent_nothing() {
    let arm = Arm::start("ling", "stop-limp", &[]);
    success(&["torque", &arm.port, "off", "--yes"]);
    let out = stop_by_the_port(&arm.port, &[]);
    let start = "the torque is off, so nothing was sent: joints: ";
    assert!(out.starts_with(start) && out.ends_with("status: idle\n"), "{out}");
    let counts = arm.stop(Signal::INT);
    assert!(counts.contains(" answered, 0 refused)"), "{counts}");
}

#[test]
fn program_that_has_the_port_is_named() {
    let arm = Arm::start("ling", "stop-busy", &[]);
    let mut stop = None;
    retry_while(NO_ANSWER, || {
        with_monitor(&arm.port, |monitor| {
            stop = Some((run(&["stop", &arm.port]), monitor.id()));
            kill_process(Pid::from_child(monitor), Signal::INT).unwrap();
        })
    });
    let (output, monitor) = stop.unwrap();
    let expected = format!(
        "{}: not stopped: the port is in use by another program, armwire (process {monitor}): only Ctrl-C there, or the \
         switch of the arm's supply, stops the arm",
        arm.port
    );
    assert_eq!(failure(&by_the_port(output)), expected);
}

#[test]
fn silent_arm_counts_as_not_stopped() {
    let silent = Pty::open(None).unwrap();
    let line = failure(&by_the_port(run(&["stop", silent.path().to_str().unwrap()])));
    assert!(line.contains("not stopped: no answer in"), "{line}");
    assert!(line.ends_with("; switch the arm's supply off if it moves"), "{line}");
}

#[test]
fn reading_without_answer_is_repeated() {
    /// More than the attempts of one reading.
    const LOST: usize = 4;
    let (mut arm, mut bursts) = (Stepped::new(), 0);
    let output = run_against(&["stop", "PORT", "--gripper", "0"], |_, pty, bytes| {
        bursts += 1;
        if bursts > LOST {
            arm.answer(pty, bytes);
        }
    });
    let out = String::from_utf8(output.stdout).unwrap();
    assert!(out.starts_with("stopped: joints: ") && bursts > LOST, "{out}");
}

#[test]
fn reading_answered_by_an_error_frame_is_repeated() {
    let (mut arm, mut bursts) = (Stepped::new(), 0);
    let output = run_against(&["stop", "PORT", "--gripper", "0"], |_, pty, bytes| {
        bursts += 1;
        match bursts {
            1 => drop(pty.write(&[0xAA, 0xEE, 0x00, 0x00, 0xF7, 0xFF]).unwrap()),
            _ => arm.answer(pty, bytes),
        }
    });
    let out = String::from_utf8(output.stdout).unwrap();
    assert!(out.starts_with("stopped: joints: "), "{out}");
}

#[test]
fn robot_is_stopped_by_its_own_request() {
    const STOP: [u8; 10] = [0xF2, 0x2F, 0, 0, 0, 0, 0, 0, 0, 0xED];
    let mut sent = Vec::<u8>::new();
    let output = retry_while(NO_ANSWER, || {
        sent.clear();
        run_against(&["stop", "--arm", "alpha1", "PORT"], |_, pty, bytes| {
            sent.extend(bytes);
            pty.write(&[0xF2, 0x2F, 0xAA, 0xED]).unwrap();
        })
    });
    assert_eq!(output.stdout, b"stop: done\n");
    assert_eq!(sent, STOP);
}

#[test]
fn xarm_has_no_stop_request() {
    let line = failure(&run(&["stop", "--arm", "xarm", "192.0.2.1"]));
    assert_eq!(
        line,
        "192.0.2.1: armwire has no request that stops an xarm: press its emergency stop"
    );
}

#[test]
fn stop_ends_the_stream_at_an_adapter() {
    let board = Board::start("stop-stream");
    let timeout = ["host-timeout.after-ms=20000", "host-timeout.torque-off=on"];
    success(&[&["config", &board.control, "set"][..], &timeout].concat());
    for _ in 0..3 {
        start_move(&board.port);
    }
    let save = || run(&["config", &board.control, "save"]);
    assert!(failure(&save()).contains("refused while a host streams motion"));
    let out = stop_by_the_port(&board.port, &["--gripper", "0"]);
    assert!(out.contains("status: locked"), "{out}");
    assert!(save().status.success());
}

#[test]
fn adapter_stops_the_arm_while_its_port_is_in_use() {
    let board = Board::start("stop-adapter");
    start_moving(&board.port);
    let mut stop = None;
    retry_while(NO_ANSWER, || {
        with_monitor(&board.port, |monitor| {
            stop = Some(success(&["stop", &board.port, "--control", &board.control]));
            kill_process(Pid::from_child(monitor), Signal::INT).unwrap();
        })
    });
    let expected = "the adapter holds the arm unless its torque is off, and refuses the motion of every host for 2 s\n";
    assert_eq!(stop.unwrap(), expected);
    let pose = joints(&board.port);
    assert!(
        (1.0..160.0).contains(&first_joint(&pose)) && pose.ends_with("status: locked\n"),
        "{pose}"
    );
    let later = first_joint(&joints(&board.port));
    assert!(
        (later - first_joint(&pose)).abs() < 0.3,
        "it still moves: {later} {pose}"
    );
}

#[test]
fn stop_by_the_adapter_ends_a_wait_with_its_reason() {
    let board = Board::start("stop-wait");
    let control: Port = board.control.parse().unwrap();
    let connection = armwire_host::open(&board.port).unwrap();
    let mut arm = connection.with_control(Some(control)).ling().unwrap();
    let start = read(&mut arm);
    let (control, mut checks) = (board.control.clone(), 0);
    // Each reading checks the interrupt.
    arm.set_interrupt(move || {
        checks += 1;
        if checks == 100 {
            armwire_host::open(&control)?.adapter()?.stop()?;
        }
        Ok(())
    });
    let error = arm.move_and_wait(&far_target(), Tolerances::MOVE, TIMEOUT).unwrap_err();
    let is_stop = matches!(&error, Error::MotionRefused { stop, .. } if stop.by == Initiator::Usb && stop.left_ms > 0);
    assert!(is_stop, "{error}");
    let Stopped::AtRest { state, .. } = arm.stop(None).unwrap() else {
        panic!("its torque is on");
    };
    assert!((start.joints[0] + 1..3_990).contains(&state.joints[0]), "{state}");
}

#[test]
fn control_port_alone_is_enough() {
    let board = Board::start("stop-control");
    assert!(success(&["stop", &board.control]).starts_with("the adapter holds the arm"));
}

#[test]
fn older_adapter_is_named_and_its_port_used() {
    let bus = CanBus::start();
    let port = format!("slcan:{}@{BIT_RATE}/{NODE}", bus.path);
    let output = retry_while(NO_ANSWER, || run(&["stop", &port]));
    let (out, error) = [output.stdout, output.stderr]
        .map(|text| String::from_utf8(text).unwrap())
        .into();
    assert!(out.starts_with("stopped: joints: "), "{out}{error}");
    let expected = "the adapter does not support this request: ";
    assert!(
        error.contains(expected) && error.contains("; trying the arm's port"),
        "{error}"
    );
}

#[test]
fn missing_control_port_leaves_the_arms_port() {
    let arm = Arm::start("ling", "stop-named", &[]);
    let output = run(&["stop", &arm.port, "--control", "/dev/no-such-port"]);
    let (out, error) = [output.stdout, output.stderr]
        .map(|text| String::from_utf8(text).unwrap())
        .into();
    assert!(out.starts_with("stopped: joints: "), "{out}{error}");
    assert!(error.contains("/dev/no-such-port: no such port"), "{error}");
}
