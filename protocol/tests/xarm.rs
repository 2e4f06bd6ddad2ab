//! Properties of every xArm message, every stream of bytes, and every call.

// Arbitrary bytes for a client are tested in `client.rs`: here the first byte may break the stream.
#[allow(dead_code)]
mod common;

use std::cell::RefCell;
use std::collections::VecDeque;
use std::convert::Infallible;
use std::future::{Future, poll_fn};
use std::pin::pin;
use std::task::{Context, Poll, Waker};

use armwire::driver::{CallError, Clock};
use armwire::framing::{Framing, Reason, Scan};
use armwire::messages::Messages;
use armwire::time::Instant;
use armwire::xarm::*;
use armwire::{Config, Device, DeviceEvent};
use common::Subject;
use embedded_io_async::{ErrorType, Read, Write};
use proptest::collection::vec;
use proptest::prelude::*;

fn raw() -> impl Strategy<Value = Raw<'static>> {
    let params = prop_oneof![vec(any::<u8>(), 0..8), vec(any::<u8>(), 0..=MAX_PARAMS)];
    let register = any::<u8>().prop_filter("typed", |&register| Register::from_code(register).is_none());
    (register, params).prop_map(|(register, params)| Raw::new(register, params.leak()).unwrap())
}

fn request() -> impl Strategy<Value = Request<'static>> {
    prop_oneof![
        Just(Request::Heartbeat),
        Just(Request::ReadVersion),
        Just(Request::ReadSerials),
        Just(Request::ReloadDynamics),
        Just(Request::ReadTorqueSource),
        (1..=7_u8).prop_map(|joint| Request::ReadRotationRadius(Joint::new(joint).unwrap())),
        Just(Request::Shutdown),
        Just(Request::Reboot),
        raw().prop_map(Request::Raw),
    ]
}

fn reply() -> impl Strategy<Value = Reply<'static>> {
    let text = || vec(any::<u8>(), 1..=MAX_PARAMS).prop_map(|text| &*text.leak());
    prop_oneof![
        any::<u8>().prop_map(Reply::empty),
        text().prop_map(|text| Reply::Version(VersionText(text))),
        text().prop_map(|text| Reply::Serials(SerialsText(text))),
        Just(Reply::TorqueSource(TorqueSource::Torque)),
        Just(Reply::TorqueSource(TorqueSource::Current)),
        // Every bit pattern: NaN, the infinities and negative numbers too.
        any::<u32>().prop_map(|bits| Reply::RotationRadius(RotationRadius {
            millimetres: f32::from_bits(bits)
        })),
        any::<u16>().prop_map(Reply::SystemControl),
        raw().prop_map(Reply::Raw),
    ]
}

fn response() -> impl Strategy<Value = Response<'static>> {
    let reply = (any::<u8>(), reply()).prop_map(|(state, reply)| Response::Reply {
        state: State(state),
        reply,
    });
    let refused = (any::<u8>(), 0..=127_u8).prop_map(|(unit, function)| Response::ModbusRefused {
        unit,
        function: ModbusFunction::new(function).unwrap(),
    });
    prop_oneof![1 => Just(Response::Heartbeat), 1 => refused, 8 => reply]
}

impl Subject for XArm {
    const PADDING: Option<u8> = None;

    fn any_request() -> BoxedStrategy<Request<'static>> {
        request().boxed()
    }

    fn any_response() -> BoxedStrategy<(Vec<u8>, Direction)> {
        response()
            .prop_map(|response| (common::response_bytes::<XArm>(&response), Direction::Responses))
            .boxed()
    }

    fn any_expect() -> BoxedStrategy<Direction> {
        prop_oneof![Just(Direction::Requests), Just(Direction::Responses)].boxed()
    }

    fn any_frame(expect: Direction) -> BoxedStrategy<Vec<u8>> {
        match expect {
            Direction::Requests => request()
                .prop_map(|request| common::request_bytes::<XArm>(&request))
                .boxed(),
            Direction::Responses => response()
                .prop_map(|response| common::response_bytes::<XArm>(&response))
                .boxed(),
        }
    }

    fn any_noise() -> BoxedStrategy<u8> {
        prop_oneof![2 => any::<u8>(), 8 => 0..4_u8].boxed()
    }
}

