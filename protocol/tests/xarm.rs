//! What holds of every xArm message, every stream of bytes, and every call.

// What a client makes of any bytes is said below: it differs where the first of them can be the last.
#[allow(dead_code)]
mod common;

use std::cell::RefCell;
use std::collections::VecDeque;
use std::convert::Infallible;
use std::future::{Future, poll_fn};
use std::pin::pin;
use std::task::{Context, Poll, Waker};

use armwire::driver::{CallError, Clock};
use armwire::xarm::*;
use armwire::{Client, Config, Decoder, Device, Event, Framing, Heard, Input, Micros, Noise, Reason, Scan};
use common::{Out, Subject};
use embedded_io_async::{ErrorType, Read, Write};
use proptest::collection::vec;
use proptest::prelude::*;

fn header() -> impl Strategy<Value = Header> {
    let protocol = prop_oneof![Just(ProtocolId::Private), Just(ProtocolId::Supervised)];
    (any::<u16>(), protocol).prop_map(|(transaction, protocol)| Header { transaction, protocol })
}

fn raw() -> impl Strategy<Value = Raw> {
    let params = prop_oneof![vec(any::<u8>(), 0..8), vec(any::<u8>(), 0..=MAX_PARAMS)];
    let register = any::<u8>().prop_filter("typed", |&register| Register::from_code(register).is_none());
    (register, params).prop_map(|(register, params)| Raw::new(register, &params).unwrap())
}

fn command() -> impl Strategy<Value = Command> {
    prop_oneof![
        Just(Command::ReadVersion),
        Just(Command::ReadSerials),
        Just(Command::ReloadDynamics),
        Just(Command::ReadTorqueSource),
        (1..=7_u8).prop_map(|joint| Command::ReadRotationRadius(Joint::new(joint).unwrap())),
        Just(Command::Shutdown),
        Just(Command::Reboot),
        raw().prop_map(Command::Raw),
    ]
}

fn request() -> impl Strategy<Value = Request> {
    let call = (header(), command()).prop_map(|(header, command)| Request::Call { header, command });
    prop_oneof![1 => Just(Request::Heartbeat), 9 => call]
}

