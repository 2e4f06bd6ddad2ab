//! The rows of readings that every program follows: `protocol/tests/effects.txt`.

use std::process::Output;
use std::thread;
use std::time::{Duration, Instant};

use armwire::ling::{JointState, Ling, MAX_FRAME, MotionStatus, Request, Response};
use armwire::messages::Messages;
use armwire::{Device, DeviceEvent};

use crate::common::{NO_ANSWER, failure, retry_while, run_against};

/// The joints of an arm with this status in hexadecimal digits, all at these ticks.
fn joints(status: &str, ticks: &str) -> JointState {
    JointState {
        joints: [ticks.parse().unwrap(); 6],
        gripper: 500,
        status: MotionStatus::from(u8::from_str_radix(status, 16).unwrap()),
    }
}

/// Runs a program against an arm whose readings change at this time after its first request that is not a read.
fn run_against_readings(args: &[&str], before: JointState, change: Duration, after: JointState) -> Output {
    let (mut arm, mut requested) = (Device::<Ling, MAX_FRAME>::new(Ling), None);
    run_against(args, |_, pty, bytes| {
        assert!(arm.receive(bytes).is_empty());
        while let Some(event) = arm.poll() {
            match event {
                DeviceEvent::Request {
                    request: Request::ReadJoints,
                    ..
                } => {
                    let has_changed = requested.is_some_and(|at: Instant| at.elapsed() >= change);
                    let response = Response::Joints(if has_changed { after } else { before });
                    let mut answer = [0; MAX_FRAME];
                    let n = Ling.encode_response(&response, None, &mut answer).unwrap();
                    pty.write(&answer[..n]).unwrap();
                }
                DeviceEvent::Request {
                    request: Request::SetTorque(_) | Request::SetZero,
                    ..
                } => _ = requested.get_or_insert_with(Instant::now),
                _ => {}
            }
        }
    })
}

const EFFECTS: &str = include_str!("../../../protocol/tests/effects.txt");

#[test]
fn rows_of_readings_have_their_verdicts() {
    let follow = |row: &str| {
        let columns: Vec<_> = row.split_whitespace().collect();
        let [effect, status, ticks, change, later_status, later_ticks, verdict] = columns[..] else {
            panic!("{row}");
        };
        let change = Duration::from_millis(change.parse().unwrap());
        let (before, after) = (joints(status, ticks), joints(later_status, later_ticks));
        let (args, confirmed): (&[&str], _) = match effect {
            "torque-on" => (
                &["torque", "PORT", "on"],
                "torque on: the arm holds its position (status ",
            ),
            "torque-off" => (
                &["torque", "PORT", "off", "--yes"],
                "torque off: the arm can be moved by hand (status ",
            ),
            _ => (&["set-zero", "PORT", "--yes"], "zero set: joints: "),
        };
        let output = retry_while(NO_ANSWER, || run_against_readings(args, before, change, after));
        let out = String::from_utf8_lossy(&output.stdout);
        match verdict {
            "confirmed" => assert!(
                output.status.success() && out.starts_with(confirmed),
                "{row}: {output:?}"
            ),
            "not-shown" => {
                let text = format!(": sent; status {} does not show its effect\n", after.status);
                assert!(output.status.success() && out.ends_with(&text), "{row}: {output:?}");
            }
            _ => assert!(failure(&output).contains(" was sent, but "), "{row}: {output:?}"),
        }
    };
    let rows: Vec<_> = EFFECTS.lines().filter(|row| !row.starts_with('#')).collect();
    thread::scope(|scope| {
        for rows in rows.chunks(5) {
            scope.spawn(move || rows.iter().for_each(|row| follow(row)));
        }
    });
}
