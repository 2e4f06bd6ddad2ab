//! Every example frame of the page, and the corrected frames.

extern crate std;

use std::string::String;
use std::vec::Vec;

use super::*;
use crate::correlation::{Correlation, Effect};
use crate::framing::{Framing, Reason, Scan};
use crate::hex::hex;
use crate::messages::Messages;
use crate::time::{Duration, Instant};
use crate::vectors;
use crate::{Client, Config, Device, DeviceEvent, Event, Output};

/// The key of a request to register 0 in this frame: its numbers.
fn numbers(bytes: &[u8]) -> Option<Key> {
    let frame = Frame::parse(bytes)?;
    Some(Key {
        transaction: frame.transaction,
        protocol: frame.protocol,
        register: 0,
    })
}

fn reply(state: State, reply: Reply<'static>) -> Response<'static> {
    Response::Reply { state, reply }
}

/// Name, frame, meaning, in the order of the page. Frames marked *computed* are not on the page.
fn requests() -> Vec<(&'static str, Vec<u8>, Request<'static>)> {
    let joint = Joint::new(6).unwrap();
    let meanings = [
        ("register 1", Request::ReadVersion),
        ("register 2", Request::ReadSerials),
        ("register 4", Request::ReloadDynamics),
        ("register 5", Request::ReadTorqueSource),
        ("register 6", Request::ReadRotationRadius(joint)),
        ("register 10, shut down", Request::Shutdown),
        ("register 10, reboot", Request::Reboot),                   // computed
        ("register 1, protocol 3", Request::ReadVersion),           // computed
        ("register 19", Request::Raw(Raw::new(19, &[1]).unwrap())), // computed
        ("heartbeat", Request::Heartbeat),                          // computed
    ];
    vectors::with_meanings(vectors::xarm_requests(), meanings)
}

/// The same for responses. Register 10 is as on the vendor's published page; its printed form has a test of its own.
fn responses() -> Vec<(&'static str, Vec<u8>, Response<'static>)> {
    let version_text = VersionText(b"6,6,XI1202,AC1302,v1.12.10\0\0\0\0\0\0\0\0\0\0\0\0\0\0");
    let serials_text = SerialsText(b"XI120204201B02\0AC130202B02L02\n\0\0\0\0\0\0\0\0\0\0");
    assert_eq!(
        VersionText::encode("6,6,XI1202,AC1302,v1.12.10").unwrap(),
        version_text.0
    );
    assert_eq!(
        SerialsText::encode("XI120204201B02", "AC130202B02L02").unwrap(),
        serials_text.0
    );
    let empty = Reply::Empty;
    let meanings = [
        ("register 1", reply(State::OK, Reply::Version(version_text))),
        ("register 2", reply(State::OK, Reply::Serials(serials_text))),
        ("register 4", reply(State::NOT_READY, empty(Register::ReloadDynamics))),
        (
            "register 5, torque",
            reply(State::OK, Reply::TorqueSource(TorqueSource::Torque)),
        ),
        (
            "register 5, current",
            reply(State::OK, Reply::TorqueSource(TorqueSource::Current)),
        ), // computed
        (
            "register 6, 0 mm",
            reply(
                State::NOT_READY,
                Reply::RotationRadius(RotationRadius { millimetres: 0.0 }),
            ),
        ),
        (
            "register 6, 76 mm",
            reply(State::OK, Reply::RotationRadius(RotationRadius { millimetres: 76.0 })),
        ), // computed
        ("register 10", reply(State::OK, empty(Register::SystemControl))), // corrected
        ("register 10, length 4", reply(State::OK, Reply::SystemControl(1))), // computed
        ("register 1 refused", reply(State::INVALID, empty(Register::Version))), // computed
        (
            "register 13",
            reply(
                State::NOT_READY | State::WARNING | State::ERROR,
                Reply::Raw(Raw::new(13, &[2]).unwrap()),
            ),
        ), // computed
        ("heartbeat", Response::Heartbeat),                                // computed
        (
            "Modbus function 3 refused",
            Response::ModbusRefused {
                unit: 1,
                function: ModbusFunction::new(3).unwrap(),
            },
        ), // computed
    ];
    vectors::with_meanings(vectors::xarm_answers(), meanings)
}

/// These bytes, which must be one frame.
fn frame_of(bytes: &[u8], direction: Direction) -> &[u8] {
    assert_eq!(XArm::PRIVATE.scan(bytes, direction), Scan::Frame(bytes.len()));
    bytes
}

/// The text of an event; noise and a break by their offset.
fn describe(event: Event<'_, Response<'_>>) -> String {
    match event {
        Event::Noise { offset, .. } => std::format!("Noise({offset})"),
        Event::Broken { offset, .. } => std::format!("Broken({offset})"),
        other => std::format!("{other:?}"),
    }
}

/// The texts of all events of a client for these bytes, in chunks of `chunk` bytes, after this request.
fn receive(request: Option<Request<'_>>, bytes: &[u8], chunk: usize) -> Vec<String> {
    let mut client = Client::<XArm, MAX_FRAME>::new(XArm::PRIVATE, Config::TCP);
    let now = Instant::ZERO;
    if let Some(request) = request {
        client.submit(&request).unwrap();
        assert_eq!(client.poll(now), Output::Receive);
        client.received(now, 0).unwrap();
        let Output::Transmit(bytes) = client.poll(now) else {
            panic!("nothing to transmit")
        };
        let n = bytes.len();
        client.transmitted(now, n).unwrap();
    }
    let mut events = Vec::new();
    for bytes in bytes.chunks(chunk) {
        assert!(client.receive(now, bytes).is_empty());
        while let Output::Event(event) = client.poll(now) {
            events.push(describe(event));
        }
    }
    events
}

#[test]
fn documented_requests_round_trip() {
    for (name, bytes, request) in requests() {
        let arm = XArm {
            protocol: if bytes[3] == 3 {
                ProtocolId::Supervised
            } else {
                ProtocolId::Private
            },
        };
        let mut out = [0; MAX_FRAME];
        let n = arm.encode_request(&request, &mut out).unwrap();
        arm.stamp(&mut out[..n], 1);
        assert_eq!(out[..n], bytes, "{name}");
        let frame = frame_of(&bytes, Direction::Requests);
        assert_eq!(arm.parse_request(frame), Ok(request), "{name}");
    }
}

#[test]
fn documented_responses_round_trip() {
    for (name, bytes, response) in responses() {
        let mut out = [0; MAX_FRAME];
        let n = XArm::PRIVATE
            .encode_response(&response, numbers(&bytes), &mut out)
            .unwrap();
        assert_eq!(out[..n], bytes, "{name}");
        let frame = frame_of(&bytes, Direction::Responses);
        let parsed = XArm::PRIVATE.parse_response(frame, Direction::Responses);
        assert_eq!(parsed, Ok(response), "{name}");
    }
}

#[test]
fn documented_frames_are_received_once_in_any_chunks() {
    for chunk in 1..=48 {
        for (name, bytes, request) in requests() {
            let mut device = Device::<XArm, MAX_FRAME>::new(XArm::PRIVATE);
            let mut received = 0;
            for bytes in bytes.chunks(chunk) {
                assert!(device.receive(bytes).is_empty());
                while let Some(event) = device.poll() {
                    let DeviceEvent::Request { request: one, .. } = event else {
                        panic!("{event:?}")
                    };
                    assert_eq!(one, request, "{name} by {chunk}");
                    received += 1;
                }
            }
            assert_eq!(received, 1, "{name} by {chunk}");
        }
        for (name, bytes, response) in responses() {
            let events = receive(None, &bytes, chunk);
            assert_eq!(events, [describe(Event::Unsolicited(response))], "{name} by {chunk}");
        }
    }
}

#[test]
fn documented_reply_answers_only_its_own_request() {
    for (_, request_bytes, request) in requests() {
        for (_, bytes, response) in responses() {
            let answers = match response {
                // The client uses protocol id 2.
                Response::Reply { reply, .. } => {
                    bytes[..4] == [0, 1, 0, 2] && request.register() == Some(reply.register())
                }
                _ => false,
            };
            let events = receive(Some(request), &bytes, bytes.len());
            assert_eq!(
                events.contains(&describe(Event::Answer(response))),
                answers,
                "{request_bytes:?} {response:?}"
            );
        }
    }
}

#[test]
fn frame_with_table_length_breaks_at_excess_text() {
    // Registers 1 and 2: the table has 2 where the frame has 42.
    for printed in [0, 1] {
        let (name, mut bytes, _) = responses().swap_remove(printed);
        assert_eq!(bytes[4..6], [0x00, 0x2A]);
        bytes[5] = 0x02;
        let empty = describe(Event::Unsolicited(reply(State::OK, Reply::empty(bytes[6]))));
        assert_eq!(receive(None, &bytes, 1), [empty, "Broken(8)".into()], "{name}");
    }
}

#[test]
fn register_6_state_follows_frame_not_table() {
    let (_, bytes, response) = responses().swap_remove(5);
    let Response::Reply { state, .. } = response else {
        panic!("{response:?}");
    };
    assert_eq!((bytes[7], state), (0x10, State::NOT_READY));
}

/// Register 10 as printed: length 2, but four bytes follow. The corrected frame is among the [`responses`].
const PRINTED: &str = "00 01 00 02 00 02 0A 00 00 01";

#[test]
fn printed_register_10_reply_breaks_the_connection() {
    // The two surplus bytes look like a transaction id, and the id of the next reply like a protocol id.
    let line = [hex(PRINTED), hex("00 05 00 02 00 02 04 10")].concat();
    let first = describe(Event::Answer(reply(State::OK, Reply::Empty(Register::SystemControl))));
    for chunk in 1..=line.len() {
        let events = receive(Some(Request::Shutdown), &line, chunk);
        assert_eq!(events, [first.clone(), "Broken(8)".into()], "by {chunk}");
    }
}

#[test]
fn invalid_length_is_skipped_and_named() {
    let length = |min, max, got| Scan::Noise(HEADER + usize::from(got), Reason::Length { min, max, got });
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
        assert_eq!(XArm::PRIVATE.scan(&hex(bytes), direction), scan, "{bytes}");
    }
}

