//! The async driver on a line in virtual time, with an arm that answers after 100 µs.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::convert::Infallible;
use std::future::{Future, poll_fn};
use std::pin::pin;
use std::task::{Context, Poll, Waker};

use armwire::correlation::Correlation;
use armwire::driver::{CallError, Clock, Counters};
use armwire::framing::{Framing, LONGEST_VOID, Reason, Scan};
use armwire::ling::*;
use armwire::messages::Messages;
use armwire::time::{Duration, Instant};
use armwire::{Config, Device, DeviceEvent, ErrorFrame, OutOfRange, SubmitError};
use embedded_io_async::{ErrorKind, ErrorType, Read, Write};
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::test_runner::TestCaseResult;

/// An instant, in microseconds.
fn at(micros: u64) -> Instant {
    Instant::from_micros(micros)
}

/// The line and the arm. A waiting future registers its deadline, and `run` advances the time to it.
struct World {
    now: Instant,
    wake: Option<Instant>,
    arm: Device<Ling, MAX_FRAME>,
    /// The complete requests received by the arm.
    requests: Vec<Request>,
    /// Bytes in flight to the host.
    replies: VecDeque<(Instant, Vec<u8>)>,
    /// Bytes that the port accepts before it stalls.
    room: usize,
    /// Maximum number of bytes per read.
    chunk: usize,
    /// Bytes that the arm sends right after each answer.
    after: Vec<u8>,
    /// Bytes that the arm sends in place of each answer.
    instead: Option<Vec<u8>>,
    /// The turnaround of the arm.
    turnaround: Duration,
    /// A byte that the port returns while the arm is silent, every 10 µs, and the end of this flood.
    flood: Option<(u8, Instant)>,
    /// The number of reads that returned bytes before each write.
    reads_before_write: Vec<usize>,
    reads: usize,
    flooded: u32,
    /// The time from a write to the end of its flush, for each byte.
    byte_time: Duration,
    flushed_at: Instant,
    /// The next writes: their delay, and the number of bytes that the port accepts.
    writes: VecDeque<(Duration, usize)>,
    /// The number of writes, and the number of those that a complete flush followed.
    written: (usize, usize),
    /// The bytes that the port accepted.
    line: Vec<u8>,
    /// The control mode of a force-feedback leader, which is applied with the third reading after it was accepted.
    mode: Option<ControlMode>,
    accepted: Option<(ControlMode, u8)>,
    /// The only request that the arm may receive, if this is checked.
    current: Option<Request>,
    /// The fates of the next answers. The others arrive after the turnaround.
    fates: VecDeque<Fate>,
}

/// The fate of an answer.
#[derive(Clone, Debug)]
enum Fate {
    /// It arrives after this time.
    Late(Duration),
    /// It arrives in two parts, the second after this time.
    InTwo(Duration, usize),
    /// One bit of it is flipped.
    Damaged(Duration, usize),
    /// These bytes precede it.
    AfterNoise(Duration, Vec<u8>),
    /// It does not arrive.
    Lost,
}

const INFO: Info = Info {
    serial: SerialNumber(*b"ADFS251205123456"),
    hardware: Version(610),
    firmware: Version(703),
};
const TEMPERATURES: PerServo<u8> = PerServo::Leader([30, 31, 32, 33, 34, 35]);
const CHECK: SelfCheck = SelfCheck(0b11_1011);

/// Returns true for a request that a client may send before another.
fn is_fence(request: &Request) -> bool {
    let is_it = |fence: &&[u8]| Ling.parse_request(fence).as_ref() == Ok(request);
    Ling::FENCES.iter().any(is_it)
}

type Shared = RefCell<World>;

fn world() -> Shared {
    RefCell::new(World {
        now: Instant::ZERO,
        wake: None,
        arm: Device::new(Ling),
        requests: Vec::new(),
        replies: VecDeque::new(),
        room: usize::MAX,
        chunk: 8,
        after: Vec::new(),
        instead: None,
        turnaround: Duration::from_micros(100),
        flood: None,
        reads_before_write: Vec::new(),
        reads: 0,
        flooded: 0,
        byte_time: Duration::ZERO,
        flushed_at: Instant::ZERO,
        writes: VecDeque::new(),
        written: (0, 0),
        line: Vec::new(),
        mode: None,
        accepted: None,
        current: None,
        fates: VecDeque::new(),
    })
}

impl World {
    fn wake_at(&mut self, at: Instant) {
        self.wake = Some(self.wake.map_or(at, |wake| wake.min(at)));
    }

