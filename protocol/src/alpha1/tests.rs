//! Every row of the document and every command of the servos' manual, and the sequences that resemble them.

extern crate std;

use core::num::NonZeroU32;
use core::time::Duration;
use std::string::{String, ToString};
use std::vec::Vec;

use super::*;
use crate::correlation::{Correlation, Effect};
use crate::decoder::{Decoder, Kind};
use crate::framing::{Framing, Reason, Scan};
use crate::hex::hex;
use crate::messages::Messages;
use crate::time::Instant;
use crate::vectors;
use crate::{Client, Config, Device, DeviceEvent, Event, Output, time};

fn id(id: u8) -> ServoId {
    ServoId::new(id).unwrap()
}

fn angle(degrees: u8) -> Angle {
    Angle::new(degrees).unwrap()
}

fn name(text: &str) -> Text<'_> {
    Text::new(text.as_bytes()).unwrap()
}

/// The example of the servos' manual: 90° in a second, and a second of rest.
fn moving(to: Address) -> ServoRequest {
    ServoRequest::Move {
        to,
        angle: angle(90),
        time: MoveTime::from_duration(Duration::from_secs(1)).unwrap(),
        lock: Interval::from_duration(Duration::from_secs(1)).unwrap(),
    }
}

/// Sixteen servos to 90° within 500 ms, the next frame 600 ms later.
fn acting() -> Request<'static> {
    let mut angles = [None; SERVOS];
    angles[..16].fill(Some(angle(90)));
    Request::Act(Action {
        angles,
        time: MoveTime::from_duration(Duration::from_millis(500)).unwrap(),
        interval: Interval::from_duration(Duration::from_millis(600)).unwrap(),
    })
}

/// Row or command, frame, meaning. The document prints no whole frames: the robot's are computed from its columns. The
/// servos' frames are published examples, except for those marked *computed*.
fn requests() -> Vec<(&'static str, Vec<u8>, Request<'static>)> {
    let servo = Request::Servo;
    let meanings = [
        ("F1 hardware version", Request::ReadHardwareVersion),
        ("EF servo states", Request::ReadServoStates),
        ("F2 stop", Request::Stop),
        ("F5 firmware version", Request::ReadFirmwareVersion),
        ("FB act", acting()),
        ("F4 connect", Request::SetOffsetTool(OffsetTool::Connect)),
        ("F4 disconnect", Request::SetOffsetTool(OffsetTool::Disconnect)),
        ("F9 disk", Request::SetUsbType(UsbType::Disk)),
        ("F9 serial port", Request::SetUsbType(UsbType::SerialPort)),
        ("F9 HID", Request::SetUsbType(UsbType::Hid)),
        ("F3 play", Request::Play(name("dance"))),
        ("F3 play nothing", Request::Play(name(""))),
        ("FA 01 move", servo(moving(Address::One(id(1))))),
        ("FA 01 move all", servo(moving(Address::All))), // computed
        ("FA 01 release", servo(ServoRequest::Release(Address::One(id(1))))), // computed
        (
            "FA 04 LED 1",
            servo(ServoRequest::SetLed {
                to: Address::One(id(1)),
                led: Led(1),
            }),
        ), // computed
        (
            "FA 04 LED 0",
            servo(ServoRequest::SetLed {
                to: Address::One(id(1)),
                led: Led(0),
            }),
        ), // computed
        ("FA 02 read angles", servo(ServoRequest::ReadAngles(id(1)))),
        (
            "FA CD change id",
            servo(ServoRequest::ChangeId { from: id(1), to: id(2) }),
        ),
        ("FA D2 set offset", servo(ServoRequest::SetOffset(id(1), Offset::MIN))), // computed
        ("FA D4 read offset", servo(ServoRequest::ReadOffset(id(1)))),            // computed
        ("FC 01 version", servo(ServoRequest::ReadVersion(id(1)))),
    ];
    vectors::with_meanings(vectors::alpha1_requests(), meanings)
}

