//! Every example frame of the page, and the frames it should have printed.

extern crate std;

use std::vec::Vec;

use super::frame::HEARTBEAT_ID;
use super::*;
use crate::{
    Client, Config, Decoder, Device, EncodeError, Event, Framing, Heard, Input, Micros, Protocol, Reason, Scan,
};

/// A frame written in hex.
fn hex(text: &str) -> Vec<u8> {
    text.split_whitespace()
        .map(|byte| u8::from_str_radix(byte, 16).unwrap())
        .collect()
}

const FIRST: Header = Header {
    transaction: 1,
    protocol: ProtocolId::Private,
};

const SUPERVISED: Header = Header {
    transaction: 1,
    protocol: ProtocolId::Supervised,
};

fn call(command: Command) -> Request {
    Request::Call { header: FIRST, command }
}

fn reply(state: State, reply: Reply) -> Response {
    Response::Reply {
        header: FIRST,
        state,
        reply,
    }
}

/// Register, frame, meaning. In the order of the page; those marked *computed* are not printed there.
fn requests() -> Vec<(&'static str, Vec<u8>, Request)> {
    let joint = Joint::new(6).unwrap();
    Vec::from([
        ("1", hex("00 01 00 02 00 01 01"), call(Command::ReadVersion)),
        ("2", hex("00 01 00 02 00 01 02"), call(Command::ReadSerials)),
        ("4", hex("00 01 00 02 00 01 04"), call(Command::ReloadDynamics)),
        ("5", hex("00 01 00 02 00 01 05"), call(Command::ReadTorqueSource)),
        (
            "6",
            hex("00 01 00 02 00 02 06 06"),
            call(Command::ReadRotationRadius(joint)),
        ),
        ("10 shut down", hex("00 01 00 02 00 02 0A 01"), call(Command::Shutdown)),
        (
            "10 reboot, computed",
            hex("00 01 00 02 00 02 0A 02"),
            call(Command::Reboot),
        ),
        (
            "1 in protocol 3, computed",
            hex("00 01 00 03 00 01 01"),
            Request::Call {
                header: SUPERVISED,
                command: Command::ReadVersion,
            },
        ),
        (
            "19, computed",
            hex("00 01 00 02 00 02 13 01"),
            call(Command::Raw(Raw::new(19, &[1]).unwrap())),
        ),
        (
            "heartbeat, computed",
            hex("00 00 00 01 00 02 00 00"),
            Request::Heartbeat,
        ),
    ])
}

/// The same; register 10 stands as the vendor's published page has it, its printed form is a test of its own.
fn responses() -> Vec<(&'static str, Vec<u8>, Response)> {
    let version = "36 2C 36 2C 58 49 31 32 30 32 2C 41 43 31 33 30 32 2C 76 31 2E 31 32 2E 31 30 \
                   00 00 00 00 00 00 00 00 00 00 00 00 00 00";
    let serials = "58 49 31 32 30 32 30 34 32 30 31 42 30 32 00 41 43 31 33 30 32 30 32 42 30 32 4C 30 32 0A \
                   00 00 00 00 00 00 00 00 00 00";
    let version_text = VersionText::new("6,6,XI1202,AC1302,v1.12.10").unwrap();
    let serials_text = SerialsText::new("XI120204201B02", "AC130202B02L02").unwrap();
    let empty = Reply::Empty;
    Vec::from([
        (
            "1",
            hex(&std::format!("00 01 00 02 00 2A 01 00 {version}")),
            reply(State::OK, Reply::Version(version_text)),
        ),
        (
            "2",
            hex(&std::format!("00 01 00 02 00 2A 02 00 {serials}")),
            reply(State::OK, Reply::Serials(serials_text)),
        ),
        (
            "4",
            hex("00 01 00 02 00 02 04 10"),
            reply(State::NOT_READY, empty(Register::ReloadDynamics)),
        ),
        (
            "5",
            hex("00 01 00 02 00 03 05 00 00"),
            reply(State::OK, Reply::TorqueSource(TorqueSource::Torque)),
        ),
        (
            "5 current, computed",
            hex("00 01 00 02 00 03 05 00 01"),
            reply(State::OK, Reply::TorqueSource(TorqueSource::Current)),
        ),
        (
            "6",
            hex("00 01 00 02 00 06 06 10 00 00 00 00"),
            reply(
                State::NOT_READY,
                Reply::RotationRadius(RotationRadius { millimetres: 0.0 }),
            ),
        ),
        (
            "6 at 76 mm, computed",
            hex("00 01 00 02 00 06 06 00 00 00 98 42"),
            reply(State::OK, Reply::RotationRadius(RotationRadius { millimetres: 76.0 })),
        ),
        (
            "10, corrected",
            hex("00 01 00 02 00 02 0A 00"),
            reply(State::OK, empty(Register::SystemControl)),
        ),
        (
            "10 with the length of its table, computed",
            hex("00 01 00 02 00 04 0A 00 00 01"),
            reply(State::OK, Reply::SystemControl(1)),
        ),
        (
            "1 refused in protocol 3, computed",
            hex("00 01 00 03 00 02 01 08"),
            Response::Reply {
                header: SUPERVISED,
                state: State::INVALID,
                reply: empty(Register::Version),
            },
        ),
        (
            "13, computed",
            hex("00 01 00 02 00 03 0D 70 02"),
            reply(
                State::NOT_READY | State::WARNING | State::ERROR,
                Reply::Raw(Raw::new(13, &[2]).unwrap()),
            ),
        ),
        (
            "heartbeat, computed",
            hex("00 00 00 01 00 02 00 00"),
            Response::Heartbeat,
        ),
        (
            "Modbus function 3 refused, computed",
            hex("00 07 00 00 00 03 01 83 01"),
            Response::ModbusRefused {
                transaction: 7,
                unit: 1,
                function: ModbusFunction::new(3).unwrap(),
            },
        ),
    ])
}