    fn receive(&mut self, bytes: &[u8]) {
        self.line.extend(bytes);
        assert!(self.arm.receive(bytes).is_empty());
        while let Some(event) = self.arm.poll() {
            let request = match event {
                DeviceEvent::Request { request, .. } => request,
                // A void and what precedes it.
                DeviceEvent::Noise { .. } => continue,
                event => panic!("the arm received {event:?}"),
            };
            if let Some(current) = self.current {
                assert!(
                    request == current || is_fence(&request),
                    "the call of {request} has ended"
                );
            }
            self.requests.push(request);
            // The first answer is 2001: each one names its request.
            let number = 2000 + self.requests.len() as u16;
            let response = match request {
                Request::ReadJoints => Response::Joints(JointState {
                    joints: [number; 6],
                    gripper: 0,
                    status: MotionStatus::Idle,
                }),
                Request::ReadStroke => Response::Stroke(Stroke::Mm75),
                Request::ReadInfo => Response::Info(INFO),
                Request::ReadTemperatures => Response::Temperatures(TEMPERATURES),
                Request::ReadVelocities => Response::Velocities(PerServo::Leader([number; 6])),
                Request::SelfCheck => Response::SelfCheck(CHECK),
                request => match self.answer_of_leader(&request) {
                    Some(response) => response,
                    None => continue,
                },
            };
            let mut out = [0; MAX_FRAME];
            let n = Ling.encode_response(&response, None, &mut out).unwrap();
            let answer = self.instead.as_deref().unwrap_or(&out[..n]);
            let reply = [answer, &self.after].concat();
            self.answer(reply);
        }
    }

    fn answer_of_leader(&mut self, request: &Request) -> Option<Response> {
        let mode = self.mode.as_mut()?;
        match *request {
            Request::SetMode(requested) => {
                self.accepted = Some((requested, 3));
                let (requested, result) = (requested as u8, ModeResult::Accepted);
                Some(Response::ModeReply(ModeReply { requested, result }))
            }
            Request::ReadMode => {
                if let Some((accepted, readings)) = &mut self.accepted {
                    *readings -= 1;
                    if *readings == 0 {
                        *mode = *accepted;
                        self.accepted = None;
                    }
                }
                Some(Response::Mode(ModeState {
                    mode: *mode,
                    blocked: JointMask(0),
                    valid: JointMask(0x3F),
                    joints: [JointForce::default(); 6],
                }))
            }
            Request::SetForceFeedback(is_requested) => Some(Response::ForceFeedback(ForceFeedback {
                is_requested,
                ..ForceFeedback::default()
            })),
            Request::ReadForceFeedback => Some(Response::ForceFeedback(ForceFeedback::default())),
            _ => None,
        }
    }

    /// The arm sends an answer.
    fn answer(&mut self, mut bytes: Vec<u8>) {
        let after = |span| self.now + span;
        let replies = match self.fates.pop_front() {
            None => vec![(after(self.turnaround), bytes)],
            Some(Fate::Late(delay)) => vec![(after(delay), bytes)],
            Some(Fate::InTwo(delay, first)) => {
                let second = bytes.split_off(first.min(bytes.len() - 1));
                vec![(after(Duration::ZERO), bytes), (after(delay), second)]
            }
            Some(Fate::Damaged(delay, bit)) => {
                let place = bit / 8 % bytes.len();
                bytes[place] ^= 1 << (bit % 8);
                vec![(after(delay), bytes)]
            }
            Some(Fate::AfterNoise(delay, noise)) => vec![(after(delay), [noise, bytes].concat())],
            Some(Fate::Lost) => Vec::new(),
        };
        self.replies.extend(replies);
    }
}

struct Port<'w>(&'w Shared);

impl ErrorType for Port<'_> {
    type Error = Infallible;
}

impl Read for Port<'_> {
    async fn read(&mut self, buf: &mut [u8]) -> Result<usize, Infallible> {
        poll_fn(|_| {
            let mut world = self.0.borrow_mut();
            let (now, chunk) = (world.now, world.chunk);
            let waits = world.replies.front().is_some_and(|(at, _)| *at <= now);
            if let Some((byte, until)) = world.flood
                && !waits
                && now < until
            {
                world.now = now + Duration::from_micros(10);
                world.reads += 1;
                world.flooded += 1;
                buf[0] = byte;
                return Poll::Ready(Ok(1));
            }
            match world.replies.front_mut() {
                Some((at, bytes)) if *at <= now => {
                    let n = bytes.len().min(buf.len()).min(chunk);
                    buf[..n].copy_from_slice(&bytes[..n]);
                    bytes.drain(..n);
                    if bytes.is_empty() {
                        world.replies.pop_front();
                    }
                    world.reads += 1;
                    Poll::Ready(Ok(n))
                }
                Some(&mut (at, _)) => {
                    world.wake_at(at);
                    Poll::Pending
                }
                None => Poll::Pending,
            }
        })
        .await
    }
}

impl Write for Port<'_> {
    async fn write(&mut self, buf: &[u8]) -> Result<usize, Infallible> {
        let planned = self.0.borrow_mut().writes.pop_front();
        let (delay, most) = planned.unwrap_or((Duration::ZERO, usize::MAX));
        let begun = self.0.borrow().now;
        VirtualClock(self.0).wait_until(begun + delay).await;
        poll_fn(|_| {
            let mut world = self.0.borrow_mut();
            let n = buf.len().min(world.room).min(most);
            if n == 0 {
                return Poll::Pending;
            }
            world.room -= n;
            world.written.0 += 1;
            let wire = Duration::from_micros(world.byte_time.as_micros() * n as u64);
            world.flushed_at = world.flushed_at.max(world.now) + wire;
            let reads = std::mem::take(&mut world.reads);
            world.reads_before_write.push(reads);
            world.receive(&buf[..n]);
            Poll::Ready(Ok(n))
        })
        .await
    }

    async fn flush(&mut self) -> Result<(), Infallible> {
        let flushed_at = self.0.borrow().flushed_at;
        VirtualClock(self.0).wait_until(flushed_at).await;
        let mut world = self.0.borrow_mut();
        world.written.1 = world.written.0;
        Ok(())
    }
}

