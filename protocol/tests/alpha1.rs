//! Properties of every Alpha1 message and every line of bytes.

mod common;

use std::cell::{Cell, RefCell};
use std::collections::VecDeque;
use std::convert::Infallible;
use std::future::{Future, poll_fn};
use std::pin::pin;
use std::task::{Context, Poll, Waker};

use armwire::alpha1::*;
use armwire::driver::{CallError, Clock, Counters};
use armwire::messages::Messages;
use armwire::time::Instant;
use armwire::{Client, Config, Device, DeviceEvent, Output};
use common::Subject;
use embedded_io_async::{ErrorType, Read, Write};
use proptest::array::{uniform4, uniform10, uniform20};
use proptest::collection::vec;
use proptest::prelude::*;

fn servo() -> impl Strategy<Value = ServoId> {
    // Servos whose single byte is a header, padding or a terminator are more frequent.
    let marked = prop_oneof![Just(80), Just(82), Just(86), Just(67), Just(71), Just(81)];
    prop_oneof![2 => 1..=240_u8, 1 => marked].prop_map(|id| ServoId::new(id).unwrap())
}

fn address() -> impl Strategy<Value = Address> {
    prop_oneof![1 => Just(Address::All), 4 => servo().prop_map(Address::One)]
}

fn angle() -> impl Strategy<Value = Angle> {
    (0..=240_u8).prop_map(|degrees| Angle::new(degrees).unwrap())
}

fn text() -> impl Strategy<Value = Text<'static>> {
    vec(noise(), 0..=MAX_TEXT).prop_map(|text| Text::new(text.leak()).unwrap())
}

fn outcome() -> impl Strategy<Value = Outcome> {
    prop_oneof![Just(Outcome::Success), Just(Outcome::Failure)]
}

fn servo_request() -> impl Strategy<Value = ServoRequest> {
    let moving =
        (address(), angle(), any::<u8>(), any::<u16>()).prop_map(|(to, angle, time, lock)| ServoRequest::Move {
            to,
            angle,
            time: MoveTime::new(time),
            lock: Interval::new(lock),
        });
    let offset = (-90..=90_i16).prop_map(|thirds| Offset::new(thirds).unwrap());
    prop_oneof![
        moving,
        address().prop_map(ServoRequest::Release),
        (address(), any::<u8>()).prop_map(|(to, led)| ServoRequest::SetLed { to, led: Led(led) }),
        servo().prop_map(ServoRequest::ReadAngles),
        (servo(), servo()).prop_map(|(from, to)| ServoRequest::ChangeId { from, to }),
        (servo(), offset).prop_map(|(servo, offset)| ServoRequest::SetOffset(servo, offset)),
        servo().prop_map(ServoRequest::ReadOffset),
        servo().prop_map(ServoRequest::ReadVersion),
    ]
}

fn action() -> impl Strategy<Value = Action> {
    let angles = uniform20(proptest::option::weighted(0.8, angle()));
    (angles, any::<u8>(), any::<u16>()).prop_map(|(angles, time, interval)| Action {
        angles,
        time: MoveTime::new(time),
        interval: Interval::new(interval),
    })
}

fn request() -> impl Strategy<Value = Request<'static>> {
    let usb = prop_oneof![Just(UsbType::Disk), Just(UsbType::SerialPort), Just(UsbType::Hid)];
    prop_oneof![
        Just(Request::ReadHardwareVersion),
        Just(Request::ReadServoStates),
        Just(Request::Stop),
        Just(Request::ReadFirmwareVersion),
        action().prop_map(Request::Act),
        Just(Request::SetOffsetTool(OffsetTool::Connect)),
        Just(Request::SetOffsetTool(OffsetTool::Disconnect)),
        usb.prop_map(Request::SetUsbType),
        text().prop_map(Request::Play),
        servo_request().prop_map(Request::Servo),
    ]
}

/// A response of the robot.
fn robot_response() -> impl Strategy<Value = Response<'static>> {
    let firmware = (outcome(), uniform10(noise())).prop_map(|(outcome, text)| FirmwareVersion { outcome, text });
    prop_oneof![
        text().prop_map(Response::HardwareVersion),
        uniform4(noise()).prop_map(|bytes| Response::ServoStates(ServoStates(bytes))),
        outcome().prop_map(Response::Stopped),
        firmware.prop_map(Response::FirmwareVersion),
        outcome().prop_map(Response::Acted),
        outcome().prop_map(Response::OffsetTool),
        outcome().prop_map(Response::UsbType),
        outcome().prop_map(Response::Playing),
    ]
}