/// The one frame that `bytes` are.
fn frame_of(bytes: &[u8], direction: Direction) -> Frame<'_> {
    assert_eq!(XArm::scan(bytes, direction), Scan::Frame(bytes.len()));
    XArm::view(bytes).unwrap()
}

/// All that a client hears, in chunks of `chunk` bytes, with this request sent before.
fn client_hears(request: Option<Request>, bytes: &[u8], chunk: usize) -> Vec<Event<XArm>> {
    let mut client = Client::<XArm, MAX_FRAME>::new(Config::TCP);
    if let Some(request) = request {
        client.submit(request).unwrap();
        let n = client.poll_transmit(Micros(0)).unwrap().len();
        client.transmitted(Micros(0), n).unwrap();
    }
    let mut events = Vec::new();
    for bytes in bytes.chunks(chunk) {
        let mut input = Input::Bytes(bytes);
        events.extend(core::iter::from_fn(|| client.handle(Micros(1), &mut input)));
    }
    events
}

/// All that a device hears, in chunks of `chunk` bytes.
fn device_hears(bytes: &[u8], chunk: usize) -> Vec<Heard<XArm>> {
    let mut device = Device::<XArm, MAX_FRAME>::new();
    let mut heard = Vec::new();
    for bytes in bytes.chunks(chunk) {
        let mut input = Input::Bytes(bytes);
        heard.extend(core::iter::from_fn(|| device.handle(&mut input)));
    }
    heard
}

#[test]
fn every_request_of_the_page_holds_in_both_directions() {
    for (register, bytes, request) in requests() {
        let mut out = [0; MAX_FRAME];
        let n = XArm::encode_request(&request, &mut out).unwrap();
        assert_eq!(out[..n], bytes, "register {register}");
        let frame = frame_of(&bytes, Direction::Requests);
        assert_eq!(XArm::parse_request(frame), Ok(request), "register {register}");
        assert_eq!(frame.encode(Direction::Requests, &mut [0; MAX_FRAME]), Ok(bytes.len()));
    }
}

#[test]
fn every_response_of_the_page_holds_in_both_directions() {
    for (register, bytes, response) in responses() {
        let mut out = [0; MAX_FRAME];
        let n = XArm::encode_response(&response, &mut out).unwrap();
        assert_eq!(out[..n], bytes, "register {register}");
        let frame = frame_of(&bytes, Direction::Responses);
        let parsed = XArm::parse_response(frame, Direction::Responses);
        assert_eq!(parsed, Ok(response), "register {register}");
        assert_eq!(frame.encode(Direction::Responses, &mut [0; MAX_FRAME]), Ok(bytes.len()));
    }
}

