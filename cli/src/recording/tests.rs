//! Recordings read back by the MCAP library, and captures of bytes in any pieces.

use std::sync::mpsc::channel;

use armwire::ling::{self, Ling, MotionStatus, Stroke};
use armwire::messages::Messages;
use armwire::xarm::XArm;
use armwire_host::describe::{Arm, Protocol};
use mcap::MessageStream;
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::select;

use super::joint_states::Joints;
use super::messages::parse_frame;
use super::writer::{FRAMES, Writer};
use super::*;
use crate::args::Speaker;

const PROTOCOLS: [Protocol; 4] = [Protocol::Ling, Protocol::LingLegacy, Protocol::Xarm, Protocol::Alpha1];
/// A request of a host to read joints.
const READ_JOINTS: [u8; 7] = [0xAA, 0x06, 0x00, 0x01, 0xFE, 0x9A, 0xFF];

fn frame(protocol: Protocol, from: Speaker, bytes: &[u8]) -> Frame {
    Frame {
        log_time: 0,
        stamp: 0,
        protocol,
        from,
        bytes: bytes.to_vec(),
    }
}

/// Frames with the times that ROS has, which end in 2038.
pub(crate) fn any_frame() -> impl Strategy<Value = Frame> {
    let time = 0..i64::from(i32::MAX) * 1_000_000_000;
    let from = select(&[Speaker::Host, Speaker::Arm][..]);
    (
        time.clone(),
        time,
        select(&PROTOCOLS[..]),
        from,
        vec(any::<u8>(), 0..300),
    )
        .prop_map(|(log_time, stamp, protocol, from, bytes)| Frame {
            log_time,
            stamp,
            protocol,
            from,
            bytes,
        })
}

/// The file of these frames.
pub(crate) fn file(frames: &[Frame]) -> Vec<u8> {
    let mut file = Vec::new();
    let mut writer = Writer::new(&mut file, &[Role::Only]).unwrap();
    for frame in frames {
        writer.frame(Role::Only, frame).unwrap();
    }
    Box::new(writer).finish().unwrap();
    file
}

/// The frames of a line on which these pieces are sent and received, each 10 ns after the one before.
fn captured<P: Arm>(pieces: &[(Speaker, &[u8])]) -> Vec<Frame> {
    let (sender, frames) = channel();
    let mut capture = Capture::<P>::new(Role::Only, sender);
    for (nth, (from, bytes)) in (1..).zip(pieces) {
        capture.push(*from, bytes, 10 * nth);
    }
    drop(capture);
    frames.iter().map(|(_, frame)| frame).collect()
}

/// A response of a Ling arm as a frame.
fn ling(response: &ling::Response) -> Frame {
    let mut out = [0; ling::MAX_FRAME];
    let n = Ling.encode_response(response, None, &mut out).unwrap();
    frame(Protocol::Ling, Speaker::Arm, &out[..n])
}

fn ling_joints(ticks: u16, gripper: u16) -> Frame {
    ling(&ling::Response::Joints(ling::JointState {
        joints: [ticks; 6],
        gripper,
        status: MotionStatus::Locked,
    }))
}

proptest! {
    #[test]
    fn frames_are_read_as_written(frames in vec(any_frame(), 0..20)) {
        let file = file(&frames);
        let messages = MessageStream::new(&file).unwrap().map(Result::unwrap);
        let read: Vec<_> = messages
            .filter(|message| message.channel.topic == FRAMES)
            .map(|message| parse_frame(message.log_time.cast_signed(), &message.data).unwrap())
            .collect();
        prop_assert_eq!(read, frames);
    }

    #[test]
    fn any_message_is_parsed_or_refused(bytes in vec(any::<u8>(), 0..100)) {
        let _ = parse_frame(0, &bytes);
        let _ = parse_frame(0, &[&[0, 1, 0, 0], &bytes[..]].concat());
    }

    #[test]
    fn every_byte_is_captured_in_order(
        pieces in vec(prop_oneof![vec(any::<u8>(), 0..40), Just(READ_JOINTS.to_vec())], 0..20)
    ) {
        let pieces: Vec<_> = pieces.iter().map(|piece| (Speaker::Arm, &piece[..])).collect();
        let frames = captured::<Ling>(&pieces);
        let bytes: Vec<_> = frames.iter().flat_map(|frame| &frame.bytes).copied().collect();
        prop_assert_eq!(bytes, pieces.iter().flat_map(|(_, piece)| *piece).copied().collect::<Vec<_>>());
        prop_assert!(frames.is_sorted_by_key(|frame| frame.stamp));
    }
}

