//! Properties of every frame of Ling's older generation, and of every stream into a detector.

// Unused: its functions for requests.
#[allow(dead_code)]
mod common;

use armwire::decoder::{Decoder, Kind};
use armwire::ling::legacy::{
    Detector, Firmware, GripperState, JointState, Legacy, MAX_FRAME, OlderGeneration, Request, Response,
};
use armwire::ling::{self, Ling, MotionStatus, PerServo};
use armwire::messages::Messages;
use common::Subject;
use proptest::array::{uniform6, uniform9, uniform10};
use proptest::collection::vec;
use proptest::prelude::*;

fn response() -> impl Strategy<Value = Response> {
    let firmware = || prop_oneof![Just(Firmware::V5), Just(Firmware::V6_0)];
    prop_oneof![
        (firmware(), uniform9(any::<u16>())).prop_map(|(firmware, servos)| {
            let state = JointState { firmware, servos };
            Response::Joints(state)
        }),
        (firmware(), any::<(u8, u16, u16, u8, u8)>()).prop_map(|(firmware, fields)| {
            let (id, servo, potentiometer, sync_button, attitude_button) = fields;
            Response::Gripper(GripperState {
                firmware,
                id,
                servo,
                potentiometer,
                sync_button,
                attitude_button,
            })
        }),
    ]
}

fn bytes_of(response: &Response) -> Vec<u8> {
    common::response_bytes::<Legacy>(response)
}

impl Subject for Legacy {
    const PADDING: Option<u8> = None;

    fn any_request() -> BoxedStrategy<Request> {
        Just(()).prop_filter_map("no request exists", |()| None).boxed()
    }

    fn any_response() -> BoxedStrategy<(Vec<u8>, ())> {
        response().prop_map(|response| (bytes_of(&response), ())).boxed()
    }

    fn any_expect() -> BoxedStrategy<()> {
        Just(()).boxed()
    }

    fn any_frame((): ()) -> BoxedStrategy<Vec<u8>> {
        response().prop_map(|response| bytes_of(&response)).boxed()
    }

    fn any_noise() -> BoxedStrategy<u8> {
        prop_oneof![
            4 => any::<u8>(),
            2 => Just(0xAA),
            1 => Just(0xFF),
            1 => prop_oneof![Just(0x14), Just(0x12), Just(0x07)],
            1 => 0..2_u8,
        ]
        .boxed()
    }
}

fn noise() -> impl Strategy<Value = Vec<u8>> {
    vec(Legacy::any_noise(), 0..24)
}

/// A frame of the current generation, as sent by an arm.
fn current() -> impl Strategy<Value = Vec<u8>> {
    let response = prop_oneof![
        (uniform6(any::<u16>()), any::<u16>(), any::<u8>()).prop_map(|(joints, gripper, status)| {
            ling::Response::Joints(ling::JointState {
                joints,
                gripper,
                status: MotionStatus::from(status),
            })
        }),
        uniform10(any::<u8>()).prop_map(|celsius| ling::Response::Temperatures(PerServo::Follower(celsius))),
        uniform10(any::<u16>()).prop_map(|ticks| ling::Response::Velocities(PerServo::Follower(ticks))),
        any::<u16>().prop_map(|mask| ling::Response::SelfCheck(ling::SelfCheck(mask))),
    ];
    response.prop_map(|response| common::response_bytes::<Ling>(&response))
}

/// The number of bytes before a detection, if there is one.
fn bytes_to_detection(stream: &[u8]) -> Option<usize> {
    let mut detector = Detector::new();
    let position = stream.iter().position(|&byte| detector.push(&[byte]).is_some());
    position.map(|position| position + 1)
}