#[test]
fn protocol_id_over_3_is_fatal_and_named() {
    let byte = |offset: u8, expected, got| Scan::Broken(Reason::Byte { offset, expected, got });
    for id in 4..=u8::MAX {
        let scan = XArm::PRIVATE.scan(&[0, 1, 0, id], Direction::Requests);
        assert_eq!(scan, byte(3, &[0, 1, 2, 3], id));
    }
    assert_eq!(XArm::PRIVATE.scan(&[0, 1, 1], Direction::Responses), byte(2, &[0], 1));
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
            assert_eq!(XArm::PRIVATE.scan(&bytes[..7], direction), Scan::Need(1));
            assert_eq!(XArm::PRIVATE.scan(&bytes, direction), Scan::Noise(8, reason));
        }
    }
}

#[test]
fn standard_modbus_is_refused_and_connection_continues() {
    let read = hex("00 07 00 00 00 06 01 03 00 00 00 02");
    let line = [read, hex("00 01 00 02 00 01 01")].concat();
    let mut device = Device::<XArm, MAX_FRAME>::new(XArm::PRIVATE);
    assert!(device.receive(&line).is_empty());
    let Some(DeviceEvent::Unknown { error, key, .. }) = device.poll() else {
        panic!("another event")
    };
    assert_eq!(std::format!("{error}"), "standard Modbus, unit 1, function 3: unknown");
    let (_, bytes, refused) = responses().pop().unwrap();
    assert_eq!(Response::refusal(&error), Some(refused));
    let mut out = [0; MAX_FRAME];
    let n = XArm::PRIVATE.encode_response(&refused, key, &mut out).unwrap();
    assert_eq!(out[..n], bytes);
    assert!(matches!(
        device.poll(),
        Some(DeviceEvent::Request {
            request: Request::ReadVersion,
            ..
        })
    ));
}