struct VirtualClock<'w>(&'w Shared);

impl Clock for VirtualClock<'_> {
    fn now(&self) -> Instant {
        self.0.borrow().now
    }

    async fn wait_until(&self, instant: Instant) {
        poll_fn(|_| {
            let mut world = self.0.borrow_mut();
            if instant <= world.now {
                return Poll::Ready(());
            }
            world.wake_at(instant);
            Poll::Pending
        })
        .await
    }
}

/// The size of the port's receive buffer, in bytes.
const BACKLOG: u32 = 256;

const CONFIG: Config = Config {
    backlog: BACKLOG,
    ..Config::DEFAULT
};

fn arm(world: &Shared) -> Arm<Port<'_>, VirtualClock<'_>> {
    Arm::new(Port(world), VirtualClock(world), CONFIG)
}

/// Runs a future for at most `limit` of virtual time; `None` if it is dropped then.
fn run_for<T>(world: &Shared, limit: Duration, future: impl Future<Output = T>) -> Option<T> {
    let mut future = pin!(future);
    let end = world.borrow().now + limit;
    loop {
        world.borrow_mut().wake = None;
        if let Poll::Ready(output) = future.as_mut().poll(&mut Context::from_waker(Waker::noop())) {
            return Some(output);
        }
        let mut world = world.borrow_mut();
        match world.wake {
            Some(at) if at <= end => world.now = at,
            _ => {
                world.now = end;
                return None;
            }
        }
    }
}

fn run<T>(world: &Shared, future: impl Future<Output = T>) -> T {
    run_for(world, Duration::from_millis(60_000), future).expect("done in a minute")
}

#[test]
fn read_returns_the_answer_without_delay() {
    let world = world();
    let state = run(&world, arm(&world).read_joints()).unwrap();
    assert_eq!(state.joints, [2001; 6]);
    assert_eq!(world.borrow().now, at(100));
}

#[test]
fn each_read_returns_its_answer() {
    let world = world();
    let mut arm = arm(&world);
    run(&world, async {
        assert_eq!(arm.read_info().await, Ok(INFO));
        assert_eq!(arm.read_temperatures().await, Ok(TEMPERATURES));
        assert_eq!(arm.read_velocities().await, Ok(PerServo::Leader([2003; 6])));
        assert_eq!(arm.read_stroke().await, Ok(Stroke::Mm75));
        assert_eq!(arm.self_check().await, Ok(CHECK));
    });
}

#[test]
fn requests_without_an_answer_return_once_written() {
    let world = world();
    let mut arm = arm(&world);
    let target = Move {
        joints: [(Position::CENTRE, Speed::MAX); JOINTS],
        gripper: (Opening::new(0).unwrap(), GripperSpeed(1000)),
    };
    let limit = TemperatureLimit::new(60).unwrap();
    run(&world, arm.set_torque(Torque::On)).unwrap();
    run(&world, arm.set_zero()).unwrap();
    run(&world, arm.set_stroke(Stroke::Mm50)).unwrap();
    run(&world, arm.set_temperature_limit(limit)).unwrap();
    run(&world, arm.move_to(target)).unwrap();
    assert_eq!(
        world.borrow().requests,
        [
            Request::SetTorque(Torque::On),
            Request::SetZero,
            Request::SetStroke(Stroke::Mm50),
            Request::SetTemperatureLimit(limit),
            Request::Move(target),
        ]
    );
    assert_eq!(world.borrow().now, Instant::ZERO);
}

#[test]
fn silence_is_an_error_with_the_attempts() {
    let world = world();
    world.borrow_mut().turnaround = Duration::from_millis(10_000);
    let error = run(&world, arm(&world).self_check()).unwrap_err();
    assert_eq!(error, CallError::TimedOut { sends: 3 });
    assert_eq!(world.borrow().requests, [Request::SelfCheck; 3]);
}

#[test]
fn mode_is_set_once_it_is_applied() {
    let world = world();
    world.borrow_mut().mode = Some(ControlMode::Position);
    let mut arm = arm(&world);
    let state = run(&world, arm.set_mode(ControlMode::Current)).unwrap();
    assert_eq!(state.mode, ControlMode::Current);
    let set = Request::SetMode(ControlMode::Current);
    let read = Request::ReadMode;
    let requests = world.borrow().requests.clone();
    assert_eq!(requests, [read, set, read, read, read]);
    assert!(run(&world, arm.set_force_feedback(true)).unwrap().is_requested);
    assert!(!run(&world, arm.read_force_feedback()).unwrap().is_requested);
}

#[test]
fn arm_that_is_no_leader_gets_no_mode() {
    let world = world();
    let mut arm = arm(&world);
    let error = run(&world, arm.set_mode(ControlMode::Current)).unwrap_err();
    assert_eq!(error, CallError::TimedOut { sends: 3 });
    assert!(run(&world, arm.set_force_feedback(true)).is_err());
    let is_read = |request: &Request| *request == Request::ReadMode || is_fence(request);
    assert!(world.borrow().requests.iter().all(is_read));
}

