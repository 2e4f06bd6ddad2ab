//! `armwire park`: an arm lies down before its torque goes off.

use std::fs;
use std::path::PathBuf;
use std::process::{Child, Command, Output};

use armwire::time::Duration;
use rustix::process::{Pid, Signal, kill_process};

use crate::common::{
    Arm, PROGRAM, angles, failure, finish, free_path, retry_while_busy, run_against, start, success, usage,
};
use crate::signals::Stepped;

/// The user's folder of configurations.
struct User(PathBuf);

impl User {
    fn new(name: &str) -> Self {
        Self(free_path(name))
    }

    fn start(&self, args: &[&str]) -> Child {
        let mut command = Command::new(PROGRAM);
        start(command.env("XDG_CONFIG_HOME", &self.0).arg("park").args(args))
    }

    fn park(&self, args: &[&str]) -> Output {
        retry_while_busy(|| finish(self.start(args)))
    }

    /// The output of a successful program.
    fn success(&self, args: &[&str]) -> String {
        let output = self.park(args);
        assert!(output.status.success() && output.stderr.is_empty(), "{output:?}");
        String::from_utf8(output.stdout).unwrap()
    }
}

impl Drop for User {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

/// Returns true if the arm's torque is on.
fn holds(arm: &Arm) -> bool {
    success(&["call", "ling", &arm.port, "read-joints"]).ends_with("status: locked\n")
}

/// Asserts that each joint is within the tolerance of this angle.
fn assert_near(arm: &Arm, pose: &[f64]) {
    let angles = angles(&arm.port);
    let mut pairs = angles.iter().zip(pose);
    assert!(pairs.all(|(angle, at)| (angle - at).abs() < 5.8), "{angles:?} {pose:?}");
}

#[test]
fn parked_arm_lies_in_its_pose_without_torque() {
    let arm = Arm::start("ling", "park", &[]);
    // The joints that have weight hang there.
    let out = User::new("park-user").success(&[&arm.port, "--pose", "20,-75,-70,0,-45,-20"]);
    assert!(
        out.starts_with("parked: joints: ") && out.contains("; torque off: "),
        "{out}"
    );
    assert!(!holds(&arm));
    assert_near(&arm, &[20.0, -75.0, -70.0, 0.0, -45.0, -20.0]);
}

#[test]
fn arm_that_does_not_arrive_keeps_its_torque() {
    let arm = Arm::start("ling", "park-away", &["--plant", "typical,obstacle=3:10deg"]);
    let line = failure(&User::new("park-away-user").park(&[&arm.port, "--pose", "0,0,30,0,0,0"]));
    assert!(line.contains(": at rest away from the target: joint 3 is "), "{line}");
    assert!(
        line.contains("; not parked, the arm holds its pose: joints: "),
        "{line}"
    );
    assert!(holds(&arm));
    assert_near(&arm, &[0.0, 0.0, 10.0, 0.0, 0.0, 0.0]);
}

#[test]
fn saved_pose_belongs_to_its_arm() {
    let user = User::new("park-save");
    let [arm, other] = [("ADFS250000000001", "park-1"), ("ADFS250000000002", "park-2")]
        .map(|(serial, name)| Arm::start("ling", name, &["--serial", serial]));
    let refused = failure(&user.park(&[&arm.port, "--save"]));
    assert!(
        refused.ends_with("only without it is shown that the arm lies"),
        "{refused}"
    );
    success(&["torque", &arm.port, "off", "--yes"]);
    let saved = user.success(&[&arm.port, "--save"]);
    let lying = angles(&arm.port);
    // The arm has sunk to where it hangs.
    let is_named = saved.starts_with("saved for ADFS250000000001: ") && saved.contains(",-7");
    assert!(is_named && lying[1] < -70.0, "{saved} {lying:?}");

    success(&["torque", &arm.port, "on"]);
    let up = [
        "--joints",
        "20,-50,-50,0,-20,-20",
        "--speed",
        "60",
        "--gripper",
        "0",
        "--wait",
    ];
    success(&[&["move", &arm.port][..], &up].concat());
    let line = failure(&user.park(&[&other.port]));
    let reason =
        "no pose is saved in which the arm ADFS250000000002 lies without torque: 'armwire park PORT --save' saves it";
    assert!(line.ends_with(reason), "{line}");
    assert!(holds(&other));
    user.success(&[&arm.port]);
    assert!(!holds(&arm));
    assert_near(&arm, &lying);
}

#[test]
fn interrupted_parking_stops_with_the_torque_on() {
    let mut stepped = Stepped::new();
    let output = retry_while_busy(|| {
        stepped = Stepped::new();
        let mut is_sent = false;
        run_against(&["park", "--pose", "170,0,0,0,0,170", "PORT"], |program, pty, bytes| {
            stepped.answer(pty, bytes);
            if !is_sent && stepped.arm.joints()[0] > 2_060 {
                is_sent = true;
                kill_process(Pid::from_child(program), Signal::INT).unwrap();
            }
        })
    });
    let line = failure(&output);
    assert!(line.starts_with("stopped: joints: "), "{line}");
    let arm = &mut stepped.arm;
    arm.advance(stepped.now + Duration::from_millis(1_000));
    assert!(arm.is_holding() && !arm.is_moving());
    assert!((2_060..3_900).contains(&arm.joints()[0]), "{:?}", arm.joints());
}

#[test]
fn parking_without_torque_is_refused() {
    let arm = Arm::start("ling", "park-limp", &[]);
    success(&["torque", &arm.port, "off", "--yes"]);
    let line = failure(&User::new("park-limp-user").park(&[&arm.port, "--pose", "0,0,0,0,0,0"]));
    assert!(line.contains("the torque is off, so nothing was sent"), "{line}");
    let text = usage(&["park", &arm.port, "--save", "--pose", "0,0,0,0,0,0"]);
    assert!(text.contains("cannot be used with"), "{text}");
}