#[test]
fn bad_parameters_are_refused_with_the_request_numbers() {
    for (bytes, text) in [
        ("00 09 00 03 00 02 01 00", "register 1: 1 data bytes, expected 0"),
        ("00 09 00 03 00 01 06", "register 6: 0 data bytes, expected 1"),
        (
            "00 09 00 03 00 02 06 00",
            "register 6: joint is 0, must be 1..=7 (data byte 0)",
        ),
        (
            "00 09 00 03 00 02 0A 03",
            "register 10: system control is 3, must be 1..=2 (data byte 0)",
        ),
    ] {
        let bytes = hex(bytes);
        let error = XArm::PRIVATE
            .parse_request(frame_of(&bytes, Direction::Requests))
            .unwrap_err();
        assert_eq!(std::format!("{error}"), text);
        let key = XArm::PRIVATE.request(&bytes).map(|info| info.key);
        let mut out = [0; MAX_FRAME];
        let refusal = Response::refusal(&error).unwrap();
        let n = XArm::PRIVATE.encode_response(&refusal, key, &mut out).unwrap();
        assert_eq!(out[..n], [0, 9, 0, 3, 0, 2, bytes[6], 0x08]);
    }
}

#[test]
fn reply_with_bad_parameters_names_valid_ones() {
    for (bytes, text) in [
        (
            "00 01 00 02 00 03 05 00 02",
            "register 5: torque source is 2, must be 0..=1 (data byte 0)",
        ),
        (
            "00 01 00 02 00 03 06 00 00",
            "register 6: 1 data bytes, expected 0 or 4",
        ),
        (
            "00 07 00 00 00 03 01 83 02",
            "standard Modbus, unit 1, function 3: unknown",
        ),
        (
            "00 07 00 00 00 03 01 03 01",
            "standard Modbus, unit 1, function 3: unknown",
        ),
    ] {
        let bytes = hex(bytes);
        let frame = frame_of(&bytes, Direction::Responses);
        let error = XArm::PRIVATE.parse_response(frame, Direction::Responses).unwrap_err();
        assert_eq!(std::format!("{error}"), text);
        // The frame is not an echoed request either.
        assert_eq!(
            receive(None, &bytes, bytes.len()),
            [describe(Event::Unknown { frame, error })]
        );
    }
}