#[test]
fn unacceptable_answer_is_an_error_with_reason() {
    let world = world();
    let mut out = [0; MAX_FRAME];
    let frame = Frame {
        command: 0x06,
        function: 0x01,
        data: &[30; 5],
    };
    let n = frame.encode(&mut out).unwrap();
    world.borrow_mut().instead = Some(out[..n].to_vec());
    let mut arm = arm(&world);
    let error = run(&world, arm.read_temperatures()).unwrap_err();
    assert_eq!(
        error.to_string(),
        "the arm's answer cannot be accepted: command 06 function 01: 5 data bytes, expected 6 or 10"
    );
    assert_eq!(world.borrow().requests, [Request::ReadTemperatures]);
    assert_eq!(world.borrow().now, at(100));
    assert_eq!(arm.counters(), Counters::default());

    world.borrow_mut().instead = None;
    assert_eq!(run(&world, arm.read_temperatures()), Ok(TEMPERATURES));
}

#[test]
fn bytes_after_documented_fields_stay_in_the_frame() {
    let world = world();
    let mut out = [0; MAX_FRAME];
    let frame = Frame {
        command: 0x06,
        function: 0x01,
        data: &[30, 31, 32, 33, 34, 35, 0x77, 0x78],
    };
    let n = frame.encode(&mut out).unwrap();
    world.borrow_mut().instead = Some(out[..n].to_vec());
    let mut arm = arm(&world);
    assert_eq!(run(&world, arm.read_temperatures()), Ok(TEMPERATURES));
    assert_eq!(Ling.extra(arm.frame()), [0x77, 0x78]);
}

#[test]
fn error_frame_is_an_error_with_its_bytes() {
    let world = world();
    let error = [0xAA, 0xEE, 0x00, 0x02, 0x01, 0x03];
    let check = checksum(&error[1..]);
    let frame = [&error[..], &[check, TAIL]].concat();
    world.borrow_mut().instead = Some(frame.clone());
    let mut arm = arm(&world);
    let error = run(&world, arm.read_joints()).unwrap_err();
    assert_eq!(error, CallError::ErrorFrame(ErrorFrame::new(&frame)));
    assert_eq!(
        error.to_string(),
        format!("the arm sent an error frame: AA EE 00 02 01 03 {check:02X} FF")
    );
    assert_eq!(arm.frame(), frame);
    assert_eq!(world.borrow().requests, [Request::ReadJoints]);
    assert_eq!(world.borrow().now, at(100));
    assert_eq!(arm.counters(), Counters::default());
}

#[test]
fn call_dropped_before_first_byte_is_never_sent() {
    let world = world();
    let mut arm = arm(&world);
    world.borrow_mut().room = 0;
    assert!(run_for(&world, Duration::from_micros(50), arm.set_zero()).is_none());
    world.borrow_mut().room = usize::MAX;
    assert_eq!(run(&world, arm.read_stroke()), Ok(Stroke::Mm75));
    assert_eq!(world.borrow().requests, [Request::ReadStroke]);
}

#[test]
fn call_dropped_in_midframe_is_never_executed() {
    let target = Move {
        joints: [(Position::CENTRE, Speed::MAX); JOINTS],
        gripper: (Opening::new(0).unwrap(), GripperSpeed(1000)),
    };
    for room in 1..34 {
        let world = world();
        let mut arm = arm(&world);
        world.borrow_mut().room = room;
        assert!(run_for(&world, Duration::from_micros(50), arm.move_to(target)).is_none());
        rest(&world, Duration::from_millis(60_000));
        world.borrow_mut().room = usize::MAX;
        run(&world, arm.set_torque(Torque::Off)).unwrap();
        assert_eq!(
            world.borrow().requests,
            [Request::SetTorque(Torque::Off)],
            "{room} bytes"
        );
        assert_eq!(world.borrow().line.len(), room + LONGEST_VOID + 7);
    }
}

#[test]
fn dropped_void_is_completed_by_next_call() {
    let world = world();
    let mut arm = arm(&world);
    for room in [3, 100, 40] {
        world.borrow_mut().room = room;
        assert!(run_for(&world, Duration::from_micros(50), arm.set_torque(Torque::On)).is_none());
    }
    world.borrow_mut().room = usize::MAX;
    assert_eq!(run(&world, arm.read_stroke()), Ok(Stroke::Mm75));
    assert_eq!(world.borrow().requests, [Request::ReadStroke]);
    assert_eq!(world.borrow().line.len(), 3 + LONGEST_VOID + 7);
}

#[test]
fn answer_to_dropped_call_satisfies_no_other() {
    let world = world();
    let mut arm = arm(&world);
    world.borrow_mut().turnaround = Duration::from_micros(500);
    assert!(run_for(&world, Duration::from_micros(50), arm.read_joints()).is_none());
    let state = run(&world, arm.read_joints()).unwrap();
    assert_eq!(state.joints, [2003; 6], "the answer to the request behind the fence");
    let mut expected = Counters::default();
    expected.late = 1;
    assert_eq!(arm.counters(), expected);
}

/// A port that accepts these numbers of bytes, and a flush that takes 10 µs a byte.
fn slow_flush(accepted: &[usize]) -> Shared {
    let world = world();
    world.borrow_mut().byte_time = Duration::from_micros(10);
    world.borrow_mut().turnaround = Duration::from_micros(500);
    world.borrow_mut().writes = accepted.iter().map(|&n| (Duration::ZERO, n)).collect();
    world
}

