//! Every example frame of the document, and the frames it should have printed.

extern crate std;

use std::string::ToString;
use std::vec::Vec;

use super::*;
use crate::{Client, Config, Decoder, Device, Event, Framing, Heard, Input, Micros, Protocol, Reason};

/// A frame written in hex.
fn hex(text: &str) -> Vec<u8> {
    text.split_whitespace()
        .map(|byte| u8::from_str_radix(byte, 16).unwrap())
        .collect()
}

fn moving(gripper: u16) -> Request {
    Request::Move(Move {
        joints: [(Position::CENTRE, Speed::new(1000).unwrap()); 6],
        gripper: (Opening::new(gripper).unwrap(), GripperSpeed(1000)),
    })
}

/// Section, frame, meaning. In the order of the document; those marked *corrected* are printed with the checksum of
/// another frame, those marked *computed* are not printed at all.
fn requests() -> Vec<(&'static str, Vec<u8>, Request)> {
    let home = "00 08 E8 03 00 08 E8 03 00 08 E8 03 00 08 E8 03 00 08 E8 03 00 08 E8 03";
    let limit = TemperatureLimit::new(100).unwrap();
    Vec::from([
        ("2.1 information", hex("AA 01 00 01 FE 23 FF"), Request::ReadInfo),
        ("2.2 zero", hex("AA 03 00 01 FE A8 FF"), Request::SetZero),
        (
            "2.3 set 100 mm",
            hex("AA 04 02 01 FE 7F FF"),
            Request::SetStroke(Stroke::Mm100),
        ),
        (
            "2.3 set 50 mm, computed",
            hex("AA 04 00 01 FE 11 FF"),
            Request::SetStroke(Stroke::Mm50),
        ),
        (
            "2.3 set 75 mm, computed",
            hex("AA 04 01 01 FE 26 FF"),
            Request::SetStroke(Stroke::Mm75),
        ),
        ("2.3 query, corrected", hex("AA 04 0E 01 FE 1B FF"), Request::ReadStroke),
        (
            "2.4 torque off",
            hex("AA 05 00 01 00 6F FF"),
            Request::SetTorque(Torque::Off),
        ),
        (
            "2.4 torque on, computed",
            hex("AA 05 00 01 01 F9 FF"),
            Request::SetTorque(Torque::On),
        ),
        ("2.5 position", hex("AA 06 00 01 FE 9A FF"), Request::ReadJoints),
        (
            "2.5 temperature",
            hex("AA 06 01 01 FE AD FF"),
            Request::ReadTemperatures,
        ),
        (
            "2.5 threshold",
            hex("AA 06 01 01 64 F7 FF"),
            Request::SetTemperatureLimit(limit),
        ),
        ("2.5 velocity", hex("AA 06 02 01 FE F4 FF"), Request::ReadVelocities),
        (
            "2.5 control",
            hex(&std::format!("AA 06 03 1C {home} F4 01 E8 03 6A FF")),
            moving(500),
        ),
        (
            "2.5 control, computed",
            hex(&std::format!("AA 06 03 1C {home} E8 03 E8 03 23 FF")),
            moving(1000),
        ),
        ("2.6 self-check", hex("AA FE 00 00 FE 93 FF"), Request::SelfCheck),
    ])
}

fn responses() -> Vec<(&'static str, Vec<u8>, Response)> {
    Vec::from([
        (
            "2.1 information",
            hex("AA 01 00 18 41 44 4C 53 32 35 31 32 30 35 31 32 33 34 35 36 6E 00 00 00 62 02 00 00 92 FF"),
            Response::Info(Info {
                serial: SerialNumber(*b"ADLS251205123456"),
                hardware: Version(110),
                firmware: Version(610),
            }),
        ),
        (
            "2.3 stroke 75 mm, corrected",
            hex("AA 04 0E 01 01 96 FF"),
            Response::Stroke(Stroke::Mm75),
        ),
        (
            "2.3 stroke 50 mm, computed",
            hex("AA 04 0E 01 00 00 FF"),
            Response::Stroke(Stroke::Mm50),
        ),
        (
            "2.3 stroke 100 mm, computed",
            hex("AA 04 0E 01 02 2C FF"),
            Response::Stroke(Stroke::Mm100),
        ),
        (
            "2.5 position",
            hex("AA 06 00 0F 02 08 FB 07 FB 07 02 08 FA 07 01 08 03 08 00 A9 FF"),
            Response::Joints(JointState {
                joints: [2050, 2043, 2043, 2050, 2042, 2049],
                gripper: 2051,
                status: MotionStatus::Idle,
            }),
        ),
        (
            "2.5 temperature",
            hex("AA 06 01 0A 23 24 23 26 23 26 23 25 24 24 4B FF"),
            Response::Temperatures(PerServo::Follower([35, 36, 35, 38, 35, 38, 35, 37, 36, 36])),
        ),
        (
            "2.5 velocity",
            hex("AA 06 02 14 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 E9 FF"),
            Response::Velocities(PerServo::Follower([0; 10])),
        ),
        (
            "2.6 self-check",
            hex("AA FE 00 02 FF 03 87 FF"),
            Response::SelfCheck(SelfCheck(0x3FF)),
        ),
        (
            "2.6 leader, computed",
            hex("AA FE 00 02 3F 00 73 FF"),
            Response::SelfCheck(SelfCheck(0x3F)),
        ),
    ])
}