#[test]
fn captured_frame_has_time_of_its_last_byte() {
    let (first, last) = READ_JOINTS.split_at(3);
    let frames = captured::<Ling>(&[
        (Speaker::Host, first),
        (Speaker::Host, last),
        (Speaker::Arm, &[0x11, 0x12]),
        (Speaker::Arm, &[0xAA, 0x04, 0x0E]),
    ]);
    let output: Vec<_> = frames
        .iter()
        .map(|frame| (frame.from, frame.stamp, frame.bytes.len()))
        .collect();
    assert_eq!(
        output,
        [(Speaker::Host, 20, 7), (Speaker::Arm, 30, 2), (Speaker::Arm, 40, 3)]
    );
}

#[test]
fn damaged_frame_is_one_run() {
    let damaged = [0xAA, 0x06, 0x00, 0x01, 0xFE, 0x9B, 0xFF];
    let frames = captured::<Ling>(&[(Speaker::Arm, &[&damaged[..], &READ_JOINTS].concat())]);
    assert_eq!(
        frames.iter().map(|frame| &frame.bytes[..]).collect::<Vec<_>>(),
        [damaged, READ_JOINTS]
    );
}

#[test]
fn padding_of_hid_reports_is_left_out() {
    let mut report = [0; 64];
    report[..4].copy_from_slice(&[0xF3, 0x3F, 0xEE, 0xED]);
    let frames = captured::<armwire::alpha1::Alpha1>(&[(Speaker::Arm, &report), (Speaker::Arm, &report)]);
    assert_eq!(frames.len(), 2);
    assert!(frames.iter().all(|frame| frame.bytes == report[..4]), "{frames:?}");
}

#[test]
fn gripper_is_a_joint_once_stroke_is_known() {
    let mut joints = Joints::default();
    let names = |read: &[(String, f64)]| read.iter().map(|(name, _)| name.clone()).collect::<Vec<_>>();
    let read = joints.read(&ling_joints(3072, 500)).unwrap();
    assert_eq!(
        names(&read),
        ["joint1", "joint2", "joint3", "joint4", "joint5", "joint6"]
    );
    assert!((read[5].1 - std::f64::consts::FRAC_PI_2).abs() < 1e-6, "{read:?}");
    assert_eq!(joints.read(&ling(&ling::Response::Stroke(Stroke::Mm50))), None);
    let read = joints.read(&ling_joints(3072, 500)).unwrap();
    assert_eq!(read[6].0, "gripper");
    assert!((read[6].1 - 0.025).abs() < 1e-9, "{read:?}");
}

#[test]
fn positions_out_of_range_are_no_joint_state() {
    let mut joints = Joints::default();
    assert_eq!(joints.read(&ling_joints(4096, 0)), None);
    assert_eq!(joints.read(&ling_joints(0, 1001)), None);
    let request = frame(Protocol::Ling, Speaker::Host, &READ_JOINTS);
    assert_eq!(joints.read(&request), None);
}

#[test]
fn xarm_has_as_many_joints_as_axes() {
    let mut positions = vec![0, 1, 0, 2, 0, 30, 42, 0];
    positions.extend([0.5_f32; 7].map(f32::to_le_bytes).as_flattened());
    let positions = frame(Protocol::Xarm, Speaker::Arm, &positions);
    let mut joints = Joints::default();
    // Their number is not known yet.
    assert_eq!(joints.read(&positions), None);
    let version = b"6,6,XI1304,AC1300,v1.12.10";
    let mut reply = vec![0, 1, 0, 2, 0, 2 + version.len() as u8, 1, 0];
    reply.extend(version);
    assert_eq!(joints.read(&frame(Protocol::Xarm, Speaker::Arm, &reply)), None);
    let read = joints.read(&positions).unwrap();
    assert_eq!((read.len(), &read[5]), (6, &("joint6".to_owned(), 0.5)));
    // The same over a line, whose direction decides what it means.
    let frames = captured::<XArm>(&[(Speaker::Arm, &positions.bytes)]);
    assert_eq!(frames[0].bytes, positions.bytes);
}