#[test]
fn call_dropped_in_flush_leaves_no_stale_answer() {
    let world = slow_flush(&[]);
    let mut arm = arm(&world);
    assert!(run_for(&world, Duration::from_micros(50), arm.read_joints()).is_none());
    for expected in 2003..2007 {
        assert_eq!(run(&world, arm.read_joints()).unwrap().joints, [expected; 6]);
    }
    let requests = &world.borrow().requests;
    assert_eq!(requests[..2], [Request::ReadJoints, Request::ReadStroke]);
    assert_eq!(requests[2..], [Request::ReadJoints; 4]);
}

#[test]
fn call_dropped_in_flush_sends_no_byte_twice() {
    let world = slow_flush(&[3, 4]);
    let mut arm = arm(&world);
    assert!(run_for(&world, Duration::from_micros(50), arm.read_joints()).is_none());
    assert_eq!(run(&world, arm.read_joints()).unwrap().joints, [2003; 6]);
    let requests = [Request::ReadJoints, Request::ReadStroke, Request::ReadJoints];
    assert_eq!(world.borrow().requests, requests);
}

#[test]
fn next_call_completes_the_flush_first() {
    let world = slow_flush(&[]);
    let mut arm = arm(&world);
    assert!(run_for(&world, Duration::from_micros(50), arm.set_torque(Torque::Off)).is_none());
    assert_eq!(world.borrow().written, (1, 0));
    // The port accepts nothing more: the call gets no further than the flush.
    world.borrow_mut().room = 0;
    assert!(run_for(&world, Duration::from_micros(50), arm.read_stroke()).is_none());
    assert_eq!(world.borrow().written, (1, 1));
    world.borrow_mut().room = usize::MAX;
    assert_eq!(run(&world, arm.read_stroke()), Ok(Stroke::Mm75));
    assert_eq!(
        world.borrow().requests,
        [Request::SetTorque(Torque::Off), Request::ReadStroke]
    );
}

/// A call of a random run.
#[derive(Clone, Copy, Debug)]
struct Step {
    call: Call,
    /// The call is dropped after this number of microseconds.
    limit: Option<u64>,
    /// The time until the next call, in microseconds.
    pause: u64,
}

#[derive(Clone, Copy, Debug)]
enum Call {
    ReadJoints,
    ReadVelocities,
    /// A request without an answer.
    Set,
}

fn step() -> impl Strategy<Value = Step> {
    let call = prop_oneof![2 => Just(Call::ReadJoints), 1 => Just(Call::ReadVelocities), 1 => Just(Call::Set)];
    let limit = prop_oneof![
        3 => Just(None),
        3 => (0..150_u64).prop_map(Some),
        1 => (0..3_000_u64).prop_map(Some),
        1 => (0..300_000_u64).prop_map(Some),
    ];
    let pause = prop_oneof![Just(0), 0..500_u64, 0..200_000_u64];
    (call, limit, pause).prop_map(|(call, limit, pause)| Step { call, limit, pause })
}

/// The maximum time to an answer, from the acceptance of its request.
fn longest() -> Duration {
    let info = Ling.request(&READ_JOINTS).unwrap();
    info.response.unwrap().turnaround + CONFIG.latency + CONFIG.stale_window
}

/// A fate within the limits of the client.
fn fate() -> impl Strategy<Value = Fate> {
    let delay = || {
        let most = longest().as_micros();
        prop_oneof![3 => 50..2_000_u64, 1 => 50..most].prop_map(Duration::from_micros)
    };
    let noise = prop_oneof![
        Just(vec![0x11]),
        Just(vec![0xAA, 0x06, 0x00, 0x28]),
        vec(any::<u8>(), 1..4)
    ];
    prop_oneof![
        4 => delay().prop_map(Fate::Late),
        1 => (delay(), 1..14_usize).prop_map(|(delay, first)| Fate::InTwo(delay, first)),
        1 => (delay(), 0..8 * 14_usize).prop_map(|(delay, bit)| Fate::Damaged(delay, bit)),
        1 => (delay(), noise).prop_map(|(delay, noise)| Fate::AfterNoise(delay, noise)),
        1 => Just(Fate::Lost),
    ]
}

/// Returns true if the bytes are requests of 7 bytes, and parts of requests that a void follows.
fn is_requests_and_voids(mut line: &[u8]) -> bool {
    let void = [0; LONGEST_VOID];
    while !line.is_empty() {
        let whole = line.get(..READ_JOINTS.len());
        let is_void = |rest: &[u8]| rest.starts_with(&void) && rest.get(void.len()).is_none_or(|next| *next == 0xAA);
        let voided = || (1..READ_JOINTS.len()).find(|&part| line.get(part..).is_some_and(is_void));
        let n = match whole.filter(|bytes| Ling.scan(bytes, ()) == Scan::Frame(bytes.len())) {
            Some(request) => request.len(),
            None => match voided() {
                Some(part) if line[0] == 0xAA => part + void.len(),
                _ => return false,
            },
        };
        line = &line[n..];
    }
    true
}

