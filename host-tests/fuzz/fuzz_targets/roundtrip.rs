//! Every message survives an encode and a decode: those of every protocol, of the control port, and the cyclic frames
//! on CAN. A buffer one byte too short is refused.
#![no_main]

use core::fmt::{Debug, Display};
use core::time::Duration;

use armwire::alpha1::{self, Alpha1, Angle, Interval, MoveTime, Offset, ServoId, ServoStates, Text, hid};
use armwire::decoder::Kind as Item;
use armwire::framing::{Framing, Scan};
use armwire::ling::arrival::{Arrival, Arrived, Tolerances};
use armwire::ling::effect::{Effect, EffectError, Output, ReadBack, Verdict};
use armwire::ling::legacy::{self, Legacy};
use armwire::ling::mode_change;
use armwire::ling::stop::{self, StopError, Stopped};
use armwire::ling::{
    self, ControlMode, GripperSpeed, JointState, Kind, Ling, ModeChange, ModeReply, ModeResult, ModeState,
    MotionStatus, Move, Opening, PerServo, Position, Request, SelfCheck, SerialNumber, Speed, Stop, Stroke,
    TemperatureLimit, Torque, Version,
};
use armwire::time::Instant;
use armwire::xarm::{self, Codes, Raw, Reply, RotationRadius, SerialsText, State, VersionText, XArm};
use armwire::{BufferTooShort, EncodeError, OutOfRange};
use armwire_bridge::can::command::Command;
use armwire_bridge::can::telemetry::{Errors, Sample, event_from_frame, event_to_frame};
use armwire_bridge::can::{Frame, Id, Node};
use armwire_bridge::config::Config;
use armwire_bridge::control::{
    Event, FromAdapter, FromHost, Histogram, MAX_COBS, MAX_MESSAGE, Message, Reader, Stamp, decode, encode, encode_cobs,
};
use armwire_bridge::isotp::SeparationTime;
use armwire_bridge::time;
use armwire_bridge::{Counters, LineCoding, UnsupportedCoding};
use armwire_fuzz::line::{LineDecoder, Span};
use armwire_fuzz::{Check, Result, Subject, Unstructured, request_bytes, response_bytes};
use armwire_host_tests::reference;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|input: &[u8]| {
    let mut u = Unstructured::new(input);
    while !u.is_empty() {
        // The rest may be too short for another message.
        let Ok(()) = one(&mut u) else { return };
    }
});

fn one(u: &mut Unstructured<'_>) -> Result<()> {
    match u.arbitrary::<u8>()? % 10 {
        0 => control_messages(u),
        1 => cyclic_frames(u),
        2 => values(u),
        3 => Messages::check::<Ling, { ling::MAX_FRAME }>(u),
        4 => Messages::check::<Alpha1, { alpha1::MAX_FRAME }>(u),
        5 => Messages::check::<XArm, { xarm::MAX_FRAME }>(u),
        6 => Messages::check::<Legacy, { legacy::MAX_FRAME }>(u),
        7 => frames(u),
        8 => adapter_values(u),
        _ => texts(u),
    }
}

struct Messages;