fn reply() -> impl Strategy<Value = Reply> {
    let text = || vec(any::<u8>(), TEXT).prop_map(|text| <[u8; TEXT]>::try_from(text).unwrap());
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

fn response() -> impl Strategy<Value = Response> {
    let reply = (header(), any::<u8>(), reply()).prop_map(|(header, state, reply)| Response::Reply {
        header,
        state: State(state),
        reply,
    });
    let refused =
        (any::<u16>(), any::<u8>(), 0..=127_u8).prop_map(|(transaction, unit, function)| Response::ModbusRefused {
            transaction,
            unit,
            function: ModbusFunction::new(function).unwrap(),
        });
    prop_oneof![1 => Just(Response::Heartbeat), 1 => refused, 8 => reply]
}

/// A frame that no message has, all of whose bytes are skipped, and why.
fn skipped() -> impl Strategy<Value = (Vec<u8>, Reason)> {
    let id = any::<[u8; 2]>();
    let lengths = prop_oneof![
        8 => 0..=1_u16,
        8 => MAX_BODY as u16 + 1..=600,
        1 => 65_000..=u16::MAX,
    ];
    let length = (id, 2..=3_u8, lengths).prop_map(|([a, b], protocol, got)| {
        let reason = Reason::Length {
            min: 2,
            max: MAX_BODY as u16,
            got,
        };
        let [high, low] = got.to_be_bytes();
        let mut bytes = vec![a, b, 0, protocol, high, low];
        bytes.resize(HEADER + usize::from(got), a);
        (bytes, reason)
    });
    let heartbeat = (prop::sample::select(vec![0_u8, 1, 6, 7]), 1..=255_u8).prop_map(|(offset, got)| {
        let mut bytes = HEARTBEAT;
        bytes[usize::from(offset)] = got;
        let reason = Reason::Byte {
            offset,
            expected: &[0],
            got,
        };
        (bytes.to_vec(), reason)
    });
    prop_oneof![length, heartbeat]
}

/// The start of a frame that breaks the stream, how much of it is dropped, and why.
fn breach() -> impl Strategy<Value = (Vec<u8>, usize, Reason)> {
    let id = any::<[u8; 2]>();
    let high = (id, 1..=255_u8).prop_map(|([a, b], got)| {
        let reason = Reason::Byte {
            offset: 2,
            expected: &[0],
            got,
        };
        (vec![a, b, got], 3, reason)
    });
    let low = (id, 4..=255_u8).prop_map(|([a, b], got)| {
        let reason = Reason::Byte {
            offset: 3,
            expected: &[0, 1, 2, 3],
            got,
        };
        (vec![a, b, 0, got], 4, reason)
    });
    prop_oneof![high, low]
}

fn bytes_of(response: &Response) -> Vec<u8> {
    common::response_bytes::<XArm, MAX_FRAME>(response)
}

impl Subject for XArm {
    const MIN_FRAME: usize = HEADER + 1;
    const FILL: Option<u8> = None;

    fn any_request() -> BoxedStrategy<Request> {
        request().boxed()
    }

    fn any_response() -> BoxedStrategy<(Response, Direction)> {
        (response(), Just(Direction::Responses)).boxed()
    }

    fn any_expect() -> BoxedStrategy<Direction> {
        prop_oneof![Just(Direction::Requests), Just(Direction::Responses)].boxed()
    }

    fn any_frame(expect: Direction) -> BoxedStrategy<Vec<u8>> {
        match expect {
            Direction::Requests => request()
                .prop_map(|request| common::request_bytes::<XArm, MAX_FRAME>(&request))
                .boxed(),
            Direction::Responses => response().prop_map(|response| bytes_of(&response)).boxed(),
        }
    }

    fn any_noise() -> BoxedStrategy<u8> {
        prop_oneof![2 => any::<u8>(), 8 => 0..4_u8].boxed()
    }

    fn wire_len(frame: Frame<'_>) -> usize {
        frame.body.len() + HEADER
    }
}

/// A line as TCP gives it: frames and nothing between them.
fn sound_line() -> impl Strategy<Value = common::Line<XArm>> {
    XArm::any_expect().prop_flat_map(|expect| {
        let parts = vec((Just(Vec::new()), XArm::any_frame(expect)), 1..12);
        (Just(expect), parts)
    })
}

fn hear(client: &mut Client<XArm, MAX_FRAME>, now: Micros, bytes: &[u8]) -> Vec<Event<XArm>> {
    let mut input = Input::Bytes(bytes);
    std::iter::from_fn(|| client.handle(now, &mut input)).collect()
}

fn transmit(client: &mut Client<XArm, MAX_FRAME>, now: Micros) -> usize {
    let n = client.poll_transmit(now).map_or(0, <[u8]>::len);
    client.transmitted(now, n).unwrap();
    n
}

proptest! {
    #[test]
    fn every_request_survives_the_wire(request in XArm::any_request()) {
        common::a_request_survives_the_wire::<XArm, MAX_FRAME>(request)?;
    }

    #[test]
    fn every_response_survives_the_wire(response in XArm::any_response()) {
        common::a_response_survives_the_wire::<XArm, MAX_FRAME>(response)?;
    }

    #[test]
    fn a_prefix_of_a_frame_is_never_given_a_verdict(
        (expect, frame) in XArm::any_expect().prop_flat_map(|expect| (Just(expect), XArm::any_frame(expect))),
    ) {
        common::a_prefix_of_a_frame_is_given_no_verdict::<XArm>(&frame, expect)?;
    }

    #[test]
    fn what_comes_out_does_not_depend_on_the_chunks(
        line in prop_oneof![sound_line(), common::line::<XArm>()],
        cuts in common::cuts(),
    ) {
        common::chunks_do_not_matter::<XArm, MAX_FRAME>(line, &cuts)?;
    }

    #[test]
    fn no_frame_and_no_byte_of_a_sound_line_is_lost(line in sound_line()) {
        common::nothing_is_lost_to_noise::<XArm, MAX_FRAME>(line)?;
    }

    #[test]
    fn a_framing_error_is_told_once_where_it_is_and_nothing_is_read_after_it(
        before in vec(response(), 0..5),
        (breach, len, reason) in breach(),
        garbage in vec(any::<u8>(), 0..300),
        after in vec(response(), 0..5),
        cuts in common::cuts(),
    ) {
        let mut good = Vec::new();
        let mut expected = Vec::new();
        for bytes in before.iter().map(bytes_of) {
            expected.push(Out::Frame(good.len()..good.len() + bytes.len()));
            good.extend(bytes);
        }
        let after: Vec<u8> = after.iter().flat_map(bytes_of).collect();
        let stream = [&good, &breach, &garbage, &after].map(|part| &part[..]).concat();
        expected.push(Out::Noise(Noise { offset: good.len() as u64, len, reason }));
        for chunks in [vec![&stream[..]], common::cut(&stream, &cuts), stream.chunks(1).collect()] {
            prop_assert_eq!(&common::decode::<XArm, MAX_FRAME>(&chunks, Direction::Responses), &expected);
        }
    }

    #[test]
    fn a_frame_that_no_message_has_is_skipped_whole_and_those_around_it_are_read(
        before in vec(response(), 0..3),
        skips in vec(skipped(), 1..3),
        after in vec(response(), 1..3),
        cuts in common::cuts(),
    ) {
        let (mut stream, mut expected) = (Vec::new(), Vec::new());
        let frame = |stream: &mut Vec<u8>, expected: &mut Vec<Out>, response| {
            let bytes = bytes_of(response);
            expected.push(Out::Frame(stream.len()..stream.len() + bytes.len()));
            stream.extend(bytes);
        };
        before.iter().for_each(|response| frame(&mut stream, &mut expected, response));
        for (bytes, reason) in skips {
            expected.push(Out::Noise(Noise { offset: stream.len() as u64, len: bytes.len(), reason }));
            stream.extend(bytes);
        }
        after.iter().for_each(|response| frame(&mut stream, &mut expected, response));
        for chunks in [vec![&stream[..]], common::cut(&stream, &cuts), stream.chunks(1).collect()] {
            prop_assert_eq!(&common::decode::<XArm, MAX_FRAME>(&chunks, Direction::Responses), &expected);
        }
        // From memory as well, where frames are not copied.
        let mut decoder = Decoder::<XArm, MAX_FRAME>::new();
        let mut rest = &stream[..];
        let mut noise = Vec::new();
        while let Some(next) = decoder.decode(&mut rest, Direction::Responses) {
            noise.push(next.err());
        }
        let expected: Vec<_> = expected.into_iter().map(|out| match out {
            Out::Frame(_) => None,
            Out::Noise(noise) => Some(noise),
        }).collect();
        prop_assert_eq!((noise, rest.len()), (expected, 0));
    }

    #[test]
    fn only_a_reply_with_the_same_header_and_register_is_an_answer(
        header in header(), command in command(), response in response(), same in any::<bool>(),
    ) {
        let response = match response {
            Response::Reply { state, reply, .. } if same => Response::Reply { header, state, reply },
            other => other,
        };
        let answers = matches!(response, Response::Reply { header: theirs, reply, .. }
            if theirs == header && reply.register() == command.register());
        let mut client = Client::<XArm, MAX_FRAME>::new(Config::TCP);
        client.submit(Request::Call { header, command }).unwrap();
        transmit(&mut client, Micros(0));
        let event = if answers { Event::Answer(response) } else { Event::Unsolicited(response) };
        prop_assert_eq!(hear(&mut client, Micros(1), &bytes_of(&response)), [event]);
        prop_assert_eq!(client.is_idle(), answers);
    }

    #[test]
    fn an_answer_belongs_to_the_call_that_gets_it(
        // How many calls later each answer comes, if it does; 0 is in time.
        delays in vec(prop_oneof![3 => Just(Some(0)), 3 => (0..4_usize).prop_map(Some), 1 => Just(None)], 1..40),
        twice in vec(any::<bool>(), 40),
        skipped in 65_500..65_535_u32,
        repeats in 0..3_u8,
    ) {
        let mut transactions = Transactions::new();
        for _ in 0..skipped {
            transactions.next_id();
        }
        let mut client = Client::<XArm, MAX_FRAME>::new(Config { repeats, ..Config::TCP });
        let mut now = Micros(0);
        let mut answers: Vec<(usize, Response)> = Vec::new();
        for (call, (delay, twice)) in delays.into_iter().zip(twice).enumerate() {
            let header = Header { transaction: transactions.next_id(), protocol: ProtocolId::Private };
            prop_assert_ne!(header.transaction, 0);
            client.submit(Request::Call { header, command: Command::ReadTorqueSource }).unwrap();
            prop_assert!(transmit(&mut client, now) > 0, "held back");
            let answer = Response::Reply {
                header,
                state: State::OK,
                reply: Reply::TorqueSource(TorqueSource::Torque),
            };
            for _ in 0..=u8::from(twice) {
                answers.extend(delay.map(|delay| (call + delay, answer)));
            }
            let mut done = Vec::new();
            for (_, response) in answers.extract_if(.., |(due, _)| *due == call) {
                now = now + Micros(1);
                done.extend(hear(&mut client, now, &bytes_of(&response)));
            }
            while let Some(due) = client.poll_timeout() {
                now = now.max(due);
                done.extend(client.handle(now, &mut Input::Tick));
                transmit(&mut client, now);
            }
            let expected = match delay {
                Some(0) => Event::Answer(answer),
                _ => Event::TimedOut { sends: repeats + 1 },
            };
            let outcomes: Vec<_> = done.into_iter()
                .filter(|event| !matches!(event, Event::Late(_) | Event::Unsolicited(_)))
                .collect();
            prop_assert_eq!(outcomes, [expected]);
        }
    }

    #[test]
    fn the_client_takes_any_bytes_at_any_time(
        steps in vec((vec(XArm::any_noise(), 0..24), 0..500_000_u64, any::<bool>()), 0..40),
        request in request(),
    ) {
        let mut client = Client::<XArm, MAX_FRAME>::new(Config::TCP);
        let mut now = Micros(0);
        let mut broken = None;
        for (bytes, wait, idle) in steps {
            let _ = client.submit(request);
            transmit(&mut client, now);
            now = now + Micros(wait);
            for mut input in [Input::Bytes(&bytes), if idle { Input::Idle } else { Input::Tick }] {
                while let Some(event) = client.handle(now, &mut input) {
                    match event {
                        Event::Broken(noise) => prop_assert_eq!(*broken.get_or_insert(noise), noise),
                        // Said of a heartbeat that was with the line before.
                        Event::Sent => {}
                        _ => prop_assert_eq!(broken, None, "{:?}", event),
                    }
                }
            }
        }
    }

    #[test]
    fn the_device_takes_any_bytes(stream in vec(XArm::any_noise(), 0..600), chunk in 1..40_usize) {
        let mut device = Device::<XArm, MAX_FRAME>::new();
        let mut heard = Vec::new();
        for bytes in stream.chunks(chunk) {
            let mut input = Input::Bytes(bytes);
            heard.extend(std::iter::from_fn(|| device.handle(&mut input)));
        }
        let broken = heard.iter().position(|heard| matches!(heard, Heard::Broken(_)));
        prop_assert!(broken.is_none_or(|i| i + 1 == heard.len()), "{heard:?}");
        // Whatever a good frame says, there is an answer to it that can be sent.
        for heard in heard {
            if let Heard::Unknown(error) = heard {
                let refusal = bytes_of(&error.refusal());
                prop_assert_eq!(XArm::scan(&refusal, Direction::Responses), Scan::Frame(refusal.len()));
            }
        }
    }
}

/// A connection in virtual time, with an arm at its end that answers at once what it is told to.
struct World {
    now: Micros,
    wake: Option<Micros>,
    arm: Device<XArm, MAX_FRAME>,
    requests: Vec<Request>,
    /// What the arm answers, in turn; after that nothing.
    script: VecDeque<(State, Reply)>,
    /// What comes right behind each answer.
    behind: Vec<u8>,
    line: VecDeque<u8>,
}

type Shared = RefCell<World>;

fn world(script: impl IntoIterator<Item = (State, Reply)>) -> Shared {
    RefCell::new(World {
        now: Micros(0),
        wake: None,
        arm: Device::new(),
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
        let world = &mut *self.0.borrow_mut();
        let mut input = Input::Bytes(buf);
        while let Some(heard) = world.arm.handle(&mut input) {
            let Heard::Request(request) = heard else {
                panic!("the arm heard {heard:?}");
            };
            world.requests.push(request);
            if let Request::Call { header, .. } = request
                && let Some((state, reply)) = world.script.pop_front()
            {
                world.line.extend(bytes_of(&Response::Reply { header, state, reply }));
                world.line.extend(&world.behind);
            }
        }
        Ok(buf.len())
    }

    async fn flush(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}

struct VirtualClock<'w>(&'w Shared);

impl Clock for VirtualClock<'_> {
    fn now(&self) -> Micros {
        self.0.borrow().now
    }

    async fn wait_until(&self, instant: Micros) {
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
        world.now = world.wake.take().expect("something to wait for");
    }
}

fn arm(world: &Shared) -> Arm<Port<'_>, VirtualClock<'_>> {
    Arm::new(Port(world), VirtualClock(world), Config::TCP)
}

#[test]
fn every_call_asks_its_own_register_with_an_id_of_its_own_and_gives_the_answer_with_the_state() {
    let text = VersionText::new("6,6,XI1202,AC1302,v1.12.10").unwrap();
    let serials = SerialsText::new("XI120204201B02", "AC130202B02L02").unwrap();
    let radius = RotationRadius::from_metres(0.3).unwrap();
    let joint = Joint::new(6).unwrap();
    let raw = Raw::new(13, &[2]).unwrap();
    let states = [0x00, 0x10, 0x20, 0x40, 0x70, 0x87, 0x01, 0x00].map(State);
    let replies = [
        Reply::Version(text),
        Reply::Serials(serials),
        Reply::Empty(Register::ReloadDynamics),
        Reply::TorqueSource(TorqueSource::Current),
        Reply::RotationRadius(radius),
        Reply::Empty(Register::SystemControl),
        Reply::SystemControl(1),
        Reply::Raw(raw),
    ];
    let world = world(states.into_iter().zip(replies));
    let mut arm = arm(&world);
    run(&world, async {
        let [s1, s2, s3, s4, s5, s6, s7, s8] = states;
        assert_eq!(arm.read_version().await, Ok(Answer { value: text, state: s1 }));
        assert_eq!(
            arm.read_serials().await,
            Ok(Answer {
                value: serials,
                state: s2
            })
        );
        assert_eq!(arm.reload_dynamics().await, Ok(Answer { value: (), state: s3 }));
        let source = TorqueSource::Current;
        assert_eq!(
            arm.read_torque_source().await,
            Ok(Answer {
                value: source,
                state: s4
            })
        );
        assert_eq!(
            arm.read_rotation_radius(joint).await,
            Ok(Answer {
                value: radius,
                state: s5
            })
        );
        assert_eq!(arm.shut_down().await, Ok(Answer { value: (), state: s6 }));
        assert_eq!(arm.reboot().await, Ok(Answer { value: (), state: s7 }));
        arm.set_protocol(ProtocolId::Supervised);
        let ask = Raw::new(13, &[]).unwrap();
        assert_eq!(arm.raw(ask).await, Ok(Answer { value: raw, state: s8 }));
        assert_eq!(arm.heartbeat().await, Ok(()));
    });
    let commands = [
        Command::ReadVersion,
        Command::ReadSerials,
        Command::ReloadDynamics,
        Command::ReadTorqueSource,
        Command::ReadRotationRadius(joint),
        Command::Shutdown,
        Command::Reboot,
        Command::Raw(Raw::new(13, &[]).unwrap()),
    ];
    let calls = (1..).zip(commands).map(|(transaction, command)| {
        let protocol = if transaction < 8 {
            ProtocolId::Private
        } else {
            ProtocolId::Supervised
        };
        Request::Call {
            header: Header { transaction, protocol },
            command,
        }
    });
    let expected: Vec<_> = calls.chain([Request::Heartbeat]).collect();
    assert_eq!(world.borrow().requests, expected);
    assert_eq!(arm.counters(), Default::default());
}

#[test]
fn a_refusal_or_an_answer_without_what_was_asked_for_is_an_error_with_the_state() {
    let invalid = State::INVALID | State::ERROR;
    let text = VersionText::new("6,6,XI1202,AC1302,v1.12.10").unwrap();
    let world = world([
        (invalid, Reply::Empty(Register::Version)),
        (invalid, Reply::Version(text)),
        (State::ERROR, Reply::Empty(Register::Version)),
        (State::INVALID, Reply::Empty(Register::SystemControl)),
        (State::INVALID, Reply::empty(77)),
    ]);
    let mut arm = arm(&world);
    run(&world, async {
        for state in [invalid, invalid, State::ERROR] {
            assert_eq!(arm.read_version().await, Err(ArmError::Refused(state)));
        }
        let refused = ArmError::Refused(State::INVALID);
        assert_eq!(arm.shut_down().await, Err(refused));
        assert_eq!(arm.raw(Raw::new(77, &[]).unwrap()).await, Err(refused));
        assert_eq!(refused.to_string(), "the arm refused, its state: invalid");
    });
}

#[test]
fn an_arm_that_is_silent_is_waited_for_as_the_vendor_s_package_does_and_asked_once() {
    let world = world([]);
    let mut arm = arm(&world);
    let silence = Err(ArmError::Call(CallError::TimedOut { sends: 1 }));
    assert_eq!(run(&world, arm.read_version()), silence);
    let waited = world.borrow().now;
    assert!(
        (Micros::from_millis(2_000)..Micros::from_millis(2_200)).contains(&waited),
        "{waited:?}"
    );
    assert_eq!(world.borrow().requests.len(), 1);
}

#[test]
fn a_broken_connection_ends_this_call_and_every_later_one_with_where_it_broke() {
    let text = VersionText::new("6,6,XI1202,AC1302,v1.12.10").unwrap();
    let world = world([(State::OK, Reply::Version(text))]);
    let mut arm = arm(&world);
    world.borrow_mut().line.extend([0, 1, 0, 9]);
    let reason = Reason::Byte {
        offset: 3,
        expected: &[0, 1, 2, 3],
        got: 9,
    };
    let broken = ArmError::Call(CallError::Broken(Noise {
        offset: 0,
        len: 4,
        reason,
    }));
    for _ in 0..3 {
        assert_eq!(run(&world, arm.read_version()), Err(broken));
    }
    assert_eq!(
        broken.to_string(),
        "the connection is broken: 4 bytes at 0: byte 3 is 0x09, expected 0x00 or 0x01 or 0x02 or 0x03"
    );
}

#[test]
fn an_answer_that_comes_with_the_break_is_given_and_the_next_call_fails() {
    let text = VersionText::new("6,6,XI1202,AC1302,v1.12.10").unwrap();
    let state = State::OK;
    let world = world([(state, Reply::Version(text))]);
    world.borrow_mut().behind.extend([0, 2, 0, 9]);
    let mut arm = arm(&world);
    assert_eq!(run(&world, arm.read_version()), Ok(Answer { value: text, state }));
    let error = run(&world, arm.read_version()).unwrap_err();
    assert!(matches!(error, ArmError::Call(CallError::Broken(_))), "{error}");
    let noise = std::error::Error::source(&error).and_then(|source| source.downcast_ref::<Noise>());
    assert_eq!(noise.map(|noise| noise.offset), Some(48));
}

#[test]
fn a_reply_too_long_and_a_strange_heartbeat_are_skipped_and_the_answer_behind_them_is_given() {
    let header = Header {
        transaction: 1,
        protocol: ProtocolId::Private,
    };
    let answer = Response::Reply {
        header,
        state: State::OK,
        reply: Reply::TorqueSource(TorqueSource::Current),
    };
    let heartbeat = [0, 7, 0, 1, 0, 2, 0, 0];
    let mut long = vec![0, 1, 0, 2, 1, 44];
    long.resize(HEADER + 300, 0);
    for chunk in [1, 7, 260, 1_000] {
        let mut client = Client::<XArm, MAX_FRAME>::new(Config::TCP);
        let command = Command::ReadTorqueSource;
        client.submit(Request::Call { header, command }).unwrap();
        transmit(&mut client, Micros(0));
        let stream = [&heartbeat[..], &long, &bytes_of(&answer)].concat();
        let events: Vec<_> = stream
            .chunks(chunk)
            .flat_map(|bytes| hear(&mut client, Micros(1), bytes))
            .collect();
        let noise = |offset, len, reason| Event::Noise(Noise { offset, len, reason });
        let expected = &[0];
        let strange = Reason::Byte {
            offset: 1,
            expected,
            got: 7,
        };
        let too_long = Reason::Length {
            min: 2,
            max: 254,
            got: 300,
        };
        let expected = [noise(0, 8, strange), noise(8, 306, too_long), Event::Answer(answer)];
        assert_eq!(events, expected, "by {chunk}");
    }
}

#[test]
fn a_device_skips_a_request_too_long_and_hears_the_next() {
    let mut long = vec![0, 1, 0, 2, 1, 44];
    long.resize(HEADER + 300, 0);
    let mut device = Device::<XArm, MAX_FRAME>::new();
    let stream = [&long[..], &HEARTBEAT].concat();
    let mut input = Input::Bytes(&stream);
    let heard: Vec<_> = std::iter::from_fn(|| device.handle(&mut input)).collect();
    assert!(
        matches!(
            heard[..],
            [Heard::Noise(Noise { len: 306, .. }), Heard::Request(Request::Heartbeat)]
        ),
        "{heard:?}"
    );
}

#[test]
fn a_decoder_needs_no_more_than_what_is_left_of_what_it_skips() {
    let mut decoder = Decoder::<XArm, MAX_FRAME>::new();
    assert!(decoder.push(&[0, 1, 0, 2, 1, 44, 0, 0]).is_empty());
    assert!(decoder.next(Direction::Responses).is_none());
    assert_eq!(decoder.need(Direction::Responses), 298);
    assert_eq!(decoder.pending(), 0, "what is skipped is not kept");
    assert_eq!(decoder.push(&[0; 250]).len(), 0);
    assert!(decoder.next(Direction::Responses).is_none());
    assert_eq!(decoder.need(Direction::Responses), 48);
    assert_eq!(decoder.push(&[0; 48]).len(), 0);
    assert_eq!(decoder.need(Direction::Responses), 0);
    let noise = decoder.next(Direction::Responses).unwrap().unwrap_err();
    assert_eq!((noise.offset, noise.len), (0, 306));
}
