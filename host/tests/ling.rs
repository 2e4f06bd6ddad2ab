//! A Ling arm through the library, against a virtual arm on a pseudo-terminal.
#![cfg(unix)]

mod virtual_arm;

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use armwire::ling::arrival::Tolerances;
use armwire::ling::stop::{Grip, Stopped};
use armwire::ling::{GripperSpeed, JointState, Move, Opening, Position, Request, Rest, Speed, Torque};
use armwire_host::{Error, Ling, Remedy, Stream, Tap};

use virtual_arm::{JOINTS_ANSWER, patient, with_own_arm};

/// Makes an arm lose all answers after this number of received bytes.
struct Break {
    after: usize,
    lost: Arc<AtomicUsize>,
}

impl Tap for Break {
    fn sent(&mut self, _: &[u8]) {}

    fn received(&mut self, bytes: &[u8]) {
        self.after = self.after.saturating_sub(bytes.len());
        if self.after == 0 {
            self.lost.store(usize::MAX, Ordering::Relaxed);
        }
    }
}

/// Runs `test` with an arm.
fn with_arm(test: impl FnOnce(&mut Ling) + Send) {
    with_losing_arm(|arm, _| test(arm));
}

/// Runs `test` with an arm, and the number of bytes that its answers lose.
fn with_losing_arm(test: impl FnOnce(&mut Ling, &Arc<AtomicUsize>) + Send) {
    with_own_arm(|mut arm, lost| test(&mut arm, lost));
}

/// A move that takes half a minute.
fn far_target() -> Move {
    Move {
        joints: [(Position::new(4_000).unwrap(), Speed::new(60).unwrap()); 6],
        gripper: (Opening::OPEN, GripperSpeed(1_000)),
    }
}

#[test]
fn move_without_torque_is_refused_and_moves_nothing() {
    with_arm(|arm| {
        arm.set_torque(Torque::Off).unwrap();
        let before = patient(|| arm.read_joints()).unwrap();
        let error = patient(|| arm.move_to(&far_target())).unwrap_err();
        assert!(matches!(error, Error::TorqueOff { .. }), "{error}");
        assert_eq!(error.remedy(), Some(Remedy::TorqueOn));
        arm.set_torque(Torque::On).unwrap();
        let after = patient(|| arm.read_joints()).unwrap();
        // It sinks.
        assert!(after.joints[0].abs_diff(before.joints[0]) <= Rest::TOLERANCE, "{after}");
    });
}

#[test]
fn move_slower_than_the_arm_knows_is_refused() {
    let slow = |speed| Move {
        joints: [(Position::CENTRE, Speed::new(speed).unwrap()); 6],
        ..far_target()
    };
    let text = "joint speed (an arm may take less than 50 ticks/s for 0) is 49 ticks/s, must be 50..=5000";
    with_own_arm(|mut arm, _| {
        patient(|| arm.read_joints()).unwrap();
        let error = arm.move_to(&slow(49)).unwrap_err();
        assert_eq!(error.to_string(), format!("{}: {text}", arm.name()));
        assert!(!arm.has_moved(), "it was sent");
        patient(|| arm.move_to(&slow(50))).unwrap();
        let mut stream = arm.into_stream();
        let error = stream.move_to(&slow(49)).unwrap_err();
        assert!(error.to_string().ends_with(text), "{error}");
    });
}

#[cfg(target_os = "linux")]
#[test]
fn second_opening_in_one_process_is_in_use_by_it() {
    with_arm(|arm| {
        let second = armwire_host::open(arm.name()).unwrap().ling();
        let error = second.unwrap_err();
        assert!(
            matches!(&error, Error::InUse { user, .. } if user.as_str() == "this process"),
            "{error}"
        );
    });
}

#[test]
fn torque_off_by_the_link_refuses_a_move() {
    with_arm(|arm| {
        patient(|| arm.read_joints()).unwrap();
        arm.link().send(&Request::SetTorque(Torque::Off)).unwrap();
        let error = patient(|| arm.move_to(&far_target())).unwrap_err();
        assert!(matches!(error, Error::TorqueOff { .. }), "{error}");
    });
}

#[test]
fn unreached_target_is_an_error_with_the_pose() {
    with_arm(|arm| {
        let error = patient(|| arm.move_and_wait(&far_target(), Tolerances::MOVE, Duration::ZERO)).unwrap_err();
        let Error::NotReached { state, .. } = &error else {
            panic!("{error}");
        };
        assert!(state.joints[0] < 4_000);
        assert_eq!(error.remedy(), Some(Remedy::Stop));
    });
}