/// The one frame that `bytes` are.
fn frame_of(bytes: &[u8]) -> Frame<'_> {
    use crate::{Framing, Scan};
    assert_eq!(Ling::scan(bytes, ()), Scan::Frame(bytes.len()));
    Ling::view(bytes).unwrap()
}

#[test]
fn every_request_of_the_document_holds_in_both_directions() {
    for (section, bytes, request) in requests() {
        let mut out = [0; MAX_FRAME];
        let n = Ling::encode_request(&request, &mut out).unwrap();
        assert_eq!(out[..n], bytes, "{section}");
        assert_eq!(Ling::parse_request(frame_of(&bytes)), Ok(request), "{section}");
    }
}

#[test]
fn every_response_of_the_document_holds_in_both_directions() {
    for (section, bytes, response) in responses() {
        let mut out = [0; MAX_FRAME];
        let n = Ling::encode_response(&response, &mut out).unwrap();
        assert_eq!(out[..n], bytes, "{section}");
        assert_eq!(Ling::parse_response(frame_of(&bytes), ()), Ok(response), "{section}");
    }
}

#[test]
fn every_frame_of_the_document_means_the_same_however_it_is_cut() {
    let requests = requests().into_iter().map(|(_, bytes, _)| bytes);
    let responses = responses().into_iter().map(|(_, bytes, _)| bytes);
    for bytes in requests.chain(responses) {
        for first in 0..=bytes.len() {
            for second in first..=bytes.len() {
                let mut decoder = Decoder::<Ling, MAX_FRAME>::new();
                let mut frames = 0;
                for chunk in [&bytes[..first], &bytes[first..second], &bytes[second..]] {
                    assert!(decoder.push(chunk).is_empty());
                    while let Some(frame) = decoder.next(()) {
                        assert_eq!(frame, Ok(frame_of(&bytes)));
                        frames += 1;
                    }
                }
                assert_eq!(
                    (frames, decoder.pending()),
                    (1, 0),
                    "{bytes:02X?} cut at {first}, {second}"
                );
            }
        }
    }
}

#[test]
fn the_two_frames_printed_with_a_wrong_checksum_are_rejected_and_say_so() {
    // Section 2.3 prints the checksum of "set 100 mm" in the query and in its answer.
    for (printed, expected) in [("AA 04 0E 01 FE 7F FF", 0x1B), ("AA 04 0E 01 01 7F FF", 0x96)] {
        let mut decoder = Decoder::<Ling, MAX_FRAME>::new();
        assert!(decoder.push(&hex(printed)).is_empty());
        let noise = decoder.next(()).unwrap().unwrap_err();
        assert_eq!(noise.reason, Reason::Checksum { expected, got: 0x7F });
    }
}

#[test]
fn a_device_accepts_the_self_check_as_printed_and_in_both_well_formed_spellings() {
    for spelling in ["AA FE 00 00 FE 93 FF", "AA FE 00 00 C8 FF", "AA FE 00 01 FE D2 FF"] {
        for chunk in 1..=7 {
            let mut device = Device::<Ling, MAX_FRAME>::new();
            let mut heard = Vec::new();
            for bytes in hex(spelling).chunks(chunk) {
                let mut input = Input::Bytes(bytes);
                while let Some(event) = device.handle(&mut input) {
                    heard.push(event);
                }
            }
            assert_eq!(
                heard,
                [Heard::Request(Request::SelfCheck)],
                "{spelling} in chunks of {chunk}"
            );
        }
    }
}

