//! A port that is lost at any moment and comes back, also with another arm on it.
#![cfg(unix)]

use std::env;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::thread;
use std::time::Duration;

use armwire::decoder::{Decoder, Kind};
use armwire::ling::arrival::Tolerances;
use armwire::ling::{
    GripperSpeed, JOINTS, Ling as Protocol, MAX_FRAME, Move, Opening, Position, Request, Rest, SerialNumber, Speed,
    Torque,
};
use armwire::messages::Messages;
use armwire::time::{self, Instant};
use armwire_host::{Error, Ling, Rate, Reader, Reading, Shared};
use armwire_sim::ling::legacy::{Config as LegacyConfig, LegacyArm};
use armwire_sim::ling::{Config, LingArm};
use armwire_sim::pty::Pty;
use armwire_sim::serial::SerialDevice;
use armwire_sim::serve::serve;

/// Number of losses without `ARMWIRE_RUNS`, and of arms at a time.
const RUNS: usize = 40;
const ARMS: usize = 40;
/// The time for which an arm at rest stays there, in nanoseconds.
const REST_NS: i64 = 200_000_000;
/// The bytes of two readings, in both directions.
const BYTES: usize = 56;
/// A loss is reported within this time, and a port that is back within this time. A busy system takes longer.
const SOON: Duration = Duration::from_secs(20);

/// An arm that goes on by its own clock while its port is gone.
struct Arm {
    arm: LingArm,
    begun: std::time::Instant,
}

impl Arm {
    fn new(config: Config) -> Self {
        let begun = std::time::Instant::now();
        let arm = LingArm::new(config);
        Self { arm, begun }
    }
}

/// An arm on a port that is lost after a number of bytes of both directions.
struct Plugged<'a> {
    arm: &'a mut LingArm,
    /// The arm's time at time zero of the port.
    plugged: time::Duration,
    left: &'a AtomicUsize,
    gone: &'a AtomicBool,
    received: Vec<u8>,
}

impl Plugged<'_> {
    /// Takes a byte of the line. Returns false once it is lost.
    fn take(&self) -> bool {
        let lost = self
            .left
            .fetch_update(Ordering::Relaxed, Ordering::Relaxed, |left| left.checked_sub(1));
        if lost.is_err() {
            self.gone.store(true, Ordering::Relaxed);
        }
        lost.is_ok()
    }
}

impl SerialDevice for Plugged<'_> {
    fn receive(&mut self, now: Instant, byte: u8) {
        if self.take() {
            self.received.push(byte);
            self.arm.receive(now + self.plugged, byte);
        }
    }

    fn transmit(&mut self, now: Instant) -> Option<u8> {
        let byte = self.arm.transmit(now + self.plugged)?;
        self.take().then_some(byte)
    }

    fn poll_timeout(&self) -> Option<Instant> {
        let due = self.arm.poll_timeout()?.since(Instant::ZERO + self.plugged);
        Some(Instant::ZERO + due)
    }
}

/// Runs `test` with this arm on the port. It gets the number of bytes until the port is lost. Returns the requests that the
/// arm has received.
fn plugged<T: Send>(path: &Path, arm: &mut Arm, test: impl FnOnce(&AtomicUsize) -> T + Send) -> (T, Vec<Request>) {
    let (left, gone) = (AtomicUsize::new(usize::MAX), AtomicBool::new(false));
    let pty = Pty::open(Some(path)).unwrap();
    let mut device = Plugged {
        plugged: time::Duration::from_micros(arm.begun.elapsed().as_micros() as u64),
        arm: &mut arm.arm,
        left: &left,
        gone: &gone,
        received: Vec::new(),
    };
    let tested = thread::scope(|scope| {
        scope.spawn(|| {
            serve(&mut device, &pty, &gone).unwrap();
            drop(pty);
        });
        let tested = scope.spawn(|| test(&left)).join();
        gone.store(true, Ordering::Relaxed);
        tested
    });
    let requests = requests(&device.received);
    match tested {
        Ok(tested) => (tested, requests),
        Err(panic) => std::panic::resume_unwind(panic),
    }
}

/// The requests in these bytes.
fn requests(mut bytes: &[u8]) -> Vec<Request> {
    let mut decoder = Decoder::<Protocol, MAX_FRAME>::new();
    let mut requests = Vec::new();
    while !bytes.is_empty() {
        bytes = decoder.push(bytes);
        while let Some(item) = decoder.next(&Protocol, ()) {
            if item.kind == Kind::Frame {
                requests.extend(Protocol.parse_request(item.bytes));
            }
        }
    }
    requests
}

fn path(name: &str) -> PathBuf {
    env::temp_dir().join(format!("armwire-{name}-{}", std::process::id()))
}

fn open(path: &Path) -> Ling {
    armwire_host::open(path.to_str().unwrap()).unwrap().ling().unwrap()
}