fn answer() -> impl Strategy<Value = ServoAnswer> {
    prop_oneof![
        3 => servo().prop_map(ServoAnswer::Acknowledgement),
        1 => Just(ServoAnswer::Angles),
        1 => Just(ServoAnswer::IdChanged),
        1 => Just(ServoAnswer::OffsetSet),
        1 => Just(ServoAnswer::Offset),
        1 => Just(ServoAnswer::Version),
    ]
}

/// A response of a servo for this expectation.
fn servo_response(answer: ServoAnswer) -> BoxedStrategy<ServoResponse> {
    let words = (any::<u16>(), any::<u16>(), uniform4(noise()));
    (servo(), outcome(), words)
        .prop_map(move |(servo, outcome, (a, b, version))| match answer {
            ServoAnswer::Acknowledgement(servo) => ServoResponse::Acknowledged(servo),
            ServoAnswer::Angles => ServoResponse::Angles {
                servo,
                outcome,
                target: a,
                actual: b,
            },
            ServoAnswer::IdChanged => ServoResponse::IdChanged {
                servo,
                outcome,
                was: a as u8,
            },
            ServoAnswer::OffsetSet => ServoResponse::OffsetSet { servo, outcome },
            ServoAnswer::Offset => ServoResponse::Offset {
                servo,
                outcome,
                thirds: a as i16,
            },
            ServoAnswer::Version => ServoResponse::Version {
                servo,
                outcome,
                version,
            },
        })
        .boxed()
}

/// Headers, terminators, zeros, statuses and lengths of Bluetooth frames, and arbitrary bytes.
fn noise() -> impl Strategy<Value = u8> {
    let marks =
        b"\xF1\x1F\xEF\xFE\xF2\x2F\xF5\x5F\xFB\xBF\xF4\x4F\xF9\x9F\xF3\x3F\xFA\xAF\xFC\xCF\xED\xED\xAA\xEE\x01\x06";
    prop_oneof![
        2 => any::<u8>(),
        3 => proptest::sample::select(&marks[..]),
        1 => Just(0),
        1 => 0..16_u8,
    ]
}

impl Subject for Alpha1 {
    const PADDING: Option<u8> = Some(0);

    fn any_request() -> BoxedStrategy<Request<'static>> {
        request().boxed()
    }

    fn any_response() -> BoxedStrategy<(Vec<u8>, Expect)> {
        let bytes = |response| common::response_bytes::<Alpha1>(&response);
        let robot = (robot_response(), proptest::option::of(answer()))
            .prop_map(move |(response, answer)| (bytes(response), Expect::Responses(answer)));
        let servo = answer().prop_flat_map(move |answer| {
            let expect = Expect::Responses(Some(answer));
            servo_response(answer).prop_map(move |response| (bytes(Response::Servo(response)), expect))
        });
        prop_oneof![robot, servo].boxed()
    }

    fn any_expect() -> BoxedStrategy<Expect> {
        prop_oneof![
            Just(Expect::Requests),
            proptest::option::of(answer()).prop_map(Expect::Responses)
        ]
        .boxed()
    }

    fn any_frame(expect: Expect) -> BoxedStrategy<Vec<u8>> {
        let bytes = |response| common::response_bytes::<Alpha1>(&response);
        let robot = robot_response().prop_map(bytes);
        match expect {
            Expect::Requests => request()
                .prop_map(|request| common::request_bytes::<Alpha1>(&request))
                .boxed(),
            Expect::Responses(None) => robot.boxed(),
            // Noise may turn the byte into a header.
            Expect::Responses(Some(ServoAnswer::Acknowledgement(servo))) if is_header(servo) => robot.boxed(),
            Expect::Responses(Some(answer)) => {
                let servo = servo_response(answer).prop_map(move |response| bytes(Response::Servo(response)));
                prop_oneof![robot, servo].boxed()
            }
        }
    }

    fn any_noise() -> BoxedStrategy<u8> {
        noise().boxed()
    }
}

/// Returns true if the single byte of this servo also begins a header.
fn is_header(servo: ServoId) -> bool {
    matches!(servo.get(), 69 | 71..=75 | 79..=82)
}