#[test]
fn only_the_self_check_has_slack_in_its_length() {
    let mut decoder = Decoder::<Ling, MAX_FRAME>::new();
    let body = [0x06, 0x00, 0x00, 0xFE];
    assert!(
        decoder
            .push(&[0xAA, 0x06, 0x00, 0x00, 0xFE, checksum(&body), 0xFF])
            .is_empty()
    );
    assert!(decoder.next(()).unwrap().is_err());
}

#[test]
fn leader_arms_send_six_readings() {
    for response in [
        Response::Temperatures(PerServo::Leader([30; 6])),
        Response::Velocities(PerServo::Leader([1, 2, 3, 4, 5, 5000])),
    ] {
        let mut out = [0; MAX_FRAME];
        let n = Ling::encode_response(&response, &mut out).unwrap();
        assert_eq!(Ling::parse_response(frame_of(&out[..n]), ()), Ok(response));
    }
}

#[test]
fn a_reply_of_the_wrong_length_names_the_lengths_it_may_have() {
    let frame = Frame {
        command: 0x06,
        function: 0x01,
        data: &[35; 7],
    };
    let error = Ling::parse_response(frame, ()).unwrap_err();
    assert_eq!(
        std::format!("{error}"),
        "command 06 function 01: 7 data bytes, expected 6 or 10"
    );
}

#[test]
fn a_value_out_of_range_is_an_error_that_says_where() {
    let mut out = [0; MAX_FRAME];
    let n = Ling::encode_request(&moving(0), &mut out).unwrap();
    out[4 + 9] = 0x10; // joint 3: 0x1000 ticks
    let frame = Frame {
        command: 0x06,
        function: 0x03,
        data: &out[4..n - 2],
    };
    let error = Ling::parse_request(frame).unwrap_err();
    assert_eq!(
        std::format!("{error}"),
        "command 06 function 03: joint position is 4096 ticks, must be 0..=4095 (data byte 8)"
    );
}

#[test]
fn the_gripper_may_be_told_speeds_that_joints_may_not() {
    let request = Request::Move(Move {
        joints: [(Position::MAX, Speed::MAX); 6],
        gripper: (Opening::OPEN, GripperSpeed(5500)),
    });
    let mut out = [0; MAX_FRAME];
    let n = Ling::encode_request(&request, &mut out).unwrap();
    assert_eq!(Ling::parse_request(frame_of(&out[..n])), Ok(request));
}

#[test]
fn no_request_can_be_mistaken_for_a_response() {
    for (section, bytes, _) in requests() {
        assert!(Ling::parse_response(frame_of(&bytes), ()).is_err(), "{section}");
        let mut client = Client::<Ling, MAX_FRAME>::new(Config::DEFAULT);
        let event = client.handle(Micros(0), &mut Input::Bytes(&bytes));
        assert_eq!(event, Some(Event::Echo), "{section}");
    }
}

#[test]
fn the_longest_frame_has_64_bytes_of_data() {
    assert_eq!(MAX_FRAME, 70);
    let frame = Frame {
        command: 6,
        function: 0,
        data: &[7; 64],
    };
    let mut out = [0; MAX_FRAME];
    assert_eq!(frame.encode(&mut out), Ok(70));
    assert_eq!(Ling::view(&out), Some(frame));
    assert_eq!(Frame { data: &[], ..frame }.encode(&mut out), Ok(6));
    assert!(
        Frame {
            data: &[7; 65],
            ..frame
        }
        .encode(&mut out)
        .is_err()
    );
}

#[test]
fn a_self_check_with_more_data_than_either_print_has_is_refused() {
    let frame = |data| Frame {
        command: SELF_CHECK[1],
        function: 0,
        data,
    };
    assert_eq!(Ling::parse_request(frame(&[])), Ok(Request::SelfCheck));
    assert_eq!(Ling::parse_request(frame(&[0xFE])), Ok(Request::SelfCheck));
    for data in [&[0xFE, 0xFE][..], &[0]] {
        assert!(Ling::parse_request(frame(data)).is_err(), "{data:x?}");
    }
}

#[test]
fn a_move_that_is_out_of_range_says_at_which_byte() {
    let home = [0x00, 0x08, 0xE8, 0x03].repeat(7);
    for offset in (0..26).step_by(2) {
        let mut data = home.clone();
        data[offset..offset + 2].copy_from_slice(&[0xFF, 0xFF]);
        let error = Ling::parse_request(Frame {
            command: 6,
            function: 3,
            data: &data,
        });
        let error = error.unwrap_err();
        assert!(
            matches!(error.cause, Cause::Value { offset: at, .. } if at == offset),
            "{offset}: {error:?}"
        );
    }
}