/// Row or command, frame, expectation, meaning.
fn responses() -> Vec<(&'static str, Vec<u8>, Option<ServoAnswer>, Response<'static>)> {
    let (yes, no) = (Outcome::Success, Outcome::Failure);
    let (one, two) = (id(1), id(2));
    let firmware = |outcome, text: &[u8; 10]| Response::FirmwareVersion(FirmwareVersion { outcome, text: *text });
    const LONG: &str = "vvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvvv";
    let robot = [
        ("F1 hardware version", Response::HardwareVersion(name("Alpha1_V2.0"))),
        ("F1 empty", Response::HardwareVersion(name(""))),
        ("F1 longest", Response::HardwareVersion(name(LONG))),
        (
            "EF servos 1, 3 and 16",
            Response::ServoStates(ServoStates::from_bits(0x8005)),
        ),
        (
            "EF data and CHECK like a terminator",
            Response::ServoStates(ServoStates([0, 0, 0, 0xED])),
        ),
        ("F2 stopped", Response::Stopped(yes)),
        ("F2 not stopped", Response::Stopped(no)),
        ("F5 firmware version", firmware(yes, &OLDEST_FIRMWARE)),
        ("F5 failure", firmware(no, &[0; 10])),
        ("FB acted", Response::Acted(yes)),
        ("FB failure", Response::Acted(no)),
        ("F4 done", Response::OffsetTool(yes)),
        ("F4 failure", Response::OffsetTool(no)),
        ("F9 done", Response::UsbType(yes)),
        ("F9 failure", Response::UsbType(no)),
        ("F3 playing", Response::Playing(yes)),
        ("F3 failure", Response::Playing(no)),
    ];
    let servos = [
        ("FA 01 moved", ServoResponse::Acknowledged(one)),
        (
            "FA 02 angles",
            ServoResponse::Angles {
                servo: one,
                outcome: yes,
                target: 90,
                actual: 90,
            },
        ),
        (
            "FA CD id changed",
            ServoResponse::IdChanged {
                servo: two,
                outcome: yes,
                was: 1,
            },
        ),
        (
            "FA D2 offset set",
            ServoResponse::OffsetSet {
                servo: one,
                outcome: yes,
            },
        ), // computed
        (
            "FA D2 failure",
            ServoResponse::OffsetSet {
                servo: one,
                outcome: no,
            },
        ), // computed
        (
            "FA D4 offset",
            ServoResponse::Offset {
                servo: one,
                outcome: yes,
                thirds: -90,
            },
        ), // computed
        (
            "FC 01 version",
            ServoResponse::Version {
                servo: one,
                outcome: yes,
                version: [0x41, 0x16, 0x51, 0x01],
            },
        ),
    ];
    let robot = vectors::with_meanings(vectors::alpha1_answers(), robot);
    let robot = robot
        .into_iter()
        .map(|(row, bytes, response)| (row, bytes, None, response));
    let servos = vectors::with_meanings(vectors::alpha1_servo_answers(), servos);
    let answers = [
        ServoAnswer::Acknowledgement(one),
        ServoAnswer::Angles,
        ServoAnswer::IdChanged,
        ServoAnswer::OffsetSet,
        ServoAnswer::OffsetSet,
        ServoAnswer::Offset,
        ServoAnswer::Version,
    ];
    let servos = servos.into_iter().zip(answers);
    let servos = servos.map(|((row, bytes, response), answer)| (row, bytes, Some(answer), Response::Servo(response)));
    robot.chain(servos).collect()
}

/// These bytes, which must be one frame.
fn frame_of(bytes: &[u8], expect: Expect) -> &[u8] {
    assert_eq!(Alpha1.scan(bytes, expect), Scan::Frame(bytes.len()), "{bytes:02X?}");
    bytes
}

/// The reason of the first noise in these bytes, once the line is idle.
fn noise(bytes: &[u8], expect: Expect) -> Reason {
    let mut decoder = Decoder::<_, MAX_FRAME>::new();
    assert!(decoder.push(bytes).is_empty());
    if decoder.pending() > 0 && matches!(Alpha1.scan(bytes, expect), Scan::Need(_)) {
        decoder.idle();
    }
    match decoder.next(&Alpha1, expect).map(|item| item.kind) {
        Some(Kind::Noise(reason)) => reason,
        other => panic!("{other:?}"),
    }
}

/// The text of an event, noise by its length.
fn describe(event: Event<'_, Response<'_>>) -> String {
    match event {
        Event::Noise { bytes, .. } => std::format!("Noise({})", bytes.len()),
        other => std::format!("{other:?}"),
    }
}

fn answered(response: Response<'_>) -> String {
    describe(Event::Answer(response))
}

/// A client that has sent this request.
fn sent(request: Request<'_>, config: Config) -> Client<Alpha1, MAX_FRAME> {
    let mut client = Client::new(Alpha1, config);
    client.submit(&request).unwrap();
    assert!(transmit(&mut client, Instant::ZERO) > 0);
    client
}