#[test]
fn every_frame_of_the_page_is_heard_once_in_any_chunks() {
    for chunk in 1..=48 {
        for (register, bytes, request) in requests() {
            let heard = device_hears(&bytes, chunk);
            assert_eq!(heard, [Heard::Request(request)], "register {register} by {chunk}");
        }
        for (register, bytes, response) in responses() {
            let events = client_hears(None, &bytes, chunk);
            assert_eq!(events, [Event::Unsolicited(response)], "register {register} by {chunk}");
        }
    }
}

#[test]
fn every_reply_of_the_page_answers_its_request_and_no_other() {
    for (_, _, request) in requests() {
        for (_, bytes, response) in responses() {
            let answer = match (request, response) {
                (
                    Request::Call { header, command },
                    Response::Reply {
                        header: theirs, reply, ..
                    },
                ) => header == theirs && command.register() == reply.register(),
                _ => false,
            };
            let events = client_hears(Some(request), &bytes, bytes.len());
            assert_eq!(
                events.contains(&Event::Answer(response)),
                answer,
                "{request:?} {response:?}"
            );
        }
    }
}

#[test]
fn a_frame_with_the_length_of_the_table_is_broken_off_where_its_text_is_left_over() {
    // Registers 1 and 2: the table has 2 where the frame has 42.
    for (printed, got) in [(0, 0x36), (1, 0x31)] {
        let (register, mut bytes, _) = responses().swap_remove(printed);
        assert_eq!(bytes[4..6], [0x00, 0x2A]);
        bytes[5] = 0x02;
        let events = client_hears(None, &bytes, 1);
        let [Event::Unsolicited(empty), Event::Broken(noise)] = events[..] else {
            panic!("register {register}: {events:?}");
        };
        assert_eq!(empty, reply(State::OK, Reply::empty(bytes[6])));
        let reason = Reason::Byte {
            offset: 2,
            expected: &[0],
            got,
        };
        assert_eq!((noise.offset, noise.reason), (8, reason));
    }
}

#[test]
fn the_state_of_register_6_is_that_of_the_frame_not_of_the_table() {
    let (_, bytes, response) = responses().swap_remove(5);
    let Response::Reply { state, .. } = response else {
        panic!("{response:?}");
    };
    assert_eq!((bytes[7], state), (0x10, State::NOT_READY));
}

/// Register 10 as it is printed: length 2, yet four bytes follow. Corrected, it is among the [`responses`].
const PRINTED: &str = "00 01 00 02 00 02 0A 00 00 01";

#[test]
fn the_printed_reply_of_register_10_breaks_the_connection_and_the_error_says_where() {
    // The two bytes too many pass for a transaction id, and the id of the next reply for a protocol id.
    let line = [hex(PRINTED), hex("00 05 00 02 00 02 04 10")].concat();
    let first = reply(State::OK, Reply::Empty(Register::SystemControl));
    for chunk in 1..=line.len() {
        let events = client_hears(Some(call(Command::Shutdown)), &line, chunk);
        let [Event::Answer(answer), Event::Broken(noise)] = events[..] else {
            panic!("{events:?}");
        };
        assert_eq!(answer, first);
        assert_eq!(
            std::format!("{noise}"),
            "4 bytes at 8: byte 3 is 0x05, expected 0x00 or 0x01 or 0x02 or 0x03"
        );
    }
}

#[test]
fn after_the_printed_reply_of_register_10_no_call_is_answered_and_the_third_breaks_at_the_latest() {
    // Ids up to 3 pass for protocol ids too, and frames are found where there are none: they answer nothing.
    for protocol in [ProtocolId::Private, ProtocolId::Supervised] {
        for first in 1..=300 {
            let mut client = Client::<XArm, MAX_FRAME>::new(Config::TCP);
            let mut line = hex(PRINTED);
            [line[0], line[1]] = u16::to_be_bytes(first);
            line[3] = protocol as u8;
            let mut breaks = 0;
            for transaction in first + 1..=first + 3 {
                let header = Header { transaction, protocol };
                let command = Command::ReloadDynamics;
                client.submit(Request::Call { header, command }).unwrap();
                let n = client.poll_transmit(Micros(0)).map_or(0, <[u8]>::len);
                client.transmitted(Micros(0), n).unwrap();
                let answer = Response::Reply {
                    header,
                    state: State::OK,
                    reply: Reply::empty(command.register()),
                };
                let mut out = [0; MAX_FRAME];
                let n = XArm::encode_response(&answer, &mut out).unwrap();
                line.extend(&out[..n]);
                let mut input = Input::Bytes(&line);
                while let Some(event) = client.handle(Micros(0), &mut input) {
                    assert!(!matches!(event, Event::Answer(_)), "{event:?} after {first}");
                    breaks += usize::from(matches!(event, Event::Broken(_)));
                }
                line.clear();
                client.cancel(Micros(0));
            }
            assert!(breaks > 0, "after transaction {first} in {protocol:?}");
        }
    }
}

