//! Commands at another robot than an Alicia-D, and at an arm whose status no document explains.

use std::process::Output;

use armwire::ling::{
    Info, JointState, Ling, MAX_FRAME, MotionStatus, Request, Response, SerialNumber, Stroke, Torque, Version,
};
use armwire::messages::Messages;
use armwire::{Device, DeviceEvent};

use crate::common::{Arm, NO_ANSWER, angles, failure, retry_while, run_against};
use crate::stop::by_the_port;

/// The answer of the vendor's two-armed robot to a request for joints.
const BESSICA: &[u8] = include_bytes!("../bessica.bin");
const NAME: &str = "not an Alicia-D but a Bessica-D";
const REFUSED: &str = "the arm is not an Alicia-D but a Bessica-D (33 data bytes), so nothing was sent";
const MOVE: &[&str] = &[
    "move",
    "PORT",
    "--joints",
    "0,0,0,0,0,0",
    "--speed",
    "20",
    "--gripper",
    "50",
];

/// An answer of an arm in this status.
fn joints(status: u8) -> Vec<u8> {
    encoded(&Response::Joints(JointState {
        joints: [2_000; 6],
        gripper: 500,
        status: MotionStatus::from(status),
    }))
}

fn encoded(response: &Response) -> Vec<u8> {
    let mut out = [0; MAX_FRAME];
    let n = Ling.encode_response(response, None, &mut out).unwrap();
    out[..n].to_vec()
}

/// Runs a program with PORT in its arguments, the port of a robot that answers a request for joints with these bytes.
/// Returns its output, and the requests that move or hold.
fn run_at(joints: &[u8], args: &[&str]) -> (Output, Vec<Request>) {
    run_at_kind(b"ADFS251205123456", joints, args)
}

/// As [`run_at`], with this serial number.
fn run_at_kind(serial: &[u8; 16], joints: &[u8], args: &[&str]) -> (Output, Vec<Request>) {
    let mut motion = Vec::new();
    let output = retry_while(NO_ANSWER, || {
        let mut robot = Device::<Ling, MAX_FRAME>::new(Ling);
        motion.clear();
        run_against(args, |_, pty, bytes| {
            assert!(robot.receive(bytes).is_empty());
            while let Some(event) = robot.poll() {
                let DeviceEvent::Request { request, .. } = event else {
                    continue;
                };
                let answer = match request {
                    Request::ReadJoints => joints.to_vec(),
                    Request::ReadStroke => encoded(&Response::Stroke(Stroke::Mm50)),
                    Request::ReadInfo => encoded(&Response::Info(Info {
                        serial: SerialNumber(*serial),
                        hardware: Version(110),
                        firmware: Version(610),
                    })),
                    Request::Move(_) | Request::SetZero | Request::SetTorque(Torque::On) => {
                        motion.push(request);
                        continue;
                    }
                    _ => continue,
                };
                pty.write(&answer).unwrap();
            }
        })
    });
    (output, motion)
}

#[test]
fn another_robot_is_sent_nothing_that_moves_or_holds() {
    for args in [
        MOVE,
        &[MOVE, &["--wait"]].concat(),
        &["set-zero", "PORT", "--yes"],
        &["torque", "PORT", "on"],
    ] {
        let (output, motion) = run_at(BESSICA, args);
        let line = failure(&output);
        assert!(line.ends_with(REFUSED), "{args:?}: {line}");
        assert_eq!(motion, []);
    }
    let (output, motion) = run_at(BESSICA, &["stop", "PORT", "--gripper", "50"]);
    let line = failure(&by_the_port(output));
    assert!(line.contains(&format!("{NAME}: its answer is 33 data bytes")), "{line}");
    assert_eq!(motion, []);
}

#[test]
fn another_robot_is_no_follower() {
    let leader = Arm::start("ling", "foreign-leader", &["--leader"]);
    let (output, motion) = run_at(BESSICA, &["teleop", &leader.port, "PORT"]);
    let line = failure(&output);
    assert!(line.ends_with(REFUSED), "{line}");
    assert_eq!(motion, []);
}

#[test]
fn another_robot_is_no_leader() {
    let follower = Arm::start("ling", "foreign-follower", &[]);
    let (output, motion) = run_at_kind(b"ADLS251205123456", BESSICA, &["teleop", "PORT", &follower.port]);
    let line = failure(&output);
    assert!(line.ends_with(REFUSED), "{line}");
    assert_eq!(motion, []);
    assert!(angles(&follower.port).iter().all(|angle| angle.abs() < 1.5), "it moves");
}

#[test]
fn another_robot_is_read() {
    let (output, _) = run_at(BESSICA, &["call", "ling", "PORT", "read-joints"]);
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(text.starts_with("joints: -171.12° "), "{text}");
    let status = format!("status: {NAME} (33 data bytes), extra: ");
    assert!(text.contains(&status), "{text}");
    let (output, _) = run_at(BESSICA, &["monitor", "PORT", "--json", "--count", "1"]);
    let text = String::from_utf8(output.stdout).unwrap();
    let row: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(row["joint_1_deg"], -171.123_047);
    assert_eq!(row["status"], format!("{NAME} (33 data bytes)"));
    // With torque off it can be moved by hand.
    let (output, motion) = run_at(BESSICA, &["torque", "PORT", "off", "--yes"]);
    assert!(output.status.success(), "{output:?}");
    assert_eq!(motion, []);
}

#[test]
fn arm_of_unknown_status_is_only_stopped() {
    let unknown = joints(0x42);
    let (output, motion) = run_at(&unknown, MOVE);
    let line = failure(&output);
    assert!(
        line.ends_with("no document explains the arm's status 0x42, so nothing was sent"),
        "{line}"
    );
    assert_eq!(motion, []);
    let leader = Arm::start("ling", "unknown-leader", &["--leader"]);
    let (output, motion) = run_at(&unknown, &["teleop", &leader.port, "PORT"]);
    assert!(failure(&output).contains("status 0x42"), "{output:?}");
    assert_eq!(motion, []);
    let (output, motion) = run_at(&unknown, &["stop", "PORT", "--gripper", "50"]);
    assert!(output.status.success(), "{output:?}");
    assert!(matches!(motion[..], [Request::Move(_), ..]), "{motion:?}");
}

#[cfg(feature = "recordings")]
#[test]
fn replay_moves_no_other_robot() {
    let recording = crate::replay::Recording::of_a_grip();
    for (joints, reason) in [
        (BESSICA, REFUSED),
        (&joints(0x42)[..], "status 0x42, so nothing was sent"),
    ] {
        let (output, motion) = run_at(joints, &["replay", recording.path(), "PORT"]);
        let line = failure(&output);
        assert!(line.ends_with(reason), "{line}");
        assert_eq!(motion, []);
    }
}

/// Its 33 bytes are not those of a pose.
#[cfg(feature = "recordings")]
#[test]
fn joints_of_another_robot_are_no_motion_to_replay() {
    let frames: Vec<_> = (0..10).map(|n| (n * 20, 1, BESSICA.to_vec())).collect();
    let recording = crate::replay::Recording::frames(&frames);
    let (output, motion) = run_at(&joints(0x01), &["replay", recording.path(), "PORT"]);
    assert!(
        failure(&output).contains("there is no pose of a Ling arm"),
        "{output:?}"
    );
    assert_eq!(motion, []);
}
