//! Frames sent by arms of the older generation, and their decoding.

extern crate std;

use std::string::ToString;
use std::vec::Vec;

use super::*;
use crate::decoder::{Decoder, Kind};
use crate::framing::{Framing, Reason, Scan};
use crate::hex::hex;
use crate::ling::Ling;
use crate::messages::Messages;
use crate::time::Instant;
use crate::vectors;
use crate::{Cause, Client, Config, Device, DeviceEvent, Event, Output};

/// Name, frame, meaning. Two were published by users, in the issues of the vendor's package (numbers 12 and 11); the
/// others are computed.
fn responses() -> Vec<(&'static str, Vec<u8>, Response)> {
    let gripper = GripperState {
        firmware: Firmware::V6_0,
        id: 1,
        servo: 2051,
        potentiometer: 2303,
        sync_button: 0,
        attitude_button: 1,
    };
    let joints = JointState {
        firmware: Firmware::V6_0,
        servos: [1961, 1961, 3302, 793, 1645, 2450, 1839, 1261, 2177],
    };
    let meanings = [
        ("joints, issue 12", Response::Joints(joints)),
        (
            "joints, issue 11",
            Response::Joints(JointState {
                servos: [3096, 3091, 3248, 846, 1679, 2410, 1938, 1368, 1609],
                ..joints
            }),
        ),
        (
            "joints, firmware 5",
            Response::Joints(JointState {
                firmware: Firmware::V5,
                ..joints
            }),
        ), // computed
        ("gripper", Response::Gripper(gripper)), // computed
        (
            "gripper, firmware 5",
            Response::Gripper(GripperState {
                firmware: Firmware::V5,
                ..gripper
            }),
        ), // computed
    ];
    vectors::with_meanings(vectors::legacy(), meanings)
}

#[test]
fn every_frame_holds_in_both_directions() {
    for (name, bytes, response) in responses() {
        let mut out = [0; MAX_FRAME];
        let n = Legacy.encode_response(&response, None, &mut out).unwrap();
        assert_eq!(out[..n], bytes, "{name}");
        assert_eq!(Legacy.scan(&bytes, ()), Scan::Frame(n), "{name}");
        assert_eq!(Legacy.parse_response(&bytes, ()), Ok(response), "{name}");
    }
}

#[test]
fn joint_is_the_first_servo_of_its_pair() {
    let (_, _, response) = responses().swap_remove(1);
    let Response::Joints(state) = response else {
        panic!("{response:?}");
    };
    assert_eq!(state.joints(), [3096, 3248, 1679, 1938, 1368, 1609]);
}

#[test]
fn servo_pairs_agree_in_recorded_frames() {
    for (source, _, response) in responses() {
        if let Response::Joints(state) = response {
            let [a1, a2, b1, b2, c1, c2, ..] = state.servos;
            for (one, other) in [(a1, a2), (b1, 4096 - b2), (c1, 4096 - c2)] {
                assert!(one.abs_diff(other) < 8, "{source}: {one} and {other}");
            }
        }
    }
}

#[test]
fn wrong_parity_and_missing_end_name_expected_values() {
    let (_, good, _) = responses().remove(0);
    let n = good.len();
    for (at, byte, reason) in [
        (3, 0xA8, Reason::Checksum { expected: 1, got: 0 }),
        (n - 2, 0x02, Reason::Checksum { expected: 0, got: 2 }),
        (n - 1, 0x00, Reason::Tail { expected: 0xFF, got: 0 }),
        (
            2,
            60,
            Reason::Length {
                min: 0,
                max: 59,
                got: 60,
            },
        ),
    ] {
        let mut bytes = good.clone();
        bytes[at] = byte;
        assert_eq!(Legacy.scan(&bytes, ()), Scan::Noise(1, reason));
    }
}

#[test]
fn parity_misses_seven_bits_in_eight() {
    let (_, good, response) = responses().remove(0);
    let missed = (8 * 3..8 * 21).filter(|bit| {
        let mut bytes = good.clone();
        bytes[bit / 8] ^= 1 << (bit % 8);
        matches!(Legacy.scan(&bytes, ()), Scan::Frame(_)) && Legacy.parse_response(&bytes, ()) != Ok(response)
    });
    assert_eq!(missed.count(), 18 * 7, "seven bits in eight are not covered");
}

#[test]
fn longest_frame_fits_an_exact_buffer() {
    let data = [7; MAX_DATA];
    let frame = Frame {
        command: 6,
        data: &data,
    };
    let mut bytes = [0; MAX_FRAME];
    assert_eq!(frame.put(&mut bytes), Ok(MAX_FRAME));
    let mut decoder = Decoder::<_, MAX_FRAME>::new();
    assert!(decoder.push(&bytes).is_empty());
    let item = decoder.next(&Legacy, ()).unwrap();
    assert_eq!((item.kind, Frame::parse(item.bytes)), (Kind::Frame, Some(frame)));
}

#[test]
fn valid_frame_without_message_is_distinguished() {
    let parse = |text: &str| Legacy.parse_response(&hex(text), ()).unwrap_err();
    assert_eq!(parse("AA 0A 03 05 04 13 00 FF").to_string(), "command 0A: unknown");
    let error = parse("AA 12 03 05 04 13 00 FF");
    assert_eq!(error.cause, Cause::Length { expected: &[7], got: 3 });
}