fn transmit(client: &mut Client<Alpha1, MAX_FRAME>, now: Instant) -> usize {
    if matches!(client.poll(now), Output::Receive) {
        client.received(now, 0).unwrap();
    }
    let Output::Transmit(bytes) = client.poll(now) else {
        return 0;
    };
    let n = bytes.len();
    client.transmitted(now, n).unwrap();
    n
}

/// The texts of all events of a client.
fn events(client: &mut Client<Alpha1, MAX_FRAME>, now: Instant) -> Vec<String> {
    core::iter::from_fn(|| match client.poll(now) {
        Output::Event(event) => Some(describe(event)),
        _ => None,
    })
    .collect()
}

/// The texts of all events of a client for these bytes while `request` is in flight, at one instant.
fn receive(request: Request<'_>, bytes: &[u8]) -> Vec<String> {
    let mut client = sent(request, Config::DEFAULT);
    let now = at(1);
    assert!(client.receive(now, bytes).is_empty());
    events(&mut client, now)
}

fn at(micros: u64) -> Instant {
    Instant::from_micros(micros)
}

/// A 64-byte report of USB HID.
fn report(frame: &[u8]) -> [u8; 64] {
    let mut report = [0; 64];
    report[..frame.len()].copy_from_slice(frame);
    report
}

#[test]
fn documented_requests_round_trip() {
    for (row, bytes, request) in requests() {
        let mut out = [0; MAX_FRAME];
        let n = Alpha1.encode_request(&request, &mut out).unwrap();
        assert_eq!(out[..n], bytes, "{row}");
        let frame = frame_of(&bytes, Expect::Requests);
        assert_eq!(Alpha1.parse_request(frame), Ok(request), "{row}");
    }
}

#[test]
fn documented_responses_round_trip() {
    for (row, bytes, answer, response) in responses() {
        let mut out = [0; MAX_FRAME];
        let n = Alpha1.encode_response(&response, None, &mut out).unwrap();
        assert_eq!(out[..n], bytes, "{row}");
        let expect = Expect::Responses(answer);
        let frame = frame_of(&bytes, expect);
        assert_eq!(Alpha1.parse_response(frame, expect), Ok(response), "{row}");
    }
}

/// Returns true if this frame answers this request.
fn answers(request: &[u8], frame: &[u8]) -> bool {
    Alpha1.is_response_to(Alpha1.request(request).unwrap().key, frame)
}

#[test]
fn documented_requests_have_responses_except_broadcasts() {
    for (row, request, _) in requests() {
        let answered = responses().iter().any(|(_, bytes, _, _)| answers(&request, bytes));
        assert_eq!(answered, Alpha1.request(&request).unwrap().response.is_some(), "{row}");
        assert_eq!(row.contains("all"), !answered, "{row}");
    }
}

#[test]
fn request_waits_for_its_longest_response() {
    for (row, request, _) in requests() {
        let responses = responses().into_iter().map(|(_, bytes, _, _)| bytes);
        let longest = responses
            .filter(|bytes| answers(&request, bytes))
            .map(|bytes| bytes.len() as u16)
            .max();
        let waits = Alpha1
            .request(&request)
            .unwrap()
            .response
            .map(|response| response.longest);
        match row {
            "F1 hardware version" => assert_eq!(waits, Some(MAX_FRAME as u16)),
            _ => assert_eq!(waits, longest, "{row}"),
        }
    }
}

#[test]
fn no_response_of_the_documents_answers_another_servo() {
    for (row, mut request, _) in requests() {
        if !row.starts_with("FA") && !row.starts_with("FC") || row.contains("all") {
            continue;
        }
        // From servo 3.
        request[2] = 3;
        for (_, bytes, _, response) in responses() {
            assert!(!answers(&request, &bytes), "{row}: {response:?}");
        }
    }
}

#[test]
fn byte_answers_only_the_requested_servo() {
    let answer = ServoAnswer::Acknowledgement(id(1));
    for (byte, answer) in [
        (0xAC, Some(answer)),
        (0x00, Some(answer)),
        (0xAB, Some(ServoAnswer::Offset)),
        (0xAB, None),
    ] {
        let error = Alpha1.parse_response(&[byte], Expect::Responses(answer)).unwrap_err();
        assert_eq!(error.cause, Cause::Unexpected.into());
    }
}