/// Makes these calls. The port waits in reads, writes and flushes, and calls are dropped at all of these points.
fn check_calls(world: &Shared, steps: Vec<Step>, is_faultless: bool) -> TestCaseResult {
    let mut arm = arm(world);
    let minute = Duration::from_millis(60_000);
    let (mut celsius, mut settings) = (0..250, Vec::new());
    for step in steps {
        let limit = step.limit.map_or(minute, Duration::from_micros);
        let earlier = world.borrow().requests.len();
        let new = |answer: Result<u16, CallError<Infallible>>| match answer {
            Ok(number) => {
                // A false header and the bytes after it are a frame by chance, whose number no answer has.
                let sent = 2001..=2000 + world.borrow().requests.len();
                let number = usize::from(number);
                let is_new = number > 2000 + earlier || !is_faultless && !sent.contains(&number);
                prop_assert!(is_new, "answer {number} after {earlier} requests");
                Ok(())
            }
            Err(error) => {
                prop_assert!(!is_faultless && matches!(error, CallError::TimedOut { .. }), "{error}");
                Ok(())
            }
        };
        let ended = match step.call {
            Call::ReadJoints => {
                world.borrow_mut().current = Some(Request::ReadJoints);
                let answer = run_for(world, limit, arm.read_joints());
                answer.map(|answer| new(answer.map(|state| state.joints[0])))
            }
            Call::ReadVelocities => {
                world.borrow_mut().current = Some(Request::ReadVelocities);
                let answer = run_for(world, limit, arm.read_velocities());
                answer.map(|answer| new(answer.map(|velocities| velocities.as_slice()[0])))
            }
            Call::Set => {
                let setting = TemperatureLimit::new(celsius.next().unwrap()).unwrap();
                world.borrow_mut().current = Some(Request::SetTemperatureLimit(setting));
                let sent = run_for(world, limit, arm.set_temperature_limit(setting));
                settings.extend(sent.is_some().then_some(setting));
                sent.map(|sent| {
                    prop_assert_eq!(sent, Ok(()));
                    Ok(())
                })
            }
        };
        match ended {
            Some(result) => result?,
            None => prop_assert!(step.limit.is_some(), "it does not end"),
        }
        rest(world, Duration::from_micros(step.pause));
    }
    // A last call completes a void.
    world.borrow_mut().current = Some(Request::ReadStroke);
    world.borrow_mut().fates.clear();
    // It fails while the answer to an earlier one may still arrive.
    let answered = (0..5).any(|_| run(world, arm.read_stroke()) == Ok(Stroke::Mm75));
    prop_assert!(answered);
    let world = world.borrow();
    prop_assert!(is_requests_and_voids(&world.line), "{:02X?}", world.line);
    let sent = world.requests.iter().filter_map(|request| match request {
        Request::SetTemperatureLimit(setting) => Some(*setting),
        _ => None,
    });
    let sent: Vec<_> = sent.collect();
    prop_assert!(
        sent.is_sorted_by(|a, b| a.celsius() < b.celsius()),
        "sent twice: {sent:?}"
    );
    prop_assert!(settings.iter().all(|setting| sent.contains(setting)), "not sent");
    Ok(())
}

/// A world with a port that accepts at most these numbers of bytes, after these times.
fn port(writes: &[(u64, usize)], chunk: usize, byte_time: u64, turnaround: u64) -> Shared {
    let world = world();
    world.borrow_mut().chunk = chunk;
    world.borrow_mut().byte_time = Duration::from_micros(byte_time);
    world.borrow_mut().turnaround = Duration::from_micros(turnaround);
    world.borrow_mut().writes = writes
        .iter()
        .map(|&(delay, n)| (Duration::from_micros(delay), n))
        .collect();
    world
}

proptest! {
    #[test]
    fn dropped_calls_leave_no_stale_answer_or_byte(
        steps in vec(step(), 1..40),
        writes in vec((0..100_u64, 1..=7_usize), 0..80),
        chunk in 1..30_usize,
        byte_time in 0..20_u64,
        turnaround in 50..2_000_u64,
    ) {
        check_calls(&port(&writes, chunk, byte_time, turnaround), steps, true)?;
    }

    #[test]
    fn faults_and_drops_leave_no_stale_answer(
        steps in vec(step(), 1..40),
        writes in vec((0..100_u64, 1..=40_usize), 0..80),
        chunk in 1..30_usize,
        byte_time in 0..20_u64,
        fates in vec(fate(), 0..60),
    ) {
        let world = port(&writes, chunk, byte_time, 100);
        world.borrow_mut().fates = fates.into();
        check_calls(&world, steps, false)?;
    }
}

#[test]
fn slow_arm_gets_repeat_without_confused_answers() {
    let world = world();
    let mut arm = arm(&world);
    world.borrow_mut().turnaround = Duration::from_millis(61);
    assert_eq!(run(&world, arm.read_joints()).unwrap().joints, [2001; 6]);
    assert_eq!(
        run(&world, arm.read_joints()).unwrap().joints,
        [2006; 6],
        "after a repeat and three fences"
    );
    assert_eq!(arm.counters().late, 1);
}

/// Advances the time without reads.
fn rest(world: &Shared, span: Duration) {
    let now = world.borrow().now;
    world.borrow_mut().now = now + span;
}