#[test]
fn device_reports_every_frame_as_unknown() {
    let mut device = Device::<Legacy, MAX_FRAME>::new(Legacy);
    assert!(device.receive(&hex("AA 13 01 00 00 FF")).is_empty());
    let Some(DeviceEvent::Unknown { error, key: None, .. }) = device.poll() else {
        panic!("another event");
    };
    assert_eq!(error.to_string(), "command 13: unknown");
}

#[test]
fn client_reads_and_never_has_bytes_to_send() {
    let mut client = Client::<Legacy, MAX_FRAME>::new(Legacy, Config::DEFAULT);
    for (i, (name, bytes, response)) in responses().into_iter().enumerate() {
        let now = Instant::from_micros(25_000 * i as u64);
        assert!(client.receive(now, &bytes).is_empty());
        assert_eq!(client.poll(now), Output::Event(Event::Unsolicited(response)), "{name}");
        assert_eq!(client.poll(now), Output::Timeout(None));
    }
}

#[test]
fn current_decoder_finds_no_frame_in_legacy_stream() {
    let line = responses()
        .into_iter()
        .flat_map(|(_, bytes, _)| bytes)
        .collect::<Vec<_>>();
    let mut decoder = Decoder::<_, { crate::ling::MAX_FRAME }>::new();
    let (mut rest, mut noise) = (&line[..], 0);
    while !rest.is_empty() || decoder.pending() > 0 {
        rest = decoder.push(rest);
        if rest.is_empty() {
            decoder.idle();
        }
        while let Some(item) = decoder.next(&Ling, ()) {
            assert_ne!(item.kind, Kind::Frame);
            noise += item.bytes.len();
        }
    }
    assert_eq!(noise, line.len());
}

#[test]
fn detector_decides_at_second_frame_for_good() {
    let line: Vec<u8> = responses()
        .into_iter()
        .take(2)
        .flat_map(|(_, bytes, _)| bytes)
        .collect();
    let mut detector = Detector::new();
    assert_eq!(detector.push(&line[..line.len() - 1]), None);
    assert_eq!(detector.push(&line[line.len() - 1..]), Some(OlderGeneration));
    assert_eq!(detector.push(&hex("AA 06 00 01 FE 9A FF")), Some(OlderGeneration));
    assert_eq!(detector.push(&[]), Some(OlderGeneration));
}

#[test]
fn two_frames_are_enough_whatever_stands_between() {
    let (_, joints, _) = responses().remove(0);
    for between in [
        "",
        "00",
        "AA",
        "AA 06 00 01 FE 9A FF",
        "AA 14 12",
        "AA 12 07 01 03 08",
        "AA 12 07 01 03 08 FF 08 00 01 02 FF",
        "AA 0A 03 05 04 13 00 FF",
    ] {
        let mut detector = Detector::new();
        assert_eq!(detector.push(&joints), None, "{between}");
        assert_eq!(detector.push(&hex(between)), None, "{between}");
        // A false header before the frame may claim as many bytes as the longest frame has.
        let line = [&joints[..], &[0; MAX_FRAME]].concat();
        assert_eq!(detector.push(&line), Some(OlderGeneration), "{between}");
    }
}

#[test]
fn one_frame_is_enough_for_a_recording() {
    let (_, joints, _) = responses().remove(0);
    for (before, after) in [("", ""), ("11 AA 14", "AA 12 07 01 03"), ("AA 14 3B", "")] {
        let mut detector = Detector::new();
        assert_eq!(detector.push(&[hex(before), joints.clone(), hex(after)].concat()), None);
        assert_eq!(detector.finish(), Some(OlderGeneration), "{before} {after}");
    }
    let mut detector = Detector::new();
    assert_eq!(detector.push(&joints[..joints.len() - 1]), None);
    assert_eq!(detector.finish(), None);
}

#[test]
fn other_legacy_frames_do_not_count() {
    let version = hex("AA 0A 03 05 04 13 00 FF");
    let mut detector = Detector::new();
    for _ in 0..20 {
        assert_eq!(detector.push(&version), None);
    }
    assert_eq!(detector.finish(), None);
}

#[test]
fn message_names_cause_support_and_remedy() {
    let text = OlderGeneration.to_string();
    for part in [
        "older generation",
        "late 2025",
        "reads its joints and sends nothing to it",
        "need a firmware update from the vendor",
        "1000000 or 921600 baud",
    ] {
        assert!(text.contains(part), "{part} is not in: {text}");
    }
    assert!(!text.contains('\n'));
}

#[test]
fn header_is_searched_and_its_length_awaited() {
    assert_eq!(Legacy.scan(&[1, 2, 0xAA], ()), Scan::Noise(2, Reason::Stray));
    assert_eq!(Legacy.scan(&[1, 2, 3], ()), Scan::Noise(3, Reason::Stray));
    assert_eq!(Legacy.scan(&[0xAA], ()), Scan::Need(2));
    assert_eq!(Legacy.scan(&[0xAA, 0x14], ()), Scan::Need(1));
}