#[test]
fn damaged_print_is_rejected_with_named_error() {
    let requests = Expect::Requests;
    let responses = Expect::Responses(None);
    let tail = |got| Reason::Tail { expected: 0xED, got };
    let status = |got| Reason::Byte {
        offset: 2,
        expected: &[0xAA, 0xEE],
        got,
    };
    for (print, bytes, expect, reason) in [
        // The column CHECK of the answers has a star for F1, EF, F5 and FB, and is empty for F2, F4, F9 and F3. The
        // extracted text misplaces some stars.
        ("F2, a star", "F2 2F AA AA ED", responses, tail(0xAA)),
        ("F4, a star", "F4 4F AA AA ED", responses, tail(0xAA)),
        ("F9, a star", "F9 9F EE EE ED", responses, tail(0xEE)),
        ("F3, a star", "F3 3F AA AA ED", responses, tail(0xAA)),
        (
            "EF, no star",
            "EF FE 00 00 80 05 ED",
            responses,
            Reason::Truncated { missing: 1 },
        ),
        (
            "FB, no star",
            "FB BF 01 AA 00 00 00 00 ED",
            responses,
            Reason::Truncated { missing: 1 },
        ),
        (
            "F5, no star, then the next frame",
            "F5 5F AA 32 30 31 35 31 32 31 35 31 39 ED F2 2F AA ED",
            responses,
            tail(0xF2),
        ),
        (
            "F1, no star",
            "F1 1F 03 56 31 ED",
            responses,
            Reason::Truncated { missing: 1 },
        ),
        // "9F Success" and "0XEF 0XFE" belong to other cells than those of DATA.
        ("F9, 9F twice", "F9 9F 9F AA ED", responses, status(0x9F)),
        ("F2, a state of 01", "F2 2F 01 ED", responses, status(0x01)),
        // The cell with six zeros belongs to F1 and F2 too, and every request has CHECK.
        ("F1, no data", "F1 1F 00 ED", requests, Reason::Truncated { missing: 6 }),
        (
            "F2, no CHECK",
            "F2 2F 00 00 00 00 00 00 ED",
            requests,
            Reason::Truncated { missing: 1 },
        ),
        // The length of a text counts itself.
        (
            "F3, a length of 5",
            "F3 3F 05 64 61 6E 63 65 00 ED",
            requests,
            tail(0x00),
        ),
        // CHECK covers DATA only.
        (
            "F5, header in CHECK",
            "F5 5F 01 00 00 00 00 00 55 ED",
            requests,
            Reason::Checksum {
                expected: 0x01,
                got: 0x55,
            },
        ),
        // The "two bytes that can switch places" are the nibbles of the second byte.
        ("F1, switched", "1F F1 00 00 00 00 00 00 00 ED", requests, Reason::Stray),
        // A checksum printed on public pages about the servos.
        (
            "FA 01, 32 EA",
            "FA AF 01 01 5A 32 00 32 EA ED",
            requests,
            Reason::Checksum {
                expected: 0xC0,
                got: 0xEA,
            },
        ),
    ] {
        assert_eq!(noise(&hex(bytes), expect), reason, "{print}");
    }
}

#[test]
fn count_byte_of_a_text_includes_itself() {
    let reason = Reason::Length {
        min: 1,
        max: 255,
        got: 0,
    };
    assert_eq!(noise(&[0xF3, 0x3F, 0], Expect::Requests), reason);
    assert_eq!(noise(&[0xF1, 0x1F, 0], Expect::Responses(None)), reason);
}

#[test]
fn report_padding_is_neither_noise_nor_data() {
    for (row, bytes, answer, response) in responses() {
        let mut decoder = Decoder::<_, MAX_FRAME>::new();
        let expect = Expect::Responses(answer);
        for _ in 0..3 {
            assert!(decoder.push(&report(&bytes)).is_empty());
            let frame = decoder.next(&Alpha1, expect).unwrap();
            assert_eq!(Alpha1.parse_response(frame.bytes, expect), Ok(response), "{row}");
            while let Some(item) = decoder.next(&Alpha1, expect) {
                assert_eq!(item.kind, Kind::Padding, "{row}");
            }
            assert_eq!(decoder.pending(), 0, "{row}");
        }
    }
    for (row, bytes, request) in requests() {
        let mut device = Device::<Alpha1, MAX_FRAME>::new(Alpha1);
        assert!(device.receive(&report(&bytes)).is_empty());
        let Some(DeviceEvent::Request { request: received, .. }) = device.poll() else {
            panic!("{row}");
        };
        assert_eq!(received, request, "{row}");
        assert_eq!(device.poll(), None, "{row}");
    }
}