#[test]
fn answer_waiting_in_port_is_not_new() {
    let world = world();
    let mut arm = arm(&world);
    // Too late for its request, and unread until long after.
    world.borrow_mut().turnaround = Duration::from_millis(61);
    assert_eq!(run(&world, arm.read_joints()).unwrap().joints, [2001; 6]);
    world.borrow_mut().turnaround = Duration::from_micros(100);
    for expected in 2004..2011 {
        rest(&world, Duration::from_millis(500));
        assert_eq!(run(&world, arm.read_joints()).unwrap().joints, [expected; 6]);
    }
    assert_eq!(arm.counters().unsolicited + arm.counters().late, 1);
}

#[test]
fn answers_after_timeout_are_never_taken_as_new() {
    let world = world();
    let mut arm = arm(&world);
    world.borrow_mut().turnaround = Duration::from_millis(1_000);
    assert!(run(&world, arm.read_joints()).is_err());
    rest(&world, Duration::from_millis(5_000));
    world.borrow_mut().turnaround = Duration::from_micros(100);
    assert_eq!(run(&world, arm.read_joints()).unwrap().joints, [2004; 6]);
}

/// A port that returns this byte for a minute while the arm is silent.
fn flooded(byte: u8) -> Shared {
    let world = world();
    world.borrow_mut().flood = Some((byte, at(60_000_000)));
    world
}

#[test]
fn constantly_readable_port_delays_no_answer() {
    let world = flooded(0x11);
    let mut arm = arm(&world);
    for expected in 2001..2010 {
        world.borrow_mut().reads = 0;
        assert_eq!(run(&world, arm.read_joints()).unwrap().joints, [expected; 6]);
    }
    assert_eq!(world.borrow().reads_before_write, [BACKLOG as usize; 9]);
    assert!(world.borrow().now < at(100_000));
    assert_eq!(arm.counters().noise_bytes, world.borrow().flooded, "no byte is lost");
}

#[test]
fn constantly_readable_port_delays_no_timeout() {
    for byte in [0x11, 0xAA] {
        let world = flooded(byte);
        world.borrow_mut().turnaround = Duration::from_millis(100_000);
        let mut arm = arm(&world);
        for sends in [3, 0, 0] {
            let begun = world.borrow().now;
            assert_eq!(run(&world, arm.read_joints()), Err(CallError::TimedOut { sends }));
            // Three times 60 to 70 ms, or 200 ms for the answers to fences.
            let took = world.borrow().now.since(begun);
            assert!(took < Duration::from_millis(220), "{took:?}");
        }
        let requests = &world.borrow().requests;
        assert_eq!(requests.iter().filter(|request| !is_fence(request)).count(), 3);
    }
}

#[test]
fn torque_off_is_sent_after_one_read() {
    let world = flooded(0x11);
    run(&world, arm(&world).set_torque(Torque::Off)).unwrap();
    assert_eq!(world.borrow().reads_before_write, [1]);
}

#[test]
fn closed_or_failed_port_is_a_named_error() {
    struct Broken(Result<usize, ErrorKind>);

    impl ErrorType for Broken {
        type Error = ErrorKind;
    }

    impl Read for Broken {
        async fn read(&mut self, _: &mut [u8]) -> Result<usize, ErrorKind> {
            self.0
        }
    }

    impl Write for Broken {
        async fn write(&mut self, _: &[u8]) -> Result<usize, ErrorKind> {
            self.0
        }

        async fn flush(&mut self) -> Result<(), ErrorKind> {
            Ok(())
        }
    }

    let world = world();
    let call = |port| {
        let mut arm = Arm::new(port, VirtualClock(&world), Config::DEFAULT);
        run(&world, arm.read_joints()).unwrap_err()
    };
    assert_eq!(call(Broken(Ok(0))), CallError::Closed);
    let error = call(Broken(Err(ErrorKind::BrokenPipe)));
    assert_eq!(error, CallError::Io(ErrorKind::BrokenPipe));
}

/// A port that loses these bytes of those that it receives, and reports an error in place of each.
struct Erring<'w> {
    port: Port<'w>,
    received: usize,
    lost: Vec<usize>,
}

impl ErrorType for Erring<'_> {
    type Error = ErrorKind;
}

impl Read for Erring<'_> {
    async fn read(&mut self, buf: &mut [u8]) -> Result<usize, ErrorKind> {
        let Ok(n) = self.port.read(&mut buf[..1]).await;
        self.received += n;
        match self.lost.contains(&self.received) {
            true => Err(ErrorKind::Other),
            false => Ok(n),
        }
    }
}

impl Write for Erring<'_> {
    async fn write(&mut self, buf: &[u8]) -> Result<usize, ErrorKind> {
        let Ok(n) = self.port.write(buf).await;
        Ok(n)
    }

    async fn flush(&mut self) -> Result<(), ErrorKind> {
        let Ok(()) = self.port.flush().await;
        Ok(())
    }
}

fn erring(world: &Shared, lost: Vec<usize>) -> Arm<Erring<'_>, VirtualClock<'_>> {
    let port = Erring {
        port: Port(world),
        received: 0,
        lost,
    };
    Arm::new(port, VirtualClock(world), CONFIG)
}