impl Check for Messages {
    fn check<P: Subject, const N: usize>(u: &mut Unstructured<'_>) -> Result<()> {
        let protocol = P::any_protocol(u)?;
        if P::HAS_REQUESTS && u.arbitrary()? {
            let request = P::any_request(u)?;
            let bytes = request_bytes(protocol, &request);
            let expect = protocol.requests();
            assert_eq!(protocol.scan(&bytes, expect), Scan::Frame(bytes.len()));
            let read = protocol.parse_request(&bytes).expect("it was written");
            assert_eq!(format!("{read:?}"), format!("{request:?}"));
            check_short_buffer(bytes.len(), |out| protocol.encode_request(&request, out));
            check_text(&request);
            // A frame and the padding of its last report.
            if P::PADDING == Some(0) {
                let reports: Vec<u8> = hid::reports(&bytes).flatten().collect();
                let mut decoder = LineDecoder::<P, N>::new(expect);
                decoder.on_bytes(&reports);
                let span = |range, kind| Span { range, kind };
                let mut expected = vec![span(0..bytes.len(), Item::Frame)];
                if reports.len() > bytes.len() {
                    expected.push(span(bytes.len()..reports.len(), Item::Padding));
                }
                assert_eq!(reports.len() % hid::REPORT, 0);
                assert_eq!(decoder.received, expected);
            }
        } else {
            let any = P::any_response(u)?;
            let bytes = response_bytes(protocol, &any.response, any.to);
            assert_eq!(protocol.scan_idle(&bytes, any.expect), Scan::Frame(bytes.len()));
            let read = protocol.parse_response(&bytes, any.expect).expect("it was written");
            assert_eq!(format!("{read:?}"), format!("{:?}", any.response));
            if let Some(key) = any.to {
                assert!(protocol.is_response_to(key, &bytes));
            }
            check_short_buffer(bytes.len(), |out| protocol.encode_response(&any.response, any.to, out));
            check_text(&any.response);
            P::check_values(&any.response);
        }
        Ok(())
    }
}

/// Checks that the text of a message has no control characters, whatever its bytes are.
fn check_text(message: &impl Display) {
    let text = message.to_string();
    assert!(!text.is_empty() && !text.contains(char::is_control), "{text:?}");
}

/// Checks that a buffer one byte too short for a message of this length is refused.
fn check_short_buffer<E: Into<EncodeError>>(len: usize, encode: impl Fn(&mut [u8]) -> core::result::Result<usize, E>) {
    let error = encode(&mut vec![0; len - 1]).expect_err("it is too short").into();
    let (needed, got) = (len, len - 1);
    assert_eq!(error, EncodeError::BufferTooShort(BufferTooShort { needed, got }));
    assert!(!error.to_string().is_empty());
}

fn control_messages(u: &mut Unstructured<'_>) -> Result<()> {
    control_message(&u.arbitrary::<FromHost>()?);
    control_message(&u.arbitrary::<FromAdapter>()?);
    let config: Config = u.arbitrary()?;
    match config.check() {
        Ok(()) => assert!(config.can.telemetry_hz <= config.can.max_telemetry_hz()),
        Err(error) => assert!(!error.to_string().is_empty()),
    }
    Ok(())
}

fn control_message<T: Message + PartialEq + Debug>(message: &T) {
    let mut bytes = [0; MAX_MESSAGE];
    let len = encode(message, &mut bytes).expect("it is not too long");
    assert_eq!(decode::<T>(&bytes[..len]).as_ref(), Ok(message));
    assert!(encode(message, &mut vec![0; len - 1]).is_err());
    // The identity of an older version has no fact about CAN.
    let is_cut = decode::<T>(&bytes[..len - 1]).is_err();
    assert!(is_cut || message.may_lack(1), "the end of it is not needed");

    let mut bytes = [0; MAX_COBS];
    let len = encode_cobs(message, &mut bytes).expect("it is not too long");
    assert_eq!(bytes[..len].iter().position(|byte| *byte == 0), Some(len - 1));
    assert!(encode_cobs(message, &mut vec![0; len - 1]).is_err());
    let mut reader = Reader::<MAX_MESSAGE>::new();
    assert!(reader.push(&bytes[..len]).is_empty());
    let read = reader.next::<T>().expect("the message is complete");
    assert_eq!(read.as_ref(), Ok(message));
}