#[test]
fn a_length_too_short_or_too_long_is_skipped_and_named() {
    let length = |min, max, got| Scan::Skip(HEADER + usize::from(got), Reason::Length { min, max, got });
    let cases = [
        ("00 01 00 02 00 00", Direction::Requests, length(1, 253, 0)),
        ("00 01 00 02 00 FE", Direction::Requests, length(1, 253, 254)),
        ("00 01 00 03 00 00", Direction::Responses, length(2, 254, 0)),
        ("00 01 00 02 00 01", Direction::Responses, length(2, 254, 1)),
        ("00 01 00 02 00 FF", Direction::Responses, length(2, 254, 255)),
        ("00 01 00 02 FF FF", Direction::Responses, length(2, 254, 65535)),
        ("00 01 00 00 00 01", Direction::Requests, length(2, 254, 1)),
        ("00 00 00 01 00 01", Direction::Requests, length(2, 2, 1)),
        ("00 00 00 01 00 03", Direction::Responses, length(2, 2, 3)),
    ];
    for (bytes, direction, scan) in cases {
        assert_eq!(XArm::scan(&hex(bytes), direction), scan, "{bytes}");
    }
}

#[test]
fn a_protocol_id_over_3_is_fatal_and_named() {
    let byte =
        |offset: u8, expected, got| Scan::Broken(usize::from(offset) + 1, Reason::Byte { offset, expected, got });
    for id in 4..=u8::MAX {
        let scan = XArm::scan(&[0, 1, 0, id], Direction::Requests);
        assert_eq!(scan, byte(3, &[0, 1, 2, 3], id));
    }
    assert_eq!(XArm::scan(&[0, 1, 1], Direction::Responses), byte(2, &[0], 1));
}

#[test]
fn nothing_but_the_heartbeat_has_protocol_id_1() {
    for offset in [0, 1, 6, 7] {
        let mut bytes = HEARTBEAT;
        bytes[usize::from(offset)] = 7;
        for direction in [Direction::Requests, Direction::Responses] {
            let reason = Reason::Byte {
                offset,
                expected: &[0],
                got: 7,
            };
            assert_eq!(XArm::scan(&bytes[..7], direction), Scan::Need(1));
            assert_eq!(XArm::scan(&bytes, direction), Scan::Skip(8, reason));
        }
    }
}

#[test]
fn a_frame_that_would_break_the_stream_is_not_written() {
    let heartbeat = Frame {
        transaction: 0,
        protocol: HEARTBEAT_ID,
        body: &[0, 0],
    };
    let mut out = [0; MAX_FRAME];
    for direction in [Direction::Requests, Direction::Responses] {
        assert_eq!(heartbeat.encode(direction, &mut out), Ok(8));
        assert_eq!(out[..8], HEARTBEAT);
        for (transaction, body, offset) in [(1, &[0, 0], 1), (256, &[0, 0], 0), (0, &[1, 0], 6), (0, &[0, 1], 7)] {
            let frame = Frame {
                transaction,
                body,
                ..heartbeat
            };
            let error = frame.encode(direction, &mut out).unwrap_err();
            let byte = EncodeError::Byte {
                offset,
                expected: &[0],
                got: 1,
            };
            assert_eq!(error, byte, "{frame:?}");
        }
    }
}

#[test]
fn standard_modbus_is_refused_by_name_and_the_connection_goes_on() {
    let read = hex("00 07 00 00 00 06 01 03 00 00 00 02");
    let line = [read, hex("00 01 00 02 00 01 01")].concat();
    let heard = device_hears(&line, 5);
    let [Heard::Unknown(error), Heard::Request(request)] = heard[..] else {
        panic!("{heard:?}");
    };
    assert_eq!(request, call(Command::ReadVersion));
    let (_, bytes, refused) = responses().pop().unwrap();
    assert_eq!(error.refusal(), refused);
    let mut out = [0; MAX_FRAME];
    let n = Device::<XArm, MAX_FRAME>::new().respond(&refused, &mut out).unwrap();
    assert_eq!(out[..n], bytes);
}

