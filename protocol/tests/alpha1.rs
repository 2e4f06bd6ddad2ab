//! What holds of every Alpha1 message and every line of bytes.

mod common;

use armwire::alpha1::*;
use armwire::{Client, Config, Event, Input, Micros};
use common::Subject;
use proptest::array::{uniform4, uniform10, uniform20};
use proptest::collection::vec;
use proptest::prelude::*;

fn servo() -> impl Strategy<Value = ServoId> {
    // Those whose single byte is a header, filling or an end mark more often than the rest.
    let marked = prop_oneof![Just(80), Just(82), Just(86), Just(67), Just(71), Just(81)];
    prop_oneof![2 => 1..=240_u8, 1 => marked].prop_map(|id| ServoId::new(id).unwrap())
}

fn address() -> impl Strategy<Value = Address> {
    prop_oneof![1 => Just(Address::All), 4 => servo().prop_map(Address::One)]
}

fn angle() -> impl Strategy<Value = Angle> {
    (0..=240_u8).prop_map(|degrees| Angle::new(degrees).unwrap())
}

fn text() -> impl Strategy<Value = Text> {
    vec(noise(), 0..=MAX_TEXT).prop_map(|text| Text::new(&text).unwrap())
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

fn request() -> impl Strategy<Value = Request> {
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

/// What the robot says for itself.
fn robot_response() -> impl Strategy<Value = Response> {
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

/// What a servo says when this is expected of it.
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

/// Headers, end marks, zeros, statuses and lengths of Bluetooth frames, and what is none of them.
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
    const MIN_FRAME: usize = 1;
    const FILL: Option<u8> = Some(0);

    fn any_request() -> BoxedStrategy<Request> {
        request().boxed()
    }

    fn any_response() -> BoxedStrategy<(Response, Expect)> {
        let robot = (robot_response(), proptest::option::of(answer()))
            .prop_map(|(response, answer)| (response, Expect::Responses(answer)));
        let servo = answer().prop_flat_map(|answer| {
            let expect = Expect::Responses(Some(answer));
            servo_response(answer).prop_map(move |response| (Response::Servo(response), expect))
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
        let bytes = |response| common::response_bytes::<Alpha1, MAX_FRAME>(&response);
        let robot = robot_response().prop_map(bytes);
        match expect {
            Expect::Requests => request()
                .prop_map(|request| common::request_bytes::<Alpha1, MAX_FRAME>(&request))
                .boxed(),
            Expect::Responses(None) => robot.boxed(),
            // Noise may make a header of it.
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

    fn wire_len(frame: Frame<'_>) -> usize {
        match frame {
            Frame::Byte(_) => 1,
            Frame::Message {
                data: [0xAA | 0xEE], ..
            } => 4,
            Frame::Message { data, .. } => data.len() + 4,
        }
    }
}

/// Whether the single byte of this servo begins a header too.
fn is_header(servo: ServoId) -> bool {
    matches!(servo.get(), 69 | 71..=75 | 79..=82)
}

proptest! {
    #[test]
    fn every_request_survives_the_wire(request in Alpha1::any_request()) {
        common::a_request_survives_the_wire::<Alpha1, MAX_FRAME>(request)?;
    }

    #[test]
    fn every_response_survives_the_wire(response in Alpha1::any_response()) {
        common::a_response_survives_the_wire::<Alpha1, MAX_FRAME>(response)?;
    }

    #[test]
    fn a_prefix_of_a_frame_is_never_given_a_verdict(
        (expect, frame) in Alpha1::any_expect().prop_flat_map(|expect| (Just(expect), Alpha1::any_frame(expect))),
    ) {
        common::a_prefix_of_a_frame_is_given_no_verdict::<Alpha1>(&frame, expect)?;
    }

    #[test]
    fn what_comes_out_does_not_depend_on_the_chunks(line in common::line::<Alpha1>(), cuts in common::cuts()) {
        common::chunks_do_not_matter::<Alpha1, MAX_FRAME>(line, &cuts)?;
    }

    #[test]
    fn no_intact_frame_and_no_byte_is_lost(line in common::line::<Alpha1>()) {
        common::nothing_is_lost_to_noise::<Alpha1, MAX_FRAME>(line)?;
    }

    #[test]
    fn the_client_takes_any_bytes_at_any_time(steps in common::steps::<Alpha1>(), request in Alpha1::any_request()) {
        common::a_client_takes_anything::<Alpha1, MAX_FRAME>(steps, request)?;
    }

    #[test]
    fn durations_go_to_the_nearest_unit_or_are_refused(micros in 0..2_000_000_000_u64) {
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

/// Tells servo `id` to move and then hears `bytes`.
fn events_of_a_move(id: u8, bytes: &[u8]) -> Vec<Event<Alpha1>> {
    let mut client = Client::<Alpha1, MAX_FRAME>::new(Config::DEFAULT);
    let to = Address::One(ServoId::new(id).unwrap());
    let release = Request::Servo(ServoRequest::Release(to));
    client.submit(release).unwrap();
    let n = client.poll_transmit(Micros(0)).unwrap().len();
    client.transmitted(Micros(0), n);
    let mut input = Input::Bytes(bytes);
    std::iter::from_fn(|| client.handle(Micros(1), &mut input)).collect()
}

#[test]
fn no_servos_late_byte_is_taken_for_another_servos() {
    for asked in 1..=240_u8 {
        for other in (1..=240_u8).filter(|other| *other != asked) {
            let events = events_of_a_move(asked, &[other.wrapping_add(0xAA)]);
            assert_eq!(events, [], "servo {asked} was asked, servo {other} was late");
        }
    }
}