#[test]
fn receive_error_costs_one_repeat() {
    let world = world();
    let mut arm = erring(&world, vec![10]);
    // The answer to the second request.
    assert_eq!(run(&world, arm.read_joints()).unwrap().joints, [2_002; 6]);
    assert_eq!(arm.counters().receive_errors, 1);
}

#[test]
fn receive_error_at_any_byte_leaves_calls_their_answers() {
    /// The bytes of an answer.
    const LEN: usize = 21;
    for lost in 1..=2 * LEN {
        for second in lost..=lost + 2 {
            let world = world();
            let mut arm = erring(&world, vec![lost, second]);
            for _ in 0..4 {
                let state = run(&world, arm.read_joints()).unwrap();
                let newest = 2_000 + world.borrow().requests.len() as u16;
                assert_eq!(state.joints, [newest; 6], "lost: {lost}, {second}");
            }
        }
    }
}

#[test]
fn receive_error_at_any_byte_leaves_the_stop() {
    for lost in 1..=100 {
        let world = world();
        world.borrow_mut().instead = Some(standing());
        let mut arm = erring(&world, vec![lost, lost + 21]);
        let stopped = run(&world, arm.stop(&mut Stop::new(Some(Opening::CLOSED)))).unwrap();
        assert!(matches!(stopped, stop::Stopped::AtRest { .. }), "lost: {lost}");
        let moves = |request: &&Request| matches!(request, Request::Move(_));
        assert!(
            world.borrow().requests.iter().filter(moves).count() >= 5,
            "lost: {lost}"
        );
    }
}

/// The joints of an arm that holds its pose.
fn standing() -> Vec<u8> {
    let state = JointState {
        joints: [2_048; 6],
        gripper: 0,
        status: MotionStatus::Locked,
    };
    let mut out = [0; MAX_FRAME];
    let n = Ling.encode_response(&Response::Joints(state), None, &mut out).unwrap();
    out[..n].to_vec()
}

#[test]
fn port_that_only_fails_ends_the_call_with_its_error() {
    let world = world();
    let mut arm = erring(&world, (1..10_000).collect());
    assert_eq!(run(&world, arm.read_joints()), Err(CallError::Io(ErrorKind::Other)));
    assert!(world.borrow().requests.len() > 1, "it is repeated");
    let stopped = run(&world, arm.stop(&mut Stop::new(None)));
    assert_eq!(stopped, Err(CallError::Io(ErrorKind::Other)));
}

#[test]
fn failed_stop_is_an_error() {
    let world = world();
    world.borrow_mut().turnaround = Duration::from_millis(100_000);
    let mut arm = arm(&world);
    let stopped = run(&world, arm.stop(&mut Stop::new(None)));
    assert_eq!(stopped, Err(CallError::NotStopped(stop::StopError::NoReading)));
}

#[test]
fn cause_is_in_the_text_alone() {
    let count = OutOfRange::new("count", "", 9, 0, 8);
    let reason = Reason::Abandoned;
    let unacceptable = Ling.parse_response(&[], ()).unwrap_err();
    let errors: [(CallError<ErrorKind>, String); 5] = [
        (CallError::Io(ErrorKind::BrokenPipe), ErrorKind::BrokenPipe.to_string()),
        (CallError::Port(count), count.to_string()),
        (CallError::Submit(SubmitError::Busy), SubmitError::Busy.to_string()),
        (CallError::Broken { offset: 7, reason }, reason.to_string()),
        (CallError::Unacceptable(unacceptable), unacceptable.to_string()),
    ];
    for (error, cause) in errors {
        assert!(error.to_string().ends_with(&cause), "{error}");
        assert!(std::error::Error::source(&error).is_none(), "{error}");
    }
}

#[test]
fn bytes_after_an_answer_stay_for_next_call() {
    let world = world();
    let mut out = [0; MAX_FRAME];
    let n = Ling
        .encode_response(&Response::Stroke(Stroke::Mm75), None, &mut out)
        .unwrap();
    // The decoder holds a false header and has no room for a read of a whole buffer.
    world
        .borrow_mut()
        .replies
        .push_back((Instant::ZERO, vec![0xAA, 0x06, 0x00, 0x01]));
    world.borrow_mut().chunk = MAX_FRAME;
    world.borrow_mut().after = [&[0x11; MAX_FRAME - 14][..], &out[..n]].concat();
    let mut arm = arm(&world);
    assert_eq!(run(&world, arm.read_stroke()), Ok(Stroke::Mm75));
    // It remains for the next call.
    world.borrow_mut().after.clear();
    assert_eq!(run(&world, arm.read_info()), Ok(INFO));
    assert_eq!(arm.counters().unsolicited, 1);
}

#[test]
fn call_error_names_its_failure() {
    type Error = CallError<ErrorKind>;
    for (error, text) in [
        (Error::Io(ErrorKind::TimedOut), "the port failed: "),
        (Error::Closed, "the port is closed"),
        (Error::TimedOut { sends: 1 }, "the arm did not answer"),
        (Error::TimedOut { sends: 3 }, "the arm did not answer in 3 attempts"),
    ] {
        let actual = error.to_string();
        assert!(actual.starts_with(text), "{actual}");
        assert_eq!(actual.len() > text.len(), matches!(error, Error::Io(_)), "{actual}");
    }
}