#[test]
fn bad_parameters_are_named_and_refused_with_the_request_s_own_header() {
    for (bytes, text) in [
        (
            "00 09 00 03 00 02 01 00",
            "register 1: 1 bytes of parameters, expected 0",
        ),
        ("00 09 00 03 00 01 06", "register 6: 0 bytes of parameters, expected 1"),
        (
            "00 09 00 03 00 02 06 00",
            "register 6: joint is 0, must be 1..=7 (parameter byte 0)",
        ),
        (
            "00 09 00 03 00 02 0A 03",
            "register 10: system control is 3, must be 1..=2 (parameter byte 0)",
        ),
    ] {
        let bytes = hex(bytes);
        let error = XArm::parse_request(frame_of(&bytes, Direction::Requests)).unwrap_err();
        assert_eq!(std::format!("{error}"), text);
        let mut out = [0; MAX_FRAME];
        let n = XArm::encode_response(&error.refusal(), &mut out).unwrap();
        assert_eq!(out[..n], [0, 9, 0, 3, 0, 2, bytes[6], 0x08]);
    }
}

#[test]
fn a_reply_with_bad_parameters_names_what_they_may_be() {
    for (bytes, text) in [
        (
            "00 01 00 02 00 03 01 00 36",
            "register 1: 1 bytes of parameters, expected 0 or 40",
        ),
        (
            "00 01 00 02 00 03 04 00 00",
            "register 4: 1 bytes of parameters, expected 0",
        ),
        (
            "00 01 00 02 00 03 05 00 02",
            "register 5: torque source is 2, must be 0..=1 (parameter byte 0)",
        ),
        (
            "00 01 00 02 00 03 06 00 00",
            "register 6: 1 bytes of parameters, expected 0 or 4",
        ),
        (
            "00 01 00 02 00 03 0A 00 01",
            "register 10: 1 bytes of parameters, expected 0 or 2",
        ),
        (
            "00 07 00 00 00 03 01 83 02",
            "protocol id 0, standard Modbus, expected 2 or 3 (unit 1, function 3)",
        ),
        (
            "00 07 00 00 00 03 01 03 01",
            "protocol id 0, standard Modbus, expected 2 or 3 (unit 1, function 3)",
        ),
    ] {
        let bytes = hex(bytes);
        // Nor is it taken for a request that came back.
        let events = client_hears(None, &bytes, bytes.len());
        let [Event::Unknown(error)] = events[..] else {
            panic!("{events:?}");
        };
        assert_eq!(std::format!("{error}"), text);
    }
}

#[test]
fn frames_that_the_framing_would_not_let_through_are_errors_too() {
    let frame = Frame {
        transaction: 1,
        protocol: 2,
        body: &[],
    };
    let error = XArm::parse_request(frame).unwrap_err();
    assert_eq!(
        std::format!("{error}"),
        "register 0: body of 0 bytes, expected at least 1"
    );
    let body = &[13; MAX_BODY + 1];
    let long = Frame { body, ..frame };
    assert!(XArm::parse_response(long, Direction::Responses).is_err());
    assert!(long.encode(Direction::Responses, &mut [0; 200]).is_err());
    let foreign = Frame { protocol: 4, ..frame };
    let error = XArm::parse_request(foreign).unwrap_err();
    assert_eq!(
        std::format!("{error}"),
        "protocol id 4, expected 2 or 3 (unit 0, function 0)"
    );
}

#[test]
fn a_radius_of_any_bits_is_taken_and_given_back_as_it_is() {
    for bits in [
        0x7FC0_0001,
        0xFFC0_0000,
        0x7F80_0000,
        0xFF80_0000,
        0x8000_0000,
        0xC280_0000_u32,
    ] {
        let mut bytes = hex("00 01 00 02 00 06 06 00");
        bytes.extend(bits.to_le_bytes());
        let millimetres = f32::from_bits(bits);
        let response = reply(State::OK, Reply::RotationRadius(RotationRadius { millimetres }));
        let frame = frame_of(&bytes, Direction::Responses);
        assert_eq!(
            XArm::parse_response(frame, Direction::Responses),
            Ok(response),
            "{bits:#x}"
        );
        let mut out = [0; MAX_FRAME];
        let n = XArm::encode_response(&response, &mut out).unwrap();
        assert_eq!(out[..n], bytes, "{bits:#x}");
    }
}

