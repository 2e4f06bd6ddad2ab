//! Stopping an arm: the library's call.

use armwire::ling::stop::{Grip, Stopped};
use armwire::ling::{GripperSpeed, JointState, Ling, Move, Opening, Position, Request, Response, Speed};
use armwire_cli::host::{Error, Link, Port, open_ling, stop};
use armwire_sim::pty::Pty;

use crate::common::Arm;

fn open(port: &str) -> Link<Ling> {
    let port: Port = port.parse().unwrap();
    open_ling(&port.connect(None).unwrap()).unwrap()
}

fn read(link: &mut Link<Ling>) -> JointState {
    loop {
        // On a busy system an answer may be late.
        if let Ok(Some(Response::Joints(state))) = link.call(&Request::ReadJoints, |response| response) {
            return state;
        }
    }
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
    let arm = Arm::start("ling", "stop-library", &[]);
    for (goal, grip) in [(Some(Opening::OPEN), Grip::Goal), (None, Grip::Reading)] {
        let mut link = open(&arm.port);
        let start = read(&mut link);
        link.call(&Request::Move(far_target()), drop).unwrap();
        while read(&mut link).joints == start.joints {}
        let Stopped::AtRest { state, grip: held } = stop(&mut link, goal).unwrap() else {
            panic!("its torque is on");
        };
        assert_eq!(held, grip);
        assert_eq!(read(&mut link).joints, state.joints, "it still moves");
        let between = start.joints[0] + 1..4_000;
        assert!(state.joints.iter().all(|ticks| between.contains(ticks)), "{state:?}");
    }
}

#[test]
fn interrupt_does_not_end_a_stop() {
    let silent = Pty::open(None).unwrap();
    let mut link = open(silent.path().to_str().unwrap());
    link.set_interrupt(|| Err("Ctrl-C".into()));
    let error = stop(&mut link, None).unwrap_err();
    assert!(
        matches!(&error, Error::NotStopped { cause, .. } if cause.contains("no answer in")),
        "{error}"
    );
    let later = link.call(&Request::ReadJoints, drop);
    assert!(matches!(later, Err(Error::Interrupted(_))), "{later:?}");
}