proptest! {
    #[test]
    fn every_request_survives_the_wire(request in Alpha1::any_request()) {
        common::a_request_survives_the_wire::<Alpha1>(request)?;
    }

    #[test]
    fn every_response_survives_the_wire(response in Alpha1::any_response()) {
        common::a_response_survives_the_wire::<Alpha1>(response)?;
    }

    #[test]
    fn frame_prefix_never_gets_a_verdict(
        (expect, frame) in Alpha1::any_expect().prop_flat_map(|expect| (Just(expect), Alpha1::any_frame(expect))),
    ) {
        common::a_prefix_of_a_frame_is_given_no_verdict::<Alpha1>(&frame, expect)?;
    }

    #[test]
    fn no_intact_frame_and_no_byte_is_lost(line in common::line::<Alpha1>()) {
        common::nothing_is_lost_to_noise::<Alpha1>(line)?;
    }

    #[test]
    fn client_accepts_any_bytes_at_any_time(steps in common::steps::<Alpha1>(), request in Alpha1::any_request()) {
        common::client_accepts_any_bytes::<Alpha1>(steps, request)?;
    }

    #[test]
    fn decoded_frame_has_all_its_bytes(
        bytes in Alpha1::any_expect().prop_flat_map(Alpha1::any_frame),
    ) {
        let again = match Frame::parse(&bytes).unwrap() {
            Frame::Message { command, data: [status] } if bytes.len() == 4 => {
                vec![command, command.rotate_left(4), *status, 0xED]
            }
            Frame::Message { command, data } => message(command, data),
            Frame::Byte(byte) => vec![byte],
        };
        prop_assert_eq!(again, bytes);
    }

    #[test]
    fn durations_round_to_nearest_unit_or_are_refused(micros in 0..2_000_000_000_u64) {
        let duration = core::time::Duration::from_micros(micros);
        match Interval::from_duration(duration) {
            Ok(interval) => prop_assert!(interval.duration().abs_diff(duration).as_micros() <= 10_000),
            Err(error) => {
                prop_assert!(duration > Interval::MAX.duration());
                prop_assert_eq!((error.min, error.max), (0.0, 1310.7));
            }
        }
    }
}

#[test]
fn late_byte_is_never_attributed_to_another_servo() {
    for addressed in 1..=240_u8 {
        for other in (1..=240_u8).filter(|other| *other != addressed) {
            let mut client = Client::<Alpha1, MAX_FRAME>::new(Alpha1, Config::DEFAULT);
            let to = Address::One(ServoId::new(addressed).unwrap());
            client.submit(&Request::Servo(ServoRequest::Release(to))).unwrap();
            assert_eq!(client.poll(Instant::ZERO), Output::Receive);
            client.received(Instant::ZERO, 0).unwrap();
            assert!(matches!(client.poll(Instant::ZERO), Output::Transmit(_)));
            client.transmitted(Instant::ZERO, 10).unwrap();
            assert!(client.receive(Instant::ZERO, &[other.wrapping_add(0xAA)]).is_empty());
            while let Output::Event(event) = client.poll(Instant::ZERO) {
                let event = format!("{event:?}");
                assert!(
                    event.starts_with("Noise"),
                    "servo {addressed} was addressed, servo {other} was late: {event}"
                );
            }
            assert!(!client.is_idle());
        }
    }
}

/// A robot and its servos, which answer at once and echo requests, as a servo bus does.
struct Robot {
    now: Cell<Instant>,
    wake: Cell<Option<Instant>>,
    device: RefCell<Device<Alpha1, MAX_FRAME>>,
    line: RefCell<VecDeque<u8>>,
    echoes: bool,
}

impl Robot {
    fn new(echoes: bool) -> Self {
        Self {
            now: Cell::new(Instant::ZERO),
            wake: Cell::new(None),
            device: RefCell::new(Device::new(Alpha1)),
            line: RefCell::new(VecDeque::new()),
            echoes,
        }
    }

    fn arm(&self) -> Arm<&Self, &Self> {
        Arm::new(self, self, Config::DEFAULT)
    }

    /// Runs a call in virtual time.
    fn run<T>(&self, call: impl Future<Output = T>) -> T {
        let mut call = pin!(call);
        loop {
            self.wake.set(None);
            if let Poll::Ready(output) = call.as_mut().poll(&mut Context::from_waker(Waker::noop())) {
                return output;
            }
            self.now.set(self.wake.get().expect("a timeout"));
        }
    }

    fn receive(&self, bytes: &[u8]) {
        let mut line = self.line.borrow_mut();
        if self.echoes {
            line.extend(bytes);
        }
        let mut device = self.device.borrow_mut();
        assert!(device.receive(bytes).is_empty());
        while let Some(event) = device.poll() {
            let DeviceEvent::Request { request, .. } = event else {
                panic!("the robot received {event:?}");
            };
            if let Some(response) = answer_to(request) {
                line.extend(common::response_bytes::<Alpha1>(&response));
            }
        }
    }
}