#[test]
fn bluetooth_frame_is_skipped_whole_in_both_directions() {
    // A handshake, a battery request, its answer, and a frame whose parameters look like an answer.
    for bytes in [
        "FB BF 06 01 00 07 ED",
        "FB BF 06 18 00 1E ED",
        "FB BF 09 18 22 DD 01 50 71 ED",
        "FB BF 09 18 F2 2F AA ED D9 ED",
    ] {
        let bytes = hex(bytes);
        for expect in [Expect::Requests, Expect::Responses(None)] {
            let error = Alpha1.parse_request(frame_of(&bytes, expect)).unwrap_err();
            assert_eq!(
                error.to_string(),
                "command FB: a frame of the robot's Bluetooth protocol"
            );
            assert_eq!(Alpha1.parse_response(&bytes, expect), Err(error));
        }
        let events = receive(Request::Stop, &[bytes, hex("F2 2F AA ED")].concat());
        assert!(events[0].starts_with("Unknown"), "{events:?}");
        assert_eq!(events[1..], [answered(Response::Stopped(Outcome::Success))]);
    }
}

#[test]
fn bluetooth_frame_is_verified_and_its_length_bounded() {
    let requests = Expect::Requests;
    let bad_sum = hex("FB BF 06 01 00 08 ED");
    let (expected, got) = (0x07, 0x08);
    assert_eq!(noise(&bad_sum, requests), Reason::Checksum { expected, got });
    for (len, sum) in [(0x3F, 0x3F), (0xFF, 0xFF)] {
        let frame = [&[0xFB, 0xBF, len][..], &[0].repeat(usize::from(len) - 4), &[sum, 0xED]].concat();
        assert_eq!(Alpha1.scan(&frame, requests), Scan::Frame(usize::from(len) + 1));
    }
    for third in [0x00, 0x02, 0x05] {
        assert_eq!(
            noise(&[0xFB, 0xBF, third], requests),
            Reason::Byte {
                offset: 2,
                expected: &[0x01],
                got: third
            }
        );
    }
}

#[test]
fn servo_request_echo_neither_answers_nor_hides_answers() {
    for (row, bytes, request) in requests() {
        let Request::Servo(_) = request else { continue };
        let expect = Alpha1.request(&bytes).unwrap().expect;
        for (_, frame, answer, response) in responses() {
            if expect == Expect::Responses(answer) && answers(&bytes, &frame) {
                let line = [bytes.clone(), frame].concat();
                assert_eq!(
                    receive(request, &line),
                    ["Echo".to_string(), answered(response)],
                    "{row}"
                );
            }
        }
        let mut events = receive(request, &bytes);
        events.retain(|event| event != "Sent");
        assert_eq!(events, ["Echo"], "{row}");
    }
}

#[test]
fn every_servo_is_received_with_or_without_echo() {
    for n in 1..=240 {
        let request = Request::Servo(moving(Address::One(id(n))));
        let answer = answered(Response::Servo(ServoResponse::Acknowledged(id(n))));
        let mut line = [0; MAX_FRAME];
        let len = Alpha1.encode_request(&request, &mut line).unwrap();
        line[len] = 0xAA_u8.wrapping_add(n);
        for (from, expected) in [(0, &["Echo".to_string(), answer.clone()][..]), (len, &[answer])] {
            let mut client = sent(request, Config::DEFAULT);
            assert!(client.receive(at(900), &line[from..=len]).is_empty());
            let mut actual = events(&mut client, at(900));
            // Some bytes may begin a frame, until the line goes idle or the answer times out.
            let header = [69, 71, 72, 73, 74, 75, 79, 80, 81, 82].contains(&n);
            assert_eq!(actual == expected, !header, "servo {n}");
            while let Output::Timeout(Some(due)) = client.poll(at(901)) {
                actual.extend(events(&mut client, due));
                if client.is_idle() {
                    break;
                }
            }
            assert_eq!(actual, expected, "servo {n}");
        }
    }
}

#[test]
fn idle_line_separates_servo_80_byte_from_echo() {
    let mut client = sent(Request::Servo(moving(Address::One(id(80)))), Config::DEFAULT);
    assert!(client.receive(at(900), &[0xFA]).is_empty());
    assert_eq!(events(&mut client, at(900)), [""; 0]);
    client.idle();
    let answer = answered(Response::Servo(ServoResponse::Acknowledged(id(80))));
    assert_eq!(events(&mut client, at(950)), [answer]);
}