fn cyclic_frames(u: &mut Unstructured<'_>) -> Result<()> {
    let (node, sample, errors): (Node, Sample, Errors) = u.arbitrary()?;
    assert_eq!(Sample::from_frames(&sample.to_frames(node)), Some(sample));
    assert_eq!(Errors::from_frame(&errors.to_frame(node)), Some(errors));
    let (event, at): (Event, Stamp) = u.arbitrary()?;
    if let Some(frame) = event_to_frame(&event, at, node) {
        assert_eq!(event_from_frame(&frame), Some((at.0 as u32, event)));
    }
    let command: Command = u.arbitrary()?;
    let in_range = (3..=250).contains(&command.speed)
        && command.gripper <= 250
        && command.joints.iter().all(|&ticks| ticks <= Position::MAX.ticks());
    assert_eq!(command.target().is_ok(), in_range);

    // Any other frame is refused, or encodes to the same frame.
    let Ok(id) = Id::new(u.arbitrary::<u16>()? & 0xFFF) else {
        return Ok(());
    };
    let Ok(frame) = Frame::new(id, u.arbitrary()?) else {
        return Ok(());
    };
    let node = Node::new(id.get() as u8 & 15).expect("in range");
    if let Some(errors) = Errors::from_frame(&frame) {
        assert_eq!(errors.to_frame(node), frame);
    }
    if let Some((stamp, event)) = event_from_frame(&frame) {
        assert_eq!(event_to_frame(&event, Stamp(stamp.into()), node), Some(frame));
    }
    assert!(Sample::from_frames(&[frame; 3]).is_none());
    Ok(())
}

fn values(u: &mut Unstructured<'_>) -> Result<()> {
    let number = f32::from_bits(u.arbitrary()?);
    if let Ok(position) = Position::from_radians(number) {
        assert!(
            (position.radians() - number).abs() < 0.0008,
            "{number} rad is {position:?}"
        );
    }
    if let Ok(speed) = Speed::from_radians_per_second(number) {
        assert!(
            (speed.radians_per_second() - number).abs() < 0.0008,
            "{number} rad/s is {speed:?}"
        );
    }
    if let Ok(opening) = Opening::from_fraction(number) {
        assert!((opening.fraction() - number).abs() < 0.0006);
    }
    for stroke in [Stroke::Mm50, Stroke::Mm75, Stroke::Mm100] {
        if let Ok(opening) = Opening::from_millimetres(number, stroke) {
            assert!((opening.millimetres(stroke) - number).abs() < 0.06);
        }
    }
    if let Ok(position) = Position::new(u.arbitrary()?) {
        assert_eq!(Position::from_radians(position.radians()), Ok(position));
    }
    if let Ok(speed) = Speed::new(u.arbitrary()?) {
        assert_eq!(Speed::from_radians_per_second(speed.radians_per_second()), Ok(speed));
    }
    let byte = u.arbitrary()?;
    let gap = SeparationTime::from_byte(byte);
    assert!(gap.to_byte() == byte || gap.duration().as_micros() == 127_000);
    let mut cdc: [u8; 7] = u.arbitrary()?;
    if u.arbitrary()? {
        // A valid baud rate, and often a valid coding.
        cdc[..4].copy_from_slice(&115_200_u32.to_le_bytes());
        cdc[4..].iter_mut().for_each(|byte| *byte %= 9);
    }
    match LineCoding::from_cdc(cdc) {
        Ok(coding) => assert_eq!(coding.to_cdc(), cdc),
        Err(refused) => {
            let name = match refused {
                UnsupportedCoding::Baud(_) => "baud",
                UnsupportedCoding::DataBits(_) => "data bits",
                UnsupportedCoding::Parity(_) => "parity",
                UnsupportedCoding::StopBits(_) => "stop bits",
                other => panic!("a new reason has no word here: {other}"),
            };
            assert!(refused.to_string().contains(name));
        }
    }
    Ok(())
}