#[test]
fn an_arm_is_waited_for_as_long_as_the_vendor_s_package_does() {
    for (register, _, request) in requests() {
        let turnaround = match request {
            Request::Heartbeat => None,
            Request::Call {
                command: Command::Raw(_),
                ..
            } => Some(Micros::from_millis(10_000)),
            Request::Call { .. } => Some(Micros::from_millis(2_000)),
        };
        let reply = turnaround.map(|turnaround| crate::Reply {
            len: MAX_FRAME,
            turnaround,
        });
        assert_eq!(XArm::reply(&request), reply, "register {register}");
    }
}

#[test]
fn only_readings_are_sent_again_after_silence() {
    for (register, _, request) in requests() {
        let mut client = Client::<XArm, MAX_FRAME>::new(Config {
            repeats: 2,
            ..Config::TCP
        });
        client.submit(request).unwrap();
        let (mut now, mut sends) = (Micros(0), 0);
        while !client.is_idle() {
            if let Some(n) = client.poll_transmit(now).map(<[u8]>::len) {
                sends += 1;
                client.transmitted(now, n).unwrap();
            }
            now = client.poll_timeout().unwrap_or(now);
            client.handle(now, &mut Input::Tick);
        }
        let reading = matches!(
            request,
            Request::Call {
                command: Command::ReadVersion
                    | Command::ReadSerials
                    | Command::ReadTorqueSource
                    | Command::ReadRotationRadius(_),
                ..
            }
        );
        assert_eq!(sends, if reading { 3 } else { 1 }, "register {register}");
    }
}

#[test]
fn transaction_ids_wrap_past_zero() {
    let mut transactions = Transactions::new();
    let ids: Vec<_> = (0..65536).map(|_| transactions.next_id()).collect();
    assert_eq!((ids[0], ids[65534], ids[65535]), (1, 65535, 1));
    assert!(!ids.contains(&0));
}

#[test]
fn a_frame_is_viewed_only_if_its_length_is_that_of_its_body() {
    assert!(XArm::view(&[0, 1, 0, 2, 0, 1, 7]).is_some());
    assert_eq!(XArm::view(&[0, 1, 0, 2, 0, 2, 7]), None);
    assert_eq!(XArm::view(&[0, 1, 0, 2, 0, 0]), None);
}

#[test]
fn radii_are_the_same_only_if_their_bits_are() {
    let radius = |metres| RotationRadius::from_metres(metres).unwrap();
    assert_eq!(radius(0.1), radius(0.1));
    assert_ne!(radius(0.1), radius(0.2));
}

#[test]
fn a_state_names_every_bit_it_has() {
    for (state, text) in [
        (State(0), "ok"),
        (State::ERROR, "error"),
        (State::INVALID | State::WARNING, "invalid, warning"),
        (State(0x01), "other bits 0x01"),
        (State(State::ERROR.0 | 0x01), "error, other bits 0x01"),
    ] {
        assert_eq!(std::format!("{state}"), text);
    }
    assert_eq!(State::ERROR | State::ERROR, State::ERROR);
}

#[test]
fn the_longest_frame_is_as_long_as_that_of_modbus_tcp() {
    let frame = Frame {
        transaction: 1,
        protocol: 2,
        body: &[1; MAX_BODY],
    };
    let mut out = [0; MAX_FRAME];
    assert_eq!(frame.encode(Direction::Responses, &mut out), Ok(260));
    assert_eq!(MAX_FRAME, 260);
}

#[test]
fn no_more_bytes_are_waited_for_than_a_frame_has() {
    let mut decoder = Decoder::<XArm, MAX_FRAME>::new();
    for (at, byte) in HEARTBEAT.into_iter().enumerate() {
        let need = decoder.need(Direction::Requests);
        assert!((1..=HEARTBEAT.len() - at).contains(&need), "{need} behind {at}");
        assert!(decoder.push(&[byte]).is_empty());
    }
    assert!(decoder.next(Direction::Requests).is_some_and(|next| next.is_ok()));
}

#[test]
fn a_modbus_function_that_no_byte_has_room_for_is_refused() {
    let error = ModbusFunction::new(0x83).unwrap_err();
    assert_eq!(std::format!("{error}"), "Modbus function is 131, must be 0..=127");
    assert_eq!(ModbusFunction::new(127).map(ModbusFunction::number), Ok(127));
}