/// A line as delivered by TCP: frames without noise.
fn sound_line() -> impl Strategy<Value = common::Line<XArm>> {
    XArm::any_expect().prop_flat_map(|expect| {
        let parts = vec((Just(Vec::new()), XArm::any_frame(expect)), 1..12);
        (Just(expect), parts)
    })
}

proptest! {
    #[test]
    fn every_request_survives_the_wire(request in XArm::any_request()) {
        common::a_request_survives_the_wire::<XArm>(request)?;
    }

    #[test]
    fn every_response_survives_the_wire(response in XArm::any_response()) {
        common::a_response_survives_the_wire::<XArm>(response)?;
    }

    #[test]
    fn response_repeats_the_numbers_of_its_request(
        transaction in any::<u16>(),
        protocol in 2..=3_u16,
        response in response(),
    ) {
        let Response::Reply { reply, .. } = response else { return Ok(()) };
        let key = Key { transaction, protocol, register: reply.register() };
        let mut out = [0; MAX_FRAME];
        let n = XArm::PRIVATE.encode_response(&response, Some(key), &mut out).unwrap();
        let frame = Frame::parse(&out[..n]).unwrap();
        prop_assert_eq!((frame.transaction, frame.protocol), (transaction, protocol));
    }

    #[test]
    fn frame_prefix_never_gets_a_verdict(
        (expect, frame) in XArm::any_expect().prop_flat_map(|expect| (Just(expect), XArm::any_frame(expect))),
    ) {
        common::a_prefix_of_a_frame_is_given_no_verdict::<XArm>(&frame, expect)?;
    }

    #[test]
    fn sound_line_loses_no_frame_or_byte(line in sound_line()) {
        common::nothing_is_lost_to_noise::<XArm>(line)?;
    }

    #[test]
    fn device_accepts_any_bytes(stream in vec(XArm::any_noise(), 0..600), chunk in 1..40_usize) {
        let mut device = Device::<XArm, MAX_FRAME>::new(XArm::PRIVATE);
        let (mut broken, mut out) = (false, [0; MAX_FRAME]);
        for mut bytes in stream.chunks(chunk) {
            // A long frame may fill the decoder before this chunk is in.
            while !bytes.is_empty() {
                let rest = device.receive(bytes);
                prop_assert!(rest.len() < bytes.len());
                bytes = rest;
                loop {
                    // Every valid frame has an answer that can be sent.
                    let refusal = match device.poll() {
                        None => break,
                        Some(_) if broken => panic!("an event after the break"),
                        Some(DeviceEvent::Broken { .. }) => {
                            broken = true;
                            continue;
                        }
                        Some(DeviceEvent::Unknown { error, key, .. }) => (Response::refusal(&error).unwrap(), key),
                        Some(_) => continue,
                    };
                    let n = device.respond(&refusal.0, refusal.1, &mut out).unwrap();
                    prop_assert_eq!(XArm::PRIVATE.scan(&out[..n], Direction::Responses), Scan::Frame(n));
                }
            }
        }
    }
}

/// A connection in virtual time, with an arm that sends prepared answers at once.
struct World {
    now: Instant,
    wake: Option<Instant>,
    arm: Device<XArm, MAX_FRAME>,
    /// The texts of the requests, their numbers and their protocol ids.
    requests: Vec<(String, u16, u16)>,
    /// The arm's answers, in turn; no answer after the last.
    script: VecDeque<(State, Reply<'static>)>,
    /// Bytes right after each answer.
    behind: Vec<u8>,
    line: VecDeque<u8>,
}

type Shared = RefCell<World>;

fn world(script: impl IntoIterator<Item = (State, Reply<'static>)>) -> Shared {
    RefCell::new(World {
        now: Instant::ZERO,
        wake: None,
        arm: Device::new(XArm::PRIVATE),
        requests: Vec::new(),
        script: script.into_iter().collect(),
        behind: Vec::new(),
        line: VecDeque::new(),
    })
}

struct Port<'w>(&'w Shared);

impl ErrorType for Port<'_> {
    type Error = Infallible;
}