#[test]
fn byte_of_another_servo_is_not_an_answer() {
    let request = Request::Servo(moving(Address::One(id(2))));
    let answer = Response::Servo(ServoResponse::Acknowledged(id(2)));
    let events = receive(request, &[0xAB, 0xAD, 0xAC]);
    assert_eq!(events, ["Noise(2)".to_string(), answered(answer)]);
    // Neither is its own byte, while a frame is expected.
    let events = receive(Request::Servo(ServoRequest::ReadOffset(id(1))), &[0xAB, 0x00]);
    assert_eq!(events, ["Noise(1)"]);
}

#[test]
fn byte_before_its_request_is_ignored() {
    let mut client = Client::<Alpha1, MAX_FRAME>::new(Alpha1, Config::DEFAULT);
    client.submit(&Request::Servo(moving(Address::One(id(1))))).unwrap();
    assert!(client.receive(at(0), &[0xAB]).is_empty());
    assert_eq!(events(&mut client, at(50)), ["Noise(1)"]);
    assert!(!client.is_idle());
}

#[test]
fn late_byte_does_not_answer_the_next_request() {
    let request = Request::Servo(moving(Address::One(id(1))));
    let byte = Response::Servo(ServoResponse::Acknowledged(id(1)));
    let mut client = sent(request, Config::DEFAULT);
    let Output::Timeout(Some(due)) = client.poll(at(0)) else {
        panic!("no timeout")
    };
    assert_eq!(events(&mut client, due), ["TimedOut { sends: 1 }"]);

    // The same servo again: the request waits for the stale byte, which would look like its answer.
    client.submit(&request).unwrap();
    assert_eq!(transmit(&mut client, due), 0);
    assert!(client.receive(due, &[0xAB]).is_empty());
    assert_eq!(events(&mut client, due), [describe(Event::Late(byte))]);
    assert_eq!(transmit(&mut client, due), 10);
    assert!(client.receive(due, &[0xAB]).is_empty());
    assert_eq!(events(&mut client, due), [answered(byte)]);
}

#[test]
fn late_byte_is_recognised_during_unanswered_request() {
    let release = |who| Request::Servo(ServoRequest::Release(who));
    let mut client = sent(release(Address::One(id(1))), Config::DEFAULT);
    let Output::Timeout(Some(due)) = client.poll(at(0)) else {
        panic!("no timeout")
    };
    assert_eq!(events(&mut client, due), ["TimedOut { sends: 1 }"]);
    client.submit(&release(Address::All)).unwrap();
    assert_eq!(client.poll(due), Output::Receive);
    client.received(due, 0).unwrap();
    assert!(matches!(client.poll(due), Output::Transmit(_)));
    client.transmitted(due, 1).unwrap();
    assert!(client.receive(due, &[0xAB]).is_empty());
    let byte = Response::Servo(ServoResponse::Acknowledged(id(1)));
    assert_eq!(events(&mut client, due), [describe(Event::Late(byte))]);
}

#[test]
fn zero_is_servo_86_answer_then_padding() {
    let request = Request::Servo(moving(Address::One(id(86))));
    let answer = Response::Servo(ServoResponse::Acknowledged(id(86)));
    assert_eq!(receive(request, &report(&[0x00])), [answered(answer)]);
    // While another answer is expected, zeros are padding.
    let request = Request::Servo(moving(Address::One(id(1))));
    let answer = Response::Servo(ServoResponse::Acknowledged(id(1)));
    assert_eq!(receive(request, &[0x00, 0x00, 0xAB, 0x00]), [answered(answer)]);
}

#[test]
fn every_servo_byte_is_received_in_a_report() {
    for n in 1..=240 {
        let request = Request::Servo(moving(Address::One(id(n))));
        let answer = Response::Servo(ServoResponse::Acknowledged(id(n)));
        let line = report(&[0xAA_u8.wrapping_add(n)]);
        assert_eq!(receive(request, &line), [answered(answer)], "servo {n}");
    }
}

#[test]
fn frame_of_another_servo_is_not_an_answer() {
    let (_, bytes, _, response) = responses().into_iter().last().unwrap();
    let request = Request::Servo(ServoRequest::ReadVersion(id(2)));
    assert_eq!(receive(request, &bytes), [describe(Event::Unsolicited(response))]);
}