#[test]
fn lost_answers_do_not_end_a_wait() {
    with_losing_arm(|arm, lost| {
        let pose = patient(|| arm.read_joints()).unwrap();
        let target = Move {
            joints: [(Position::new(2_100).unwrap(), Speed::MAX); 6],
            gripper: (pose.opening().unwrap(), GripperSpeed(1_000)),
        };
        // The answers to one reading and its repeats, and to half of the next.
        lost.store(4 * JOINTS_ANSWER + JOINTS_ANSWER / 2, Ordering::Relaxed);
        let reached = arm
            .move_and_wait(&target, Tolerances::MOVE, Duration::from_secs(60))
            .unwrap();
        assert_eq!(target.away(&reached, &Tolerances::MOVE), None);
        assert_eq!(lost.load(Ordering::Relaxed), 0);
    });
}

#[test]
fn arm_that_falls_silent_is_asked_to_stop() {
    with_losing_arm(|arm, lost| {
        // One reading before the move, and two of the motion.
        arm.link().set_tap(Break {
            after: 3 * JOINTS_ANSWER,
            lost: Arc::clone(lost),
        });
        let error = arm
            .move_and_wait(&far_target(), Tolerances::MOVE, Duration::from_secs(60))
            .unwrap_err();
        let Error::Unanswered { silence, .. } = &error else {
            panic!("{error}");
        };
        assert!(silence.last.is_some());
        assert!(silence.stopped.is_err());
        assert!(error.to_string().contains("not stopped: no answer"), "{error}");
    });
}

#[test]
fn interrupt_stops_the_arm_that_moves() {
    // Checks until Ctrl-C, some of them during the motion.
    let left = Arc::new(AtomicUsize::new(0));
    with_arm(|arm| {
        let checks = Arc::clone(&left);
        arm.set_interrupt(move || {
            match checks.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |left| left.checked_sub(1)) {
                Ok(_) => Ok(()),
                Err(_) => Err("Ctrl-C".into()),
            }
        });
        let moved = patient(|| {
            left.store(10, Ordering::Relaxed);
            arm.move_and_wait(&far_target(), Tolerances::MOVE, Duration::from_secs(60))
        });
        let Error::Stopped { stopped, reason, .. } = moved.unwrap_err() else {
            panic!("the motion is not interrupted");
        };
        assert_eq!(reason.to_string(), "Ctrl-C");
        let Stopped::AtRest { state, grip, .. } = stopped else {
            panic!("its torque is on");
        };
        assert_eq!(grip, Grip::Goal);
        arm.set_interrupt(|| Ok(()));
        let later = patient(|| arm.read_joints()).unwrap();
        let mut ways = later
            .joints
            .iter()
            .zip(state.joints)
            .map(|(later, at)| later.abs_diff(at));
        assert!(
            ways.all(|way| way <= Rest::TOLERANCE),
            "it still moves: {state} {later}"
        );
    });
}

#[test]
fn interrupt_that_reports_once_stops_the_arm() {
    // Checks until the only report, some of them during the motion.
    let left = Arc::new(AtomicUsize::new(0));
    with_arm(|arm| {
        let checks = Arc::clone(&left);
        arm.set_interrupt(move || match checks.fetch_sub(1, Ordering::Relaxed) {
            1 => Err("Ctrl-C".into()),
            _ => Ok(()),
        });
        let moved = patient(|| {
            left.store(10, Ordering::Relaxed);
            arm.move_and_wait(&far_target(), Tolerances::MOVE, Duration::from_secs(60))
        });
        let error = moved.unwrap_err();
        assert!(
            matches!(&error, Error::Stopped { reason, .. } if reason.to_string() == "Ctrl-C"),
            "{error}"
        );
    });
}

/// The next reading of a stream. A busy system may answer late.
fn next_reading(stream: &mut Stream) -> JointState {
    loop {
        let readings = stream.receive(Duration::from_millis(100)).unwrap();
        if let Some(reading) = readings.last() {
            return reading.state;
        }
    }
}

#[test]
fn lost_answer_costs_a_stream_one_reading() {
    with_own_arm(|arm, lost| {
        let mut stream = arm.into_stream();
        stream.request_joints().unwrap();
        next_reading(&mut stream);
        lost.store(JOINTS_ANSWER, Ordering::Relaxed);
        stream.request_joints().unwrap();
        // No timeout comes before the next request.
        stream.request_joints().unwrap();
        assert!(next_reading(&mut stream).joints[0].abs_diff(2_048) <= Rest::TOLERANCE);
        assert_eq!(lost.load(Ordering::Relaxed), 0);
    });
}

#[test]
fn stream_moves_no_arm_without_torque() {
    with_own_arm(|arm, _| {
        let mut stream = arm.into_stream();
        assert!(matches!(stream.move_to(&far_target()), Err(Error::At { .. })));
        stream.request_joints().unwrap();
        next_reading(&mut stream);
        stream.move_to(&far_target()).unwrap();
        let mut arm = stream.into_arm();
        assert!(arm.has_moved());
        arm.set_torque(Torque::Off).unwrap();
        let mut stream = arm.into_stream();
        stream.request_joints().unwrap();
        next_reading(&mut stream);
        assert!(matches!(stream.move_to(&far_target()), Err(Error::TorqueOff { .. })));
    });
}