impl Read for Port<'_> {
    async fn read(&mut self, buf: &mut [u8]) -> Result<usize, Infallible> {
        poll_fn(|_| {
            let line = &mut self.0.borrow_mut().line;
            let n = line.len().min(buf.len());
            for (to, from) in buf.iter_mut().zip(line.drain(..n)) {
                *to = from;
            }
            if n > 0 { Poll::Ready(Ok(n)) } else { Poll::Pending }
        })
        .await
    }
}

impl Write for Port<'_> {
    async fn write(&mut self, buf: &[u8]) -> Result<usize, Infallible> {
        let World {
            arm,
            requests,
            script,
            behind,
            line,
            ..
        } = &mut *self.0.borrow_mut();
        assert!(arm.receive(buf).is_empty());
        let (request, key) = match arm.poll() {
            Some(DeviceEvent::Request { request, key }) => (request, key.unwrap()),
            other => panic!("the arm received {other:?}"),
        };
        requests.push((format!("{request:?}"), key.transaction, key.protocol));
        let answered = request != Request::Heartbeat;
        if let Some((state, reply)) = script.pop_front().filter(|_| answered) {
            let mut out = [0; MAX_FRAME];
            let n = arm
                .respond(&Response::Reply { state, reply }, Some(key), &mut out)
                .unwrap();
            line.extend(&out[..n]);
            line.extend(&*behind);
        }
        Ok(buf.len())
    }

    async fn flush(&mut self) -> Result<(), Infallible> {
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
            world.wake = Some(world.wake.map_or(instant, |wake| wake.min(instant)));
            Poll::Pending
        })
        .await;
    }
}

fn run<F: Future>(world: &Shared, future: F) -> F::Output {
    let mut future = pin!(future);
    loop {
        if let Poll::Ready(output) = future.as_mut().poll(&mut Context::from_waker(Waker::noop())) {
            return output;
        }
        let mut world = world.borrow_mut();
        world.now = world.wake.take().expect("a timeout");
    }
}

fn arm(world: &Shared) -> Arm<Port<'_>, VirtualClock<'_>> {
    Arm::new(Port(world), VirtualClock(world), Config::TCP)
}

const VERSION: Reply<'static> = Reply::Version(VersionText(b"6,6,XI1202,AC1302,v1.12.10"));

#[test]
fn every_call_reads_its_register_with_state() {
    let radius = RotationRadius::from_metres(0.3).unwrap();
    let joint = Joint::new(6).unwrap();
    let states = [0x00, 0x10, 0x20, 0x40, 0x70, 0x87, 0x01, 0x00].map(State);
    let replies = [
        VERSION,
        Reply::Serials(SerialsText(b"XI120204201B02\0AC130202B02L02\n")),
        Reply::Empty(Register::ReloadDynamics),
        Reply::TorqueSource(TorqueSource::Current),
        Reply::RotationRadius(radius),
        Reply::Empty(Register::SystemControl),
        Reply::SystemControl(1),
        Reply::Raw(Raw::new(13, &[2]).unwrap()),
    ];
    let world = world(states.into_iter().zip(replies));
    let mut arm = arm(&world);
    let [s1, s2, s3, s4, s5, s6, s7, s8] = states;
    run(&world, async {
        let firmware = arm
            .read_version(|text| text.version().unwrap().firmware.to_owned())
            .await
            .unwrap();
        assert_eq!((firmware.value.as_str(), firmware.state), ("v1.12.10", s1));
        let serial = arm
            .read_serials(|serials| serials.arm().unwrap().to_owned())
            .await
            .unwrap();
        assert_eq!((serial.value.as_str(), serial.state), ("XI120204201B02", s2));
        assert_eq!(arm.reload_dynamics().await.unwrap().state, s3);
        let source = arm.read_torque_source().await.unwrap();
        assert_eq!((source.value, source.state), (TorqueSource::Current, s4));
        let reply = arm.read_rotation_radius(joint).await.unwrap();
        assert_eq!((reply.value, reply.state), (radius, s5));
        assert_eq!(arm.shut_down().await.unwrap().state, s6);
        assert_eq!(arm.reboot().await.unwrap().state, s7);
        arm.set_protocol(ProtocolId::Supervised);
        let raw = arm
            .raw(Raw::new(13, &[]).unwrap(), |raw| raw.params().to_vec())
            .await
            .unwrap();
        assert_eq!((raw.value, raw.state), (vec![2], s8));
        assert_eq!(arm.heartbeat().await, Ok(()));
    });
    let requests = [
        Request::ReadVersion,
        Request::ReadSerials,
        Request::ReloadDynamics,
        Request::ReadTorqueSource,
        Request::ReadRotationRadius(joint),
        Request::Shutdown,
        Request::Reboot,
        Request::Raw(Raw::new(13, &[]).unwrap()),
    ];
    let calls = (1..).zip(requests).map(|(number, request)| {
        let protocol = if number < 8 { 2 } else { 3 };
        (format!("{request:?}"), number, protocol)
    });
    let expected: Vec<_> = calls.chain([("Heartbeat".to_owned(), 0, 1)]).collect();
    assert_eq!(world.borrow().requests, expected);
    assert_eq!(arm.counters(), Default::default());
}