fn answer_to(request: Request<'_>) -> Option<Response<'static>> {
    let outcome = Outcome::Success;
    let text = *b"2015121519";
    Some(match request {
        Request::ReadHardwareVersion => Response::HardwareVersion(Text::new(b"V2.0").unwrap()),
        Request::ReadServoStates => Response::ServoStates(ServoStates::from_bits(0xFFFF)),
        Request::Stop => Response::Stopped(Outcome::Failure),
        Request::ReadFirmwareVersion => Response::FirmwareVersion(FirmwareVersion { outcome, text }),
        Request::Act(_) => Response::Acted(outcome),
        Request::SetOffsetTool(_) => Response::OffsetTool(outcome),
        Request::SetUsbType(_) => Response::UsbType(outcome),
        Request::Play(_) => Response::Playing(outcome),
        Request::Servo(request) => Response::Servo(match request {
            ServoRequest::Move { to, .. } | ServoRequest::Release(to) | ServoRequest::SetLed { to, .. } => match to {
                Address::All => return None,
                Address::One(servo) => ServoResponse::Acknowledged(servo),
            },
            ServoRequest::ReadAngles(servo) => ServoResponse::Angles {
                servo,
                outcome,
                target: 90,
                actual: 89,
            },
            ServoRequest::ChangeId { from, to } => ServoResponse::IdChanged {
                servo: to,
                outcome,
                was: from.get(),
            },
            ServoRequest::SetOffset(servo, _) => ServoResponse::OffsetSet { servo, outcome },
            ServoRequest::ReadOffset(servo) => ServoResponse::Offset {
                servo,
                outcome,
                thirds: -3,
            },
            // Servo 9 is missing.
            ServoRequest::ReadVersion(servo) if servo.get() == 9 => return None,
            ServoRequest::ReadVersion(servo) => ServoResponse::Version {
                servo,
                outcome,
                version: [1, 2, 3, 4],
            },
            other => panic!("no answer to {other:?}"),
        }),
        other => panic!("no answer to {other:?}"),
    })
}

impl ErrorType for &Robot {
    type Error = Infallible;
}

impl Read for &Robot {
    async fn read(&mut self, buf: &mut [u8]) -> Result<usize, Infallible> {
        poll_fn(|_| {
            let mut line = self.line.borrow_mut();
            let n = line.len().min(buf.len());
            for (to, from) in buf.iter_mut().zip(line.drain(..n)) {
                *to = from;
            }
            if n == 0 { Poll::Pending } else { Poll::Ready(Ok(n)) }
        })
        .await
    }
}

impl Write for &Robot {
    async fn write(&mut self, buf: &[u8]) -> Result<usize, Infallible> {
        self.receive(buf);
        Ok(buf.len())
    }

    async fn flush(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}

impl Clock for Robot {
    fn now(&self) -> Instant {
        self.now.get()
    }

    async fn wait_until(&self, instant: Instant) {
        poll_fn(|_| {
            if instant <= self.now.get() {
                return Poll::Ready(());
            }
            self.wake
                .set(Some(self.wake.get().map_or(instant, |wake| wake.min(instant))));
            Poll::Pending
        })
        .await;
    }
}

#[test]
fn every_robot_call_returns_its_answer_or_failure() {
    let robot = Robot::new(false);
    let mut arm = robot.arm();
    let action = Action {
        angles: [None; SERVOS],
        time: MoveTime::MAX,
        interval: Interval::MAX,
    };
    let dance = Text::new(b"dance").unwrap();
    assert_eq!(
        robot.run(arm.read_hardware_version(|text| text.to_string())),
        Ok("V2.0".to_owned())
    );
    assert_eq!(robot.run(arm.read_firmware_version()).unwrap().text, OLDEST_FIRMWARE);
    assert_eq!(robot.run(arm.read_servo_states()).unwrap().running().count(), 16);
    assert_eq!(robot.run(arm.act(action)), Ok(()));
    assert_eq!(robot.run(arm.play(dance)), Ok(()));
    assert_eq!(robot.run(arm.stop()), Err(CallError::Failed));
    assert_eq!(robot.run(arm.set_offset_tool(OffsetTool::Connect)), Ok(()));
    assert_eq!(robot.run(arm.set_usb_type(UsbType::Hid)), Ok(()));
    assert_eq!(arm.counters(), Counters::default());
    assert_eq!(robot.now.get(), Instant::ZERO);
}

#[test]
fn servo_calls_return_answers_with_or_without_echo() {
    for echoes in [false, true] {
        let robot = Robot::new(echoes);
        let mut arm = robot.arm();
        let servo = ServoId::new(1).unwrap();
        let other = ServoId::new(2).unwrap();
        let right_angle = Angle::new(90).unwrap();
        for to in [Address::One(servo), Address::All] {
            let moved = robot.run(arm.move_servo(to, right_angle, MoveTime::MAX, Interval::MAX));
            assert_eq!(moved, Ok(()));
            assert_eq!(robot.run(arm.set_servo_led(to, Led(1))), Ok(()));
            assert_eq!(robot.run(arm.release_servo(to)), Ok(()));
        }
        let angles = robot.run(arm.read_servo_angles(servo)).unwrap();
        assert_eq!((angles.target, angles.actual), (90, 89));
        assert_eq!(robot.run(arm.change_servo_id(servo, other)), Ok(()));
        assert_eq!(robot.run(arm.set_servo_offset(servo, Offset::MAX)), Ok(()));
        assert_eq!(robot.run(arm.read_servo_offset(servo)), Ok(-3));
        assert_eq!(robot.run(arm.read_servo_version(servo)), Ok([1, 2, 3, 4]));
        assert_eq!(robot.now.get(), Instant::ZERO);
        let mut expected = Counters::default();
        expected.echoes = if echoes { 11 } else { 0 };
        assert_eq!(arm.counters(), expected);
    }
}

#[test]
fn absent_servo_is_retried_then_given_up() {
    let robot = Robot::new(true);
    let mut arm = robot.arm();
    let servo = ServoId::new(9).unwrap();
    let error = robot.run(arm.read_servo_version(servo)).unwrap_err();
    assert_eq!(error, CallError::TimedOut { sends: 3 });
    assert_eq!(arm.counters().echoes, 3);
}

#[test]
fn header_like_servo_byte_is_received_after_silence() {
    for id in [80, 82] {
        for echoes in [false, true] {
            let robot = Robot::new(echoes);
            let to = Address::One(ServoId::new(id).unwrap());
            assert_eq!(robot.run(robot.arm().release_servo(to)), Ok(()));
            assert!(Instant::ZERO < robot.now.get() && robot.now.get() < Instant::from_micros(30_000));
        }
    }
}

/// A frame with a checksum.
fn message(command: u8, data: &[u8]) -> Vec<u8> {
    [&[command, command.rotate_left(4)], data, &[checksum(data), 0xED]].concat()
}

#[test]
fn only_moves_releases_and_lights_are_broadcast() {
    for (data, request) in [
        ([0, 0x01, 0xFF, 0, 0, 0], ServoRequest::Release(Address::All)),
        (
            [0, 0x01, 90, 50, 0, 50],
            ServoRequest::Move {
                to: Address::All,
                angle: Angle::new(90).unwrap(),
                time: MoveTime::new(50),
                lock: Interval::new(50),
            },
        ),
        (
            [0, 0x04, 1, 0, 0, 0],
            ServoRequest::SetLed {
                to: Address::All,
                led: Led(1),
            },
        ),
    ] {
        assert_eq!(Alpha1.parse_request(&message(0xFA, &data)), Ok(Request::Servo(request)));
        let mut out = [0; MAX_FRAME];
        let n = Alpha1.encode_request(&Request::Servo(request), &mut out).unwrap();
        assert_eq!((n, &out[2..8]), (10, &data[..]));
    }
    let refused = "servo id is 0, must be 1..=240";
    assert_eq!(ServoId::new(0).unwrap_err().to_string(), refused);
    // Angles, a change of id, from all and to all, offsets, the version.
    for (command, data) in [
        (0xFA, [0, 0x02, 0, 0, 0, 0]),
        (0xFA, [0, 0xCD, 0, 2, 0, 0]),
        (0xFA, [1, 0xCD, 0, 0, 0, 0]),
        (0xFA, [0, 0xD2, 0, 0, 0, 1]),
        (0xFA, [0, 0xD4, 0, 0, 0, 0]),
        (0xFC, [0, 0x01, 0, 0, 0, 0]),
    ] {
        let error = Alpha1.parse_request(&message(command, &data)).unwrap_err();
        assert!(error.to_string().contains(refused), "{error}");
    }
}