/// Displayed texts, and the values that protocols keep unchanged.
fn texts(u: &mut Unstructured<'_>) -> Result<()> {
    let bytes: &[u8] = u.arbitrary()?;
    if let Ok(text) = Text::new(bytes) {
        assert_eq!(text.as_bytes(), bytes);
        assert!(text.as_str().is_none_or(|shown| shown.as_bytes() == bytes));
        assert!(text.to_string().is_ascii());
    }
    let shown = String::from_utf8_lossy(bytes);
    let (left, right) = shown.split_at(shown.floor_char_boundary(shown.len() / 2));
    if let Ok(text) = SerialsText::encode(left, right) {
        let serials = SerialsText(&text);
        assert_eq!((serials.arm(), serials.control_box()), (Some(left), Some(right)));
        assert!(serials.to_string().is_ascii());
    }
    let (axes, [major, minor, patch]) = (u.arbitrary::<u8>()?, u.arbitrary::<[u16; 3]>()?);
    let text = format!("{axes},5,{left},{right},v{major}.{minor}.{patch}");
    if let Ok(text) = VersionText::encode(&text)
        && let Ok(version) = VersionText(&text).version()
    {
        assert_eq!((version.axes, version.arm, version.control_box), (axes, left, right));
        assert_eq!(version.firmware_numbers(), Some([major, minor, patch]));
    }
    let text = VersionText(bytes);
    assert!(text.to_string().is_ascii() && SerialsText(bytes).to_string().is_ascii());
    match text.version() {
        Ok(version) => {
            let _ = version.firmware_numbers();
        }
        Err(error) => assert!(!error.to_string().is_empty()),
    }
    let serial = SerialNumber(u.arbitrary()?);
    assert!(serial.as_str().is_none_or(|text| serial.0.starts_with(text.as_bytes())));
    assert!(serial.to_string().is_ascii());
    assert!(serial.kind().is_none_or(|kind| [6, 10].contains(&kind.servos())));
    let check = SelfCheck(u.arbitrary()?);
    // One bit per servo, 1 is normal: a leader has 6, a follower 10.
    for (kind, servos) in [(Kind::Leader, 0x03F), (Kind::Follower, 0x3FF)] {
        assert_eq!(check.all_normal(kind), check.0 & servos == servos);
        let faulty = check.faulty(kind).map(|id| 1 << (id - 1));
        assert_eq!(faulty.sum::<u16>(), !check.0 & servos);
    }
    let servos = PerServo::Leader(u.arbitrary::<[u8; 6]>()?);
    assert_eq!(servos.as_slice().len(), servos.kind().servos());
    assert!(!Version(u.arbitrary()?).to_string().is_empty());
    let state = State(u.arbitrary()?);
    assert!(!(state | State::ERROR).to_string().is_empty() && (state | State::ERROR).contains(state));
    let states = ServoStates::from_bits(u.arbitrary()?);
    assert_eq!(states.running().count() as u32, states.bits().count_ones());
    let servo: u8 = u.arbitrary()?;
    let is_running = states.running().any(|running| running == servo);
    assert_eq!(
        is_running,
        (1..=32).contains(&servo) && states.bits() >> (servo - 1) & 1 == 1
    );
    let time = Duration::from_millis(u.arbitrary::<u32>()?.into());
    if let Ok(taken) = MoveTime::from_duration(time) {
        assert!(taken.duration().abs_diff(time) <= Duration::from_millis(10));
        assert_eq!(MoveTime::from_duration(taken.duration()), Ok(taken));
    }
    if let Ok(taken) = Interval::from_duration(time) {
        assert!(taken.duration().abs_diff(time) <= Duration::from_millis(10));
        assert_eq!(Interval::from_duration(taken.duration()), Ok(taken));
    }
    match Offset::new(u.arbitrary()?) {
        Ok(offset) => assert!((-30.0..=30.0).contains(&offset.degrees())),
        Err(error) => assert!(!error.to_string().is_empty()),
    }
    if let Ok(radius) = RotationRadius::from_metres(f32::from_bits(u.arbitrary()?)) {
        assert!(radius.metres().is_ok() || radius.millimetres > 99_999.0);
    }
    Ok(())
}