#[test]
fn refused_or_empty_answer_is_error_with_state() {
    let invalid = State::INVALID | State::ERROR;
    let world = world([
        (invalid, Reply::Empty(Register::Version)),
        (invalid, VERSION),
        (State::ERROR, Reply::Empty(Register::Version)),
        (State::INVALID, Reply::Empty(Register::SystemControl)),
        (State::INVALID, Reply::empty(77)),
    ]);
    let mut arm = arm(&world);
    run(&world, async {
        for state in [invalid, invalid, State::ERROR] {
            assert_eq!(arm.read_version(|_| ()).await, Err(CallError::Refused(state)));
        }
        let refused = CallError::Refused(State::INVALID);
        assert_eq!(arm.shut_down().await, Err(refused));
        assert_eq!(arm.raw(Raw::new(77, &[]).unwrap(), |_| ()).await, Err(refused));
        assert_eq!(refused.to_string(), "the arm refused, its state: invalid");
    });
}

#[test]
fn silent_arm_timeouts_match_the_vendor_package() {
    let world = world([]);
    let mut arm = arm(&world);
    let silence = Err(CallError::TimedOut { sends: 1 });
    assert_eq!(run(&world, arm.read_version(|_| ())), silence);
    let waited = world.borrow().now.as_micros();
    assert!((2_000_000..2_200_000).contains(&waited), "{waited}");
    assert_eq!(world.borrow().requests.len(), 1);
}

#[test]
fn broken_connection_ends_calls_with_its_position() {
    let world = world([(State::OK, VERSION)]);
    let mut arm = arm(&world);
    world.borrow_mut().line.extend([0, 1, 0, 9]);
    let reason = Reason::Byte {
        offset: 3,
        expected: &[0, 1, 2, 3],
        got: 9,
    };
    let broken = CallError::Broken { offset: 0, reason };
    for _ in 0..3 {
        assert_eq!(run(&world, arm.read_version(|_| ())), Err(broken));
    }
    assert_eq!(
        broken.to_string(),
        "the connection is broken: byte 0: byte 3 is 0x09, expected 0x00 or 0x01 or 0x02 or 0x03"
    );
}

#[test]
fn answer_that_arrives_with_the_break_counts() {
    let world = world([(State::OK, Reply::Empty(Register::ReloadDynamics))]);
    world.borrow_mut().behind.extend([0, 2, 0, 9]);
    let mut arm = arm(&world);
    assert!(run(&world, arm.reload_dynamics()).is_ok());
    let error = run(&world, arm.reload_dynamics()).unwrap_err();
    assert!(matches!(error, CallError::Broken { offset: 8, .. }), "{error}");
}