fn pose(ticks: u16) -> Move {
    Move {
        joints: [(Position::new(ticks).unwrap(), Speed::new(200).unwrap()); JOINTS],
        gripper: (Opening::OPEN, GripperSpeed(1_000)),
    }
}

/// The result of `poll`, once it has one.
fn soon<T>(what: &str, mut poll: impl FnMut() -> Option<T>) -> T {
    let begun = std::time::Instant::now();
    loop {
        match poll() {
            Some(value) => return value,
            None => assert!(begun.elapsed() < SOON, "not within {SOON:?}: {what}"),
        }
        thread::sleep(Duration::from_millis(1));
    }
}

/// The reason of the reader's loss.
fn loss(reader: &Reader<Ling>) -> Option<String> {
    match reader.latest_within(Duration::MAX) {
        Err(Error::Lost { reason, .. }) => Some(reason.to_string()),
        _ => None,
    }
}

/// The newest reading, once there is one after this time of the monotonic clock.
fn reading_after(reader: &Reader<Ling>, monotonic_ns: i64) -> Reading<armwire::ling::JointState> {
    soon("a reading", || {
        let latest = reader.latest_within(Duration::MAX).ok();
        latest.filter(|reading| reading.time.monotonic_ns > monotonic_ns)
    })
}

fn now() -> i64 {
    armwire_host::stamps::monotonic()
}

/// The call in which the port is lost, beside the readings.
#[derive(Clone, Copy, Debug)]
enum Call {
    Move,
    Stop,
    TorqueOff,
    TorqueOn,
}

impl Call {
    const ALL: [Self; 4] = [Self::Move, Self::Stop, Self::TorqueOff, Self::TorqueOn];

    fn make(self, arm: &mut Ling) -> Result<(), Error> {
        match self {
            Self::Move => arm.move_to(&pose(2_500)),
            Self::Stop => arm.stop(None).map(drop),
            Self::TorqueOff => arm.set_torque(Torque::Off).map(drop),
            Self::TorqueOn => arm.set_torque(Torque::On).map(drop),
        }
    }
}

/// Loses the port of a moving arm in this call, after a number of bytes. It comes back with another arm first.
fn lose_and_come_back(nth: usize) {
    let path = path(&format!("lost-port-{nth}"));
    let call = Call::ALL[nth % Call::ALL.len()];
    let bytes = nth / Call::ALL.len() % BYTES;
    let (mut arm, mut other) = (
        Arm::new(Config::follower()),
        Arm::new(Config {
            serial: SerialNumber(*b"ADFS990000000001"),
            ..Config::follower()
        }),
    );
    let (reader, _) = plugged(&path, &mut arm, |left| {
        let reader = open(&path).reader(Rate::new(100).unwrap()).unwrap();
        let still = reading_after(&reader, 0).pose.joints[0];
        soon("a move", || reader.arm().call(|arm| arm.move_to(&pose(2_400))).ok());
        soon("a motion", || {
            let latest = reader.latest_within(Duration::MAX).ok()?;
            (latest.pose.joints[0] > still + 50).then_some(())
        });
        // The last byte may be one of the call, or of a reading after it.
        let _ = reader.arm().call(|arm| {
            left.store(bytes, Ordering::Relaxed);
            call.make(arm)
        });
        let reason = soon("the loss", || loss(&reader));
        let refused = reader.arm().call(|arm| arm.move_to(&pose(2_048))).unwrap_err();
        assert!(matches!(&refused, Error::Lost { .. }), "{refused} after {reason}");
        reader
    });
    let gone = now();

    let ((), requests) = plugged(&path, &mut other, |_| {
        let reason = soon("the other arm", || {
            loss(&reader).filter(|reason| reason.contains("another arm"))
        });
        assert!(
            reason.contains("ADFS990000000001, and not ADFS251205123456"),
            "{reason}"
        );
        let refused = reader.arm().call(|arm| arm.move_to(&pose(2_048))).unwrap_err();
        assert!(refused.to_string().contains(&reason), "{refused}");
        let refused = reader.arm().call(|arm| arm.stop(None)).unwrap_err();
        assert!(matches!(refused, Error::Lost { .. }), "{refused}");
    });
    assert!(!requests.is_empty());
    assert!(
        requests.iter().all(|request| *request == Request::ReadInfo),
        "{requests:?}"
    );

    let back = now();
    let ((), requests) = plugged(&path, &mut arm, |_| {
        let first = reading_after(&reader, gone);
        assert!(first.time.monotonic_ns >= back, "a reading has a time without a port");
        // Nothing goes on with the call.
        let mut from = first;
        soon("the rest of the arm", || {
            let latest = reader.latest_within(Duration::MAX).ok()?;
            let mut pairs = latest.pose.joints.into_iter().zip(from.pose.joints);
            if pairs.any(|(now, before)| now.abs_diff(before) > Rest::TOLERANCE) {
                from = latest;
            }
            (latest.time.monotonic_ns - from.time.monotonic_ns > REST_NS).then_some(())
        });
    });
    assert!(requests.iter().all(is_read), "{call:?}: {requests:?}");

    plugged(&path, &mut arm, |_| {
        reading_after(&reader, now());
        soon("the torque", || {
            reader.arm().call(|arm| arm.set_torque(Torque::On)).ok()
        });
        let target = pose(2_048);
        let arrive = |arm: &mut Ling| arm.move_and_wait(&target, Tolerances::MOVE, SOON);
        let state = soon("a move", || reader.arm().call(arrive).ok());
        assert_eq!(target.away(&state, &Tolerances::MOVE), None);
    });
}