/// A decoded frame encodes to the same bytes. A Ling frame is encoded only if the decoder accepts it.
fn frames(u: &mut Unstructured<'_>) -> Result<()> {
    let kind: u8 = u.arbitrary()?;
    let (command, function, wide) = (u.arbitrary()?, u.arbitrary()?, u.arbitrary::<u16>()?);
    let data: &[u8] = u.arbitrary()?;
    match kind % 4 {
        0 => {
            let frame = ling::Frame {
                command,
                function,
                data,
            };
            let mut out = [0; ling::MAX_FRAME];
            match frame.encode(&mut out) {
                Ok(len) => {
                    assert_eq!(Ling.scan(&out[..len], ()), Scan::Frame(len));
                    assert_eq!(ling::Frame::parse(&out[..len]), Some(frame));
                }
                Err(error) => assert!(!error.to_string().is_empty()),
            }
        }
        1 => {
            let headers = [0xF1, 0xEF, 0xF2, 0xF5, 0xFB, 0xF4, 0xF9, 0xF3, 0xFA, 0xFC];
            let command = headers.get(usize::from(command % 16)).copied().unwrap_or(command);
            read::<Alpha1>(&reference::alpha1::frame(command, data), Alpha1::any_expect(u)?);
        }
        2 => read::<Alpha1>(&[command], Alpha1::any_expect(u)?),
        _ => {
            let bytes = reference::xarm::frame(wide, u16::from(function) % 5, data);
            read::<XArm>(&bytes, XArm::any_expect(u)?);
        }
    }
    match Raw::new(command, data) {
        Ok(raw) => assert_eq!((raw.register(), raw.params()), (command, data)),
        Err(error) => assert!(!error.to_string().is_empty()),
    }
    Ok(())
}

fn read<P: Subject>(bytes: &[u8], expect: P::Expect) {
    if P::default().scan_idle(bytes, expect) == Scan::Frame(bytes.len()) {
        assert_eq!(P::rewrite(bytes), bytes);
    }
}

/// Values of the adapter, and their texts.
fn adapter_values(u: &mut Unstructured<'_>) -> Result<()> {
    let (event, byte): (Event, u8) = u.arbitrary()?;
    if let Event::Refused { initiator, reason } = event {
        assert!(!format!("{initiator}{reason}").is_empty());
    }
    let bucket = usize::from(byte % 20);
    assert_eq!(Histogram::limit(bucket).is_some(), bucket < Histogram::BUCKETS - 1);
    if let Some(limit) = Histogram::limit(bucket) {
        let mut histogram = Histogram::default();
        histogram.add(time::Duration::from_micros(limit.as_micros() - 1));
        assert_eq!(histogram.counts[bucket], 1);
    }
    let mut counters = Counters::default();
    (counters.frames, counters.noise_bytes) = u.arbitrary()?;
    let mut room = [0; Counters::MAX_LEN];
    let bytes = counters.to_bytes(&mut room).expect("there is room");
    assert_eq!(Counters::from_bytes(bytes), Ok(counters));
    match SeparationTime::from_millis(byte) {
        Ok(gap) => assert_eq!(gap.duration(), time::Duration::from_millis(byte.into())),
        Err(error) => assert!(byte > 127 && !error.to_string().is_empty()),
    }
    match SeparationTime::from_hundreds_of_micros(byte) {
        Ok(gap) => assert_eq!(
            (gap.duration(), gap),
            (
                time::Duration::from_micros(u64::from(byte) * 100),
                SeparationTime::from_byte(gap.to_byte())
            )
        ),
        Err(error) => assert!(!(1..=9).contains(&byte) && !error.to_string().is_empty()),
    }
    let (id, data): (u16, &[u8]) = u.arbitrary()?;
    match Id::new(id) {
        Ok(id) => {
            for (frame, is_fd) in [(Frame::new(id, data), false), (Frame::new_fd(id, data), true)] {
                match frame {
                    Ok(frame) => {
                        assert_eq!((frame.id(), frame.data(), frame.is_fd()), (id, data, is_fd));
                        assert!(format!("{frame:?}").starts_with(&id.to_string()));
                    }
                    Err(error) => assert!(!error.to_string().is_empty()),
                }
            }
        }
        Err(error) => assert!(!error.to_string().is_empty()),
    }
    let state: JointState = u.arbitrary()?;
    assert!(!state.status.to_string().is_empty());
    for status in [0x00, 0x01, 0xE1].map(MotionStatus::from) {
        let zero = JointState {
            joints: [2048; 6],
            ..state
        };
        for state in [state, zero] {
            read_backs(&JointState { status, ..state });
        }
    }
    arrivals(&state);
    stops(&state);
    foreigners(&state);
    assert_eq!(
        state.positions().is_ok(),
        state.joints.iter().all(|&ticks| ticks < 4096)
    );
    assert_eq!(state.opening().is_ok(), state.gripper <= 1000);
    let legacy_hint = legacy::JointState {
        firmware: legacy::Firmware::V5,
        servos: u.arbitrary()?,
    };
    let older_good = legacy_hint.joints().iter().all(|&ticks| ticks < 4096);
    assert_eq!(legacy_hint.positions().is_ok(), older_good);
    match (ServoId::new(byte), Angle::new(byte), TemperatureLimit::new(byte)) {
        (Ok(servo), Ok(angle), Ok(limit)) => {
            assert_eq!(
                (servo.get(), angle.degrees(), limit.celsius()),
                (byte, Some(byte), byte)
            );
        }
        (servo, angle, limit) => {
            let errors = [servo.err(), angle.err(), limit.err()];
            for error in errors.into_iter().flatten() {
                assert!(OutOfRange::<f32>::from(error).to_string().contains(&byte.to_string()));
            }
        }
    }
    mode_changes(u.arbitrary()?, u.arbitrary()?);
    codes(byte);
    Ok(())
}

