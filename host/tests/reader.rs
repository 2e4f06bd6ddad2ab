//! The newest pose through the library, against virtual arms.
#![cfg(unix)]

mod virtual_arm;

use std::net::SocketAddr;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use armwire::ling::arrival::Tolerances;
use armwire::ling::{GripperSpeed, JointState, Move, Opening, Position, Rest, Speed};
use armwire_host::{Error, Rate, Reader, Reading, Shared, Stamping, XArm};
use armwire_sim::ling::{Config, LingArm};
use armwire_sim::pty::Pty;
use armwire_sim::serve::serve;
use armwire_sim::xarm::{Config as XArmConfig, Model, Server, VirtualXArm};

use virtual_arm::{JOINTS_ANSWER, patient, with_own_arm as with_arm};

fn rate() -> Rate {
    Rate::new(200).unwrap()
}

/// The next reading after this number.
fn next<A: armwire_host::Readable>(reader: &Reader<A>, number: u64) -> Reading<A::Pose> {
    reader.next_after(number, Duration::MAX).unwrap().unwrap()
}

#[test]
fn readings_are_numbered_in_the_order_of_time() {
    with_arm(|arm, _| {
        let reader = arm.reader(rate()).unwrap();
        let mut before = next(&reader, 0);
        assert_eq!((before.number, before.stamping), (1, Stamping::Receipt));
        for number in 2..20 {
            let reading = next(&reader, before.number);
            assert_eq!(reading.number, number);
            assert!(before.time.monotonic_ns < reading.time.monotonic_ns);
            before = reading;
        }
        let latest = reader.latest_within(Duration::MAX).unwrap();
        assert!(latest.number >= before.number);
        assert!(latest.pose.joints[0].abs_diff(before.pose.joints[0]) <= Rest::TOLERANCE);
    });
}

#[test]
fn commands_go_on_while_the_pose_is_read() {
    with_arm(|arm, _| {
        let reader = arm.reader(rate()).unwrap();
        let from = next(&reader, 0).pose;
        let target = Move {
            joints: [(Position::new(2_200).unwrap(), Speed::MAX); 6],
            gripper: (Opening::OPEN, GripperSpeed(1_000)),
        };
        let is_there = |pose: &JointState| target.away(pose, &Tolerances::MOVE).is_none();
        assert!(!is_there(&from));
        patient(|| reader.arm().call(|arm| arm.move_to(&target))).unwrap();
        let mut reading = next(&reader, 1);
        while !is_there(&reading.pose) {
            reading = next(&reader, reading.number);
        }
        let wait = || {
            reader
                .arm()
                .call(|arm| arm.move_and_wait(&target, Tolerances::MOVE, Duration::from_secs(60)))
        };
        assert!(is_there(&patient(wait).unwrap()));
    });
}

#[test]
fn lost_answers_are_counted_and_end_nothing() {
    with_arm(|arm, lost| {
        let reader = arm.reader(rate()).unwrap();
        next(&reader, 0);
        lost.store(3 * JOINTS_ANSWER, Ordering::Relaxed);
        while lost.load(Ordering::Relaxed) > 0 {
            thread::yield_now();
        }
        let number = reader.counts().samples;
        next(&reader, number + 1);
        // A busy system may lose more.
        assert!(reader.counts().lost >= 3, "{:?}", reader.counts());
    });
}

#[test]
fn pose_at_a_time_is_between_readings() {
    with_arm(|arm, _| {
        let reader = arm.reader(rate()).unwrap();
        let (first, second) = (next(&reader, 0), next(&reader, 1));
        let (from, to) = (first.time.monotonic_ns, second.time.monotonic_ns);
        let middle = from + (to - from) / 2;
        match reader.at(middle) {
            Ok(reading) => {
                assert_eq!(reading.time.monotonic_ns, middle);
                let mut ends = first.pose.joints.into_iter().zip(second.pose.joints);
                let between =
                    |at: u16, (first, second): (u16, u16)| (first.min(second)..=first.max(second)).contains(&at);
                assert!(
                    reading
                        .pose
                        .joints
                        .into_iter()
                        .all(|at| between(at, ends.next().unwrap()))
                );
            }
            // A busy system may read late.
            Err(error) => assert!(error.to_string().contains("apart"), "{error}"),
        }
        let error = reader.at(from - 1).unwrap_err();
        assert!(error.to_string().contains("before the oldest pose"), "{error}");
        let error = reader.at(i64::MAX).unwrap_err();
        assert!(
            matches!(error, Error::NoPose { .. }) && error.to_string().contains("after the newest pose"),
            "{error}"
        );
    });
}

#[test]
fn reader_gives_its_arm_back() {
    with_arm(|arm, _| {
        let shared = Shared::new("arm", arm);
        let reader = Reader::start(&shared, rate()).unwrap();
        next(&reader, 0);
        let second = Reader::start(&shared, rate());
        assert!(matches!(second, Err(Error::InUse { .. })));
        let mut arm = reader.into_arm().unwrap();
        patient(|| arm.read_info()).unwrap();
        assert!(matches!(shared.call(|arm| arm.read_info()), Err(Error::Closed { .. })));
        assert_eq!(next(&arm.reader(rate()).unwrap(), 0).number, 1);
    });
}

#[test]
fn taken_arm_ends_its_reader() {
    with_arm(|arm, _| {
        let reader = arm.reader(rate()).unwrap();
        let number = next(&reader, 0).number;
        reader.arm().take().unwrap();
        let mut last = Ok(Some(number));
        while let Ok(Some(number)) = last {
            last = reader
                .next_after(number, Duration::MAX)
                .map(|next| next.map(|next| next.number));
        }
        assert!(matches!(last, Err(Error::Closed { .. })), "{last:?}");
    });
}

#[test]
fn unplugged_port_ends_the_reader_with_its_reason() {
    let pty = Pty::open(None).unwrap();
    let mut virtual_arm = LingArm::new(Config::follower());
    let stop = AtomicBool::new(false);
    let path = pty.path().to_str().unwrap().to_owned();
    let reader = thread::scope(|scope| {
        scope.spawn(|| serve(&mut virtual_arm, &pty, &stop));
        let reader = armwire_host::open(&path).unwrap().ling().unwrap().reader(rate());
        stop.store(true, Ordering::Relaxed);
        reader.unwrap()
    });
    drop(pty);
    let mut number = 0;
    let error = loop {
        match reader.next_after(number, Duration::MAX) {
            Ok(next) => number = next.unwrap().number,
            Err(error) => break error,
        }
    };
    assert!(matches!(error, Error::Lost { .. }), "{error}");
    let latest = reader.latest_within(Duration::ZERO).unwrap_err();
    assert!(matches!(latest, Error::Lost { .. }), "{latest}");
}

#[test]
fn pose_of_an_xarm_is_read() {
    let server = Server::bind(SocketAddr::from(([127, 0, 0, 1], 0)), None).unwrap();
    let host = server.control_address().to_string().parse().unwrap();
    let mut virtual_arm = VirtualXArm::new(XArmConfig::new(Model::XArm6));
    let joints = virtual_arm.joints();
    let stop = AtomicBool::new(false);
    thread::scope(|scope| {
        scope.spawn(|| server.serve(&mut virtual_arm, &stop, &mut |_| {}));
        let read = || {
            let reader = XArm::connect(&host)?.reader(rate())?;
            reader.next_after(1, Duration::MAX)
        };
        let read = read();
        stop.store(true, Ordering::Relaxed);
        let reading = read.unwrap().unwrap();
        assert_eq!(reading.number, 2);
        assert_eq!(reading.pose.joints.map(f64::from), joints);
    });
}