#[test]
fn radius_of_any_bits_is_kept_unchanged() {
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
            XArm::PRIVATE.parse_response(frame, Direction::Responses),
            Ok(response),
            "{bits:#x}"
        );
        let mut out = [0; MAX_FRAME];
        let n = XArm::PRIVATE
            .encode_response(&response, numbers(&bytes), &mut out)
            .unwrap();
        assert_eq!(out[..n], bytes, "{bits:#x}");
    }
}

#[test]
fn answer_timeouts_match_the_vendor_package() {
    for (name, bytes, request) in requests() {
        let turnaround = match request {
            Request::Heartbeat => None,
            Request::Raw(_) => Some(Duration::from_millis(10_000)),
            _ => Some(Duration::from_millis(2_000)),
        };
        let info = XArm::PRIVATE.request(&bytes).unwrap();
        assert_eq!(info.response.map(|response| response.turnaround), turnaround, "{name}");
        let reading = matches!(
            request,
            Request::ReadVersion | Request::ReadSerials | Request::ReadTorqueSource | Request::ReadRotationRadius(_)
        );
        assert_eq!(info.effect == Effect::Read, reading, "{name}");
    }
}

#[test]
fn parse_requires_a_matching_length_field() {
    assert!(Frame::parse(&[0, 1, 0, 2, 0, 1, 7]).is_some());
    assert_eq!(Frame::parse(&[0, 1, 0, 2, 0, 2, 7]), None);
    assert_eq!(Frame::parse(&[0, 1, 0, 2, 0, 0]), None);
}

#[test]
fn radii_are_equal_only_with_equal_bits() {
    let radius = |metres| RotationRadius::from_metres(metres).unwrap();
    assert_eq!(radius(0.1), radius(0.1));
    assert_ne!(radius(0.1), radius(0.2));
}

#[test]
fn state_text_names_every_set_bit() {
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
fn longest_frame_has_the_modbus_tcp_limit() {
    let response = Response::Reply {
        state: State::OK,
        reply: Reply::Raw(Raw::new(42, &[1; MAX_PARAMS]).unwrap()),
    };
    let mut out = [0; MAX_FRAME];
    assert_eq!(XArm::PRIVATE.encode_response(&response, None, &mut out), Ok(260));
    assert_eq!(MAX_FRAME, 260);
}

#[test]
fn modbus_function_without_a_byte_is_refused() {
    let error = ModbusFunction::new(0x83).unwrap_err();
    assert_eq!(std::format!("{error}"), "Modbus function is 131, must be 0..=127");
    assert_eq!(ModbusFunction::new(127).map(ModbusFunction::number), Ok(127));
}