/// The end of each read-back is that of its readings, which are all the same or missing.
fn read_backs(state: &JointState) {
    let effects = [Effect::Torque(Torque::On), Effect::Torque(Torque::Off), Effect::Zero];
    for (effect, answers) in effects.into_iter().flat_map(|effect| [(effect, false), (effect, true)]) {
        let mut read_back = ReadBack::new(effect);
        let mut now = Instant::ZERO;
        let end = loop {
            match read_back.poll(now) {
                Output::Request(Request::ReadJoints) if answers => read_back.on_joints(now, state),
                Output::Request(_) => {}
                Output::Wait(until) => now = until,
                Output::Done(end) => break end,
            }
        };
        assert!(now <= Instant::from_millis(700), "{now:?}");
        match (end, effect.verdict(state)) {
            (Ok(outcome), verdict) => {
                assert!(
                    answers && outcome.is_shown == (verdict == Verdict::Confirmed) && verdict != Verdict::Contradicted
                );
                assert!(!outcome.to_string().is_empty());
            }
            (Err(error), verdict) => {
                let is_missing = matches!(error, EffectError::NoReading(_));
                assert!(is_missing != answers && (is_missing || verdict == Verdict::Contradicted));
                assert!(!error.to_string().is_empty());
            }
        }
    }
}

/// A stop of an arm that stands ends there, whatever is known of its goal.
fn stops(state: &JointState) {
    let mut stops = vec![Stop::new(None)];
    if let (Ok(positions), Ok(opening)) = (state.positions(), state.opening()) {
        let here = Move {
            joints: positions.map(|position| (position, Speed::MAX)),
            gripper: (opening, GripperSpeed(1000)),
        };
        stops.extend([Stop::after(&here), Stop::at(here)]);
    }
    for mut stop in stops {
        let mut now = Instant::ZERO;
        let stopped = loop {
            match stop.poll(now) {
                stop::Output::Request(Request::ReadJoints) => stop.on_joints(now, state),
                stop::Output::Request(_) => {}
                stop::Output::Wait(until) => now = until,
                stop::Output::Done(result) => break result,
            }
        };
        match stopped {
            Ok(Stopped::AtRest { deviations, .. }) => assert!(deviations.are_small()),
            Ok(Stopped::WithoutTorque(_)) => assert!(state.status.is_torque_off()),
            Err(error) => assert!(matches!(error, StopError::Position(_)) && state.positions().is_err()),
        }
    }
}

/// The codes of an xArm are read from its answer, and each has its number in its text.
fn codes(byte: u8) {
    for (error, warning) in [(byte, 0), (0, byte), (31, byte), (byte, 11)] {
        let params = [error, warning];
        let raw = Raw::new(Codes::REGISTER, &params).expect("two parameters fit");
        let codes = Codes::try_from(Reply::Raw(raw)).expect("it is their register");
        assert_eq!((codes.error.0, codes.warning.0), (error, warning));
        let text = codes.to_string();
        assert!(
            [error, warning]
                .iter()
                .all(|code| *code == 0 || text.contains(&code.to_string()))
        );
        let is_meant = codes.error.meaning().is_some() || codes.warning.meaning().is_some();
        assert_eq!(text.contains('('), is_meant, "{text}");
        let other = Codes::try_from(Reply::SystemControl(1)).unwrap_err();
        assert!(!other.to_string().is_empty());
    }
}