/// True for what changes nothing.
fn is_read(request: &Request) -> bool {
    matches!(
        request,
        Request::ReadInfo
            | Request::ReadJoints
            | Request::ReadStroke
            | Request::ReadTemperatures
            | Request::ReadVelocities
    )
}

#[test]
fn port_is_lost_at_any_byte_and_comes_back() {
    let runs = env::var("ARMWIRE_RUNS").map_or(RUNS, |runs| runs.parse().unwrap());
    for first in (0..runs).step_by(ARMS) {
        thread::scope(|scope| {
            for nth in first..(first + ARMS).min(runs) {
                scope.spawn(move || lose_and_come_back(nth));
            }
        });
    }
}

#[test]
fn torque_that_came_on_meanwhile_moves_nothing() {
    let path = path("lost-port-torque");
    let mut arm = Arm::new(Config::follower());
    let (mut ling, _) = plugged(&path, &mut arm, |_| {
        let mut ling = open(&path);
        ling.read_info().unwrap();
        ling.set_torque(Torque::Off).unwrap();
        ling
    });
    let error = ling.read_joints().unwrap_err();
    assert!(matches!(error, Error::Lost { .. }), "{error}");
    // The arm was switched off and on: its torque is on.
    let mut arm = Arm::new(Config::follower());
    let (mut ling, requests) = plugged(&path, &mut arm, |_| {
        ling.reopen().unwrap();
        for _ in 0..2 {
            let refused = ling.move_to(&pose(2_400)).unwrap_err();
            assert!(matches!(refused, Error::TorqueSwitched { .. }), "{refused}");
        }
        ling
    });
    assert!(requests.iter().all(is_read), "{requests:?}");
    plugged(&path, &mut arm, |_| {
        ling.reopen().unwrap();
        // A stop is no permission.
        ling.stop(None).unwrap();
        assert!(matches!(ling.move_to(&pose(2_400)), Err(Error::TorqueSwitched { .. })));
        ling.set_torque(Torque::On).unwrap();
        let target = pose(2_400);
        let state = soon("a move", || ling.move_and_wait(&target, Tolerances::MOVE, SOON).ok());
        assert_eq!(target.away(&state, &Tolerances::MOVE), None);
    });
}

#[test]
fn unknown_arm_is_not_opened_again() {
    let path = path("lost-port-unknown");
    let mut arm = Arm::new(Config::follower());
    let (mut ling, _) = plugged(&path, &mut arm, |_| open(&path));
    let ((), requests) = plugged(&path, &mut arm, |_| {
        let error = ling.reopen().unwrap_err();
        assert!(error.to_string().contains("serial number was not read"), "{error}");
        let shared = Shared::new("arm", ling);
        assert!(matches!(shared.call(|arm| arm.read_joints()), Err(Error::Lost { .. })));
    });
    assert_eq!(requests, []);
}

#[test]
fn older_arm_on_the_port_is_another_arm() {
    let path = path("lost-port-older");
    let mut arm = Arm::new(Config::follower());
    let (reader, _) = plugged(&path, &mut arm, |_| {
        let reader = open(&path).reader(Rate::new(100).unwrap()).unwrap();
        reading_after(&reader, 0);
        reader
    });
    soon("the loss", || loss(&reader));
    let (pty, gone) = (Pty::open(Some(&path)).unwrap(), AtomicBool::new(false));
    let mut older = LegacyArm::new(LegacyConfig::default());
    thread::scope(|scope| {
        scope.spawn(|| serve(&mut older, &pty, &gone).unwrap());
        let named = scope.spawn(|| {
            soon("the older arm", || {
                loss(&reader).filter(|reason| reason.contains("another arm"))
            })
        });
        let named = named.join();
        gone.store(true, Ordering::Relaxed);
        named.unwrap();
    });
    assert_eq!(older.counters().bytes, 0);
    drop(pty);
    plugged(&path, &mut arm, |_| reading_after(&reader, now()));
}