#[test]
fn what_follows_a_frame_that_was_pushed_half_is_left_to_the_caller() {
    let query = hex("AA 06 00 01 FE 9A FF");
    let mut decoder = Decoder::<Ling, MAX_FRAME>::new();
    assert!(decoder.push(&query[..5]).is_empty());
    assert!(decoder.next(()).is_none());
    let mut rest = &[&query[5..], &query].concat()[..];
    assert!(decoder.decode(&mut rest, ()).unwrap().is_ok());
    assert_eq!((rest, decoder.pending()), (&query[..], 0));
}

#[test]
fn there_is_nothing_to_wait_for_while_the_end_of_a_cancelled_request_is_not_sent() {
    let mut client = Client::<Ling, MAX_FRAME>::new(Config::default());
    client.submit(Request::ReadJoints).unwrap();
    assert_eq!(client.poll_transmit(Micros(0)).unwrap().len(), 7);
    client.transmitted(Micros(0), 3).unwrap();
    client.cancel(Micros(0));
    client.submit(Request::ReadInfo).unwrap();
    assert_eq!(client.poll_timeout(), None);
    assert_eq!(client.poll_transmit(Micros(0)).unwrap().len(), 4);
}

#[test]
fn a_request_that_comes_back_says_why() {
    let mut client = Client::<Ling, MAX_FRAME>::new(Config::default());
    client.submit(Request::ReadJoints).unwrap();
    let busy = client.submit(Request::ReadInfo).unwrap_err();
    assert_eq!(busy.to_string(), "a request is already in flight");
}

#[test]
fn an_answer_that_has_begun_when_it_is_due_gets_the_time_to_end() {
    let joints = hex("AA 06 00 0F 00 08 00 08 00 08 00 08 00 08 00 08 00 08 00");
    let mut answer = [0; MAX_FRAME];
    let frame = Frame {
        command: 0x06,
        function: 0,
        data: &joints[4..],
    };
    let len = frame.encode(&mut answer).unwrap();
    let (first, second) = answer[..len].split_at(10);

    let mut client = Client::<Ling, MAX_FRAME>::new(Config::default());
    client.submit(Request::ReadJoints).unwrap();
    let sent = client.poll_transmit(Micros(0)).unwrap().len();
    client.transmitted(Micros(0), sent).unwrap();
    let due = client.poll_timeout().unwrap();
    assert_eq!(client.handle(Micros(due.0 - 1), &mut Input::Bytes(first)), None);
    assert_eq!(client.handle(due, &mut Input::Tick), None);
    let later = due + Micros(5_000);
    assert!(client.poll_timeout().unwrap() > later);
    let event = client.handle(later, &mut Input::Bytes(second));
    assert!(matches!(event, Some(Event::Answer(Response::Joints(_)))), "{event:?}");
}

#[test]
fn what_comes_first_behind_an_idle_line_is_taken_whole() {
    let query = hex("AA 06 00 01 FE 9A FF");
    let mut decoder = Decoder::<Ling, MAX_FRAME>::new();
    assert_eq!(decoder.idle(()), None);
    let line = [&[0x11, 0x22][..], &query, &query[..2]].concat();
    let mut rest = &line[..];
    let mut frames = 0;
    while let Some(next) = decoder.decode(&mut rest, ()) {
        frames += usize::from(next.is_ok());
    }
    assert_eq!((frames, rest.len(), decoder.pending()), (1, 0, 2));
}

#[test]
fn nothing_that_changes_the_arm_may_be_repeated() {
    for request in [
        Request::SetZero,
        Request::SetStroke(Stroke::Mm50),
        Request::SetTorque(Torque::On),
        moving(0),
    ] {
        assert!(!Ling::repeatable(&request), "{request:?}");
    }
    assert!(Ling::repeatable(&Request::ReadJoints));
}

#[test]
fn a_serial_number_says_which_arm_it_is() {
    let kind = |text: &[u8; 16]| SerialNumber(*text).kind();
    assert_eq!(kind(b"ADLS251205123456"), Some(Kind::Leader));
    assert_eq!(kind(b"ADFS251205123456"), Some(Kind::Follower));
    assert_eq!(kind(b"ADXS251205123456"), None);
}