#[test]
fn unrequested_servo_frame_is_reported_as_such() {
    let frame = hex("FA AF 01 AA 00 5A 00 5A 5F ED");
    let error = Alpha1.parse_response(&frame, Expect::Responses(None)).unwrap_err();
    assert_eq!(
        error.to_string(),
        "command FA: an answer of a servo, but none is expected"
    );
    for request in [Request::Stop, Request::Servo(moving(Address::One(id(1))))] {
        assert_eq!(
            receive(request, &frame),
            [describe(Event::Unknown { frame: &frame, error })]
        );
    }
}

#[test]
fn valid_frame_without_request_names_the_reason() {
    for (bytes, message) in [
        (
            "FC CF 01 02 00 00 00 00 03 ED",
            "command FC: it would start a servo's boot loader, which is not offered",
        ),
        (
            "FC CF 00 01 00 00 00 00 01 ED",
            "command FC: servo id is 0, must be 1..=240 (data byte 0)",
        ),
        (
            "FA AF 00 02 00 00 00 00 02 ED",
            "command FA: servo id is 0, must be 1..=240 (data byte 0)",
        ),
        (
            "FA AF F1 01 5A 32 00 32 B0 ED",
            "command FA: servo id is 241, must be 1..=240 (data byte 0)",
        ),
        (
            "FA AF 01 CD 00 F1 00 00 BF ED",
            "command FA: servo id is 241, must be 1..=240 (data byte 3)",
        ),
        (
            "FA AF 01 CD 00 02 00 01 D1 ED",
            "command FA: data byte 5 is 01, must be 00",
        ),
        (
            "FA AF 01 CD 01 02 00 00 D1 ED",
            "command FA: data byte 2 is 01, must be 00",
        ),
        (
            "FA AF 01 D2 00 00 00 5B 2E ED",
            "command FA: servo offset is 91 thirds of a degree, must be -90..=90 (data byte 4)",
        ),
        (
            "FA AF 01 AA 00 00 00 00 AB ED",
            "command FA: data byte 1 is AA, must be 01 or 02 or 04 or CD or D2 or D4",
        ),
        (
            "F4 4F 01 02 00 00 00 00 03 ED",
            "command F4: data byte 1 is 02, must be 00 or 01",
        ),
        (
            "F9 9F 00 00 00 00 00 00 00 ED",
            "command F9: data byte 0 is 00, must be 01 or 02 or 03",
        ),
        (
            "F4 4F 01 01 00 00 00 05 07 ED",
            "command F4: data byte 5 is 05, must be 00",
        ),
        (
            "F4 4F 02 01 00 00 00 00 03 ED",
            "command F4: data byte 0 is 02, must be 01",
        ),
        (
            "F9 9F 01 00 09 00 00 00 0A ED",
            "command F9: data byte 2 is 09, must be 00",
        ),
        (
            "FA AF 01 04 01 00 00 02 08 ED",
            "command FA: data byte 5 is 02, must be 00",
        ),
        (
            "FA AF 01 02 01 00 00 00 04 ED",
            "command FA: data byte 2 is 01, must be 00",
        ),
        (
            "FC CF 01 01 00 00 01 00 03 ED",
            "command FC: data byte 4 is 01, must be 00",
        ),
        (
            "F1 1F 00 00 00 00 00 07 07 ED",
            "command F1: data byte 5 is 07, must be 00",
        ),
        (
            "F5 5F 00 00 00 00 00 00 00 ED",
            "command F5: data byte 0 is 00, must be 01",
        ),
    ] {
        let bytes = hex(bytes);
        let error = Alpha1.parse_request(frame_of(&bytes, Expect::Requests)).unwrap_err();
        assert_eq!(std::format!("{error}"), message);
    }
}

#[test]
fn firmware_version_without_status_names_the_position() {
    let mut bytes = hex("F5 5F AA 32 30 31 35 31 32 31 35 31 39 A5 ED");
    (bytes[2], bytes[13]) = (0xAB, 0xA6);
    let expect = Expect::Responses(None);
    let error = Alpha1.parse_response(frame_of(&bytes, expect), expect).unwrap_err();
    assert_eq!(
        std::format!("{error}"),
        "command F5: data byte 0 is AB, must be AA or EE"
    );
}