proptest! {
    #[test]
    fn every_response_survives_the_wire(response in Legacy::any_response()) {
        common::a_response_survives_the_wire::<Legacy>(response)?;
    }

    #[test]
    fn frame_prefix_never_gets_a_verdict(frame in Legacy::any_frame(())) {
        common::a_prefix_of_a_frame_is_given_no_verdict::<Legacy>(&frame, ())?;
    }

    /// With one bit of parity, noise is a valid frame by chance more often than in the current generation.
    #[test]
    fn no_intact_frame_and_no_byte_is_lost(line in common::line::<Legacy>()) {
        common::nothing_is_lost_to_noise::<Legacy>(line)?;
    }

    #[test]
    fn positions_match_counts_or_name_the_invalid_one(servos in uniform9(0..5000_u16)) {
        let state = JointState { firmware: Firmware::V6_0, servos };
        match state.positions() {
            Ok(positions) => prop_assert_eq!(positions.map(|position| position.ticks()), state.joints()),
            Err(error) => {
                prop_assert_eq!(Some(error.got), state.joints().into_iter().find(|&ticks| ticks > 4095));
            }
        }
    }

    #[test]
    fn two_frames_are_recognised_after_anything(
        before in vec(any::<u8>(), 0..200),
        between in vec(any::<u8>(), 0..200),
        frames in vec(response(), 2..8),
    ) {
        let frames: Vec<u8> = frames.iter().flat_map(bytes_of).collect();
        // Earlier bytes may seem to begin a frame: it is rejected within the longest frame.
        let apart = [0; MAX_FRAME];
        let line = [&before[..], &apart, &frames, &between, &apart, &frames, &apart].concat();
        prop_assert!(bytes_to_detection(&line).is_some());
    }

    #[test]
    fn chunking_does_not_change_the_verdict_byte(
        parts in vec((noise(), vec(response(), 0..4)), 1..8),
        lengths in vec(1..40_usize, 1..60),
    ) {
        let stream: Vec<u8> = parts
            .iter()
            .flat_map(|(noise, responses)| [noise.clone(), responses.iter().flat_map(bytes_of).collect()].concat())
            .collect();
        let detection = bytes_to_detection(&stream);
        let (mut detector, mut received) = (Detector::new(), 0);
        let mut rest = &stream[..];
        for length in lengths.into_iter().chain([usize::MAX]) {
            let (chunk, later) = rest.split_at(rest.len().min(length));
            rest = later;
            received += chunk.len();
            let detected = detection.is_some_and(|n| n <= received);
            prop_assert_eq!(detector.push(chunk), detected.then_some(OlderGeneration));
        }
    }

    #[test]
    fn current_frames_are_never_taken_as_legacy(
        parts in vec((noise(), current()), 0..40),
        broken in any::<bool>(),
    ) {
        let mut detector = Detector::new();
        for (noise, frame) in parts {
            if broken {
                prop_assert_eq!(detector.push(&noise), None);
            }
            prop_assert_eq!(detector.push(&frame), None);
        }
    }
}

/// Bytes that look random, the same in every run (splitmix64).
fn random(seed: u64) -> impl Iterator<Item = u8> {
    let mut state = seed;
    core::iter::repeat_with(move || {
        state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = state;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        (z ^ (z >> 31)).to_le_bytes()
    })
    .flatten()
}

#[test]
fn ten_million_random_bytes_are_not_recognised() {
    let bytes: Vec<u8> = random(1).take(10_000_000).collect();
    assert_eq!(Detector::new().push(&bytes), None);
}

/// The worst noise: only the first and last bytes of legacy frames. Two messages in it are a detection, which is safe:
/// nothing is sent.
#[test]
fn noise_of_frame_marks_rarely_forms_messages() {
    let marks = [0xAA, 0x14, 0x12, 0x04, 0x02, 0x07, 0x00, 0xFF];
    let bytes: Vec<u8> = random(2)
        .take(4_000_000)
        .map(|byte| marks[usize::from(byte % 8)])
        .collect();
    let mut frames = 0;
    let mut messages = 0;
    let mut decoder = Decoder::<_, MAX_FRAME>::new();
    let mut rest = &bytes[..];
    while !rest.is_empty() {
        rest = decoder.push(rest);
        while let Some(item) = decoder.next(&Legacy, ()) {
            if item.kind == Kind::Frame {
                frames += 1;
                messages += usize::from(Legacy.parse_response(item.bytes, ()).is_ok());
            }
        }
    }
    assert!(
        frames > 1_000 && messages < bytes.len() / 10_000,
        "frames in this noise: {frames}, messages among them: {messages}"
    );
}