/// The end of each change of the mode is that of its answer and readings, which are all the same or missing.
fn mode_changes(state: ModeState, reply: ModeReply) {
    for mode in [ControlMode::Position, ControlMode::Current] {
        for (is_accepted, answers) in [(true, true), (true, false), (false, true), (false, false)] {
            let result = if is_accepted {
                ModeResult::Accepted
            } else {
                reply.result
            };
            let requested = if is_accepted { mode as u8 } else { reply.requested };
            let mut change = ModeChange::new(mode);
            let mut now = Instant::ZERO;
            let end = loop {
                match change.poll(now) {
                    mode_change::Output::Request(Request::ReadMode) if answers => {
                        now += armwire::time::Duration::from_millis(1);
                        change.on_mode(now, &state);
                    }
                    mode_change::Output::Request(Request::SetMode(sent)) => {
                        assert_eq!(sent, change.mode());
                        change.on_reply(&ModeReply { requested, result });
                    }
                    mode_change::Output::Request(_) => {}
                    mode_change::Output::Wait(until) => now = until,
                    mode_change::Output::Done(end) => break end,
                }
            };
            let is_refused = requested == mode as u8 && result != ModeResult::Accepted;
            match end {
                Ok(applied) => assert!(answers && applied.mode == mode && !is_refused),
                Err(error) => {
                    assert!(is_refused || !answers || state.mode != mode);
                    assert!(!error.to_string().is_empty());
                }
            }
        }
    }
}

/// An answer of another length than an Alicia-D's has no pose.
fn foreigners(state: &JointState) {
    for data_bytes in [0, 14, 15, 16, 17, 33, 255] {
        let status = MotionStatus::of_answer(state.status.into(), data_bytes);
        let refusal = status.check_motion().map_err(|reason| reason.to_string());
        if (15..=16).contains(&data_bytes) {
            assert_eq!(u8::from(status), u8::from(state.status));
            continue;
        }
        let state = JointState { status, ..*state };
        assert!(refusal.unwrap_err().contains("not an Alicia-D"));
        assert!(state.positions().is_err() && state.opening().is_err());
        assert!(status.is_holding().is_none() && status.to_string().contains("data bytes"));
    }
}

/// An arm at rest is at the target of a move to its pose, and elsewhere after that of another, which is sent twice.
fn arrivals(state: &JointState) {
    let (Ok(positions), Ok(opening)) = (state.positions(), state.opening()) else {
        return;
    };
    let mut target = Move {
        joints: positions.map(|position| (position, Speed::MAX)),
        gripper: (opening, GripperSpeed(1000)),
    };
    let arrive = |target| {
        let mut arrival = Arrival::new(target, Tolerances::MOVE);
        let arrived = (0..100).map(|n| arrival.on_joints(Instant::from_millis(20 * n), state));
        arrived
            .filter(|arrived| !matches!(arrived, Arrived::NotYet(_)))
            .take(2)
            .collect::<Vec<_>>()
    };
    assert!(matches!(arrive(target)[0], Arrived::AtTarget(deviations) if deviations.are_small()));
    target.joints[1].0 = if positions[1].ticks() < 2048 {
        Position::MAX
    } else {
        Position::new(0).expect("in range")
    };
    target.gripper.0 = if state.gripper < 500 {
        Opening::OPEN
    } else {
        Opening::CLOSED
    };
    let [Arrived::Resend, Arrived::Elsewhere(away)] = arrive(target)[..] else {
        panic!("it is elsewhere")
    };
    assert!(!away.is_gripper_only() && away.to_string().contains("joint 2"));
    assert!(target.deviations(state).to_string().contains("joint 2 rests"));
}