#[test]
fn every_action_byte_but_ff_is_an_angle() {
    let Request::Act(action) = acting() else { unreachable!() };
    let mut out = [0; MAX_FRAME];
    let n = Alpha1.encode_request(&Request::Act(action), &mut out).unwrap();
    for byte in 0..=u8::MAX {
        out[8] = byte;
        out[n - 2] = checksum(&out[2..n - 2]);
        let parsed = Alpha1.parse_request(frame_of(&out[..n], Expect::Requests)).unwrap();
        let Request::Act(action) = parsed else { unreachable!() };
        assert_eq!(action.angles[0].map(Angle::raw), (byte != 0xFF).then_some(byte));
        let degrees = action.angles[0].and_then(Angle::degrees);
        assert_eq!(degrees, (byte <= 240).then_some(byte));
    }
}

#[test]
fn only_reads_that_move_nothing_are_repeated() {
    for (row, request, _) in requests() {
        let read = ["version", "states", "read offset"]
            .iter()
            .any(|word| row.contains(word));
        assert_eq!(Alpha1.request(&request).unwrap().effect == Effect::Read, read, "{row}");
    }
}

#[test]
fn servo_answers_within_400_microseconds() {
    let request = Request::Servo(moving(Address::One(id(1))));
    let config = Config {
        baud: NonZeroU32::new(115_200),
        latency: time::Duration::ZERO,
        ..Config::DEFAULT
    };
    let mut client = sent(request, config);
    // Eleven bytes on the wire, plus the servo's turnaround.
    assert_eq!(client.poll(at(0)), Output::Timeout(Some(at(955 + 400))));
    assert_eq!(events(&mut client, at(1_355)), ["TimedOut { sends: 1 }"]);
}

#[test]
fn no_duration_is_cut_short_or_rounded_away() {
    let ms = Duration::from_millis;
    for (duration, units) in [(0, 0), (9, 0), (10, 1), (29, 1), (30, 2), (5_090, 255), (5_100, 255)] {
        assert_eq!(MoveTime::from_duration(ms(duration)).unwrap().units(), units);
    }
    assert!(MoveTime::from_duration(ms(5_101)).is_err());
    assert_eq!(Interval::from_duration(ms(1_310_700)), Ok(Interval::MAX));
    for duration in [ms(1_310_701), Duration::MAX] {
        assert!(Interval::from_duration(duration).is_err());
    }
    for units in 0..=u16::MAX {
        let interval = Interval::new(units);
        assert_eq!(Interval::from_duration(interval.duration()), Ok(interval));
    }
}

#[test]
fn zeros_between_servo_frames_are_padding_at_once() {
    let expect = Expect::Responses(Some(ServoAnswer::Angles));
    for (window, zeros) in [(&[0][..], 1), (&[0, 0, 0, 0], 4), (&[0, 0, 0xFA], 2)] {
        assert_eq!(Alpha1.scan(window, expect), Scan::Padding(zeros), "{window:x?}");
    }
}

#[test]
fn parse_rejects_a_missing_second_header_byte() {
    let frame = hex("FB BF 06 01 ED");
    assert!(Frame::parse(&frame).is_some());
    let other = hex("FB BE 06 01 ED");
    assert_eq!(Frame::parse(&other), None);
}

#[test]
fn set_bit_means_a_running_servo() {
    let states = ServoStates::from_bits(0x8000_0005);
    assert!(states.running().eq([1, 3, 32]));
}

#[test]
fn printable_text_is_kept_unchanged() {
    assert_eq!(name("dance").as_str(), Some("dance"));
    assert_eq!(Text::new(b"\x1b[31m").unwrap().as_str(), None);
}

#[test]
fn bytes_without_a_header_are_stray_at_once() {
    let expect = Expect::Responses(None);
    for (window, stray) in [(&[1][..], 1), (&[1, 2, 3], 3), (&[1, 2, 3, 0], 3), (&[1, 2, 0xFA], 2)] {
        let verdict = Scan::Noise(stray, Reason::Stray);
        assert_eq!(Alpha1.scan(window, expect), verdict, "{window:x?}");
    }
}

#[test]
fn unexpected_frame_delays_nothing() {
    // In a host's stream they begin a request. From servo 5, AF is an answer.
    let expect = Expect::Responses(Some(ServoAnswer::Acknowledgement(id(5))));
    let mut decoder = Decoder::<_, MAX_FRAME>::new();
    assert!(decoder.push(&hex("F1 1F 00")).is_empty());
    assert!(decoder.next(&Alpha1, Expect::Requests).is_none());
    assert!(decoder.push(&hex("AF")).is_empty());
    let mut frames = 0;
    while let Some(item) = decoder.next(&Alpha1, expect) {
        frames += usize::from(item.kind == Kind::Frame && item.bytes == [0xAF]);
    }
    assert_eq!(frames, 1);
}
