//! A stop of the arm by the control port, whoever moves it.

extern crate std;

use std::boxed::Box;
use std::cell::RefCell;
use std::rc::Rc;
use std::vec;
use std::vec::Vec;

use armwire::ling::{self, ControlMode, GripperSpeed, JOINTS, Ling, Move, Opening, Position, Speed, TemperatureLimit};
use armwire::messages::Messages;
use armwire::{alpha1, ling::READ_JOINTS};

use super::rig::{Rig, at, ling, motion, void};
use crate::can::Node;
use crate::can::command::Command;
use crate::can::telemetry::event_from_frame;
use crate::config::{ArmKind, Can, Config, HostTimeout, Poll};
use crate::control::{
    Event, Failure, FromAdapter, Initiator, LineReservation, MAX_FRAME, Refusal, Reply, Request, STOP_MS, StopInForce,
};
use crate::{Action, Instant, UsbEvent};

/// The time without motion, in µs.
const REFUSAL: u64 = STOP_MS as u64 * 1_000;

/// The status of an arm with torque, and of one without.
const LOCKED: u8 = 1;
const IDLE: u8 = 0;

/// A pose in the arm's reading: six joints and the gripper.
type Pose = [u16; JOINTS + 1];

const POSE: Pose = [2000, 2001, 2002, 2003, 2004, 2005, 310];

/// The answer of the vendor's two-armed robot to a reading of the joints.
const BESSICA: &[u8] = include_bytes!("bessica.bin");

/// The answer to a reading of the joints.
fn reading(pose: Pose, status: u8) -> Vec<u8> {
    let data = pose.iter().flat_map(|value| value.to_le_bytes()).chain([status]);
    ling(0x06, 0, &data.collect::<Vec<_>>())
}

/// A move with this goal of the gripper.
fn motion_with_gripper(opening: u16) -> Vec<u8> {
    let target = Move {
        joints: [(Position::CENTRE, Speed::new(1_000).unwrap()); JOINTS],
        gripper: (Opening::new(opening).unwrap(), GripperSpeed(1_000)),
    };
    frame(ling::Request::Move(target))
}

fn frame(request: ling::Request) -> Vec<u8> {
    let mut out = [0; MAX_FRAME];
    let len = Ling.encode_request(&request, &mut out).unwrap();
    out[..len].to_vec()
}

/// The move that holds this pose, with this goal of the gripper.
fn hold(pose: Pose, opening: u16) -> Vec<u8> {
    let [joints @ .., _] = pose;
    let target = Move {
        joints: joints.map(|ticks| (Position::new(ticks).unwrap(), Speed::new(2_000).unwrap())),
        gripper: (Opening::new(opening).unwrap(), GripperSpeed(1_000)),
    };
    frame(ling::Request::Move(target))
}

/// A Ling arm whose readings are these in turn, the last of them again and again. It answers nothing else.
fn arm(mut readings: Vec<(Pose, u8)>) -> impl FnMut(&[u8]) -> Option<(u64, Vec<u8>)> {
    move |request| {
        if request != READ_JOINTS {
            return None;
        }
        let (pose, status) = match readings.len() {
            1 => readings[0],
            _ => readings.remove(0),
        };
        Some((200, reading(pose, status)))
    }
}

/// A host timeout of 500 ms that switches the torque off, and commands from CAN.
fn config() -> Config {
    Config {
        host_timeout: HostTimeout {
            after_ms: 500,
            torque_off: true,
        },
        can: Can {
            commands: true,
            ..Can::default()
        },
        ..Config::default()
    }
}

fn rig(config: Config) -> Rig {
    let mut rig = Rig::new(config);
    rig.responder = Box::new(arm(vec![(POSE, LOCKED)]));
    rig.subscribe();
    rig.sent.clear();
    rig
}

/// The bursts to the arm without the readings of the stop, which are 20 ms apart, and without the repetitions of a hold.
fn sent(rig: &Rig) -> Vec<Vec<u8>> {
    let mut sent = Vec::new();
    for (_, bytes) in &rig.sent {
        let is_hold = bytes.starts_with(&[0xAA, 0x06, 0x03]) && bytes[6..8] == 2_000_u16.to_le_bytes();
        if *bytes != READ_JOINTS && !(is_hold && sent.contains(bytes)) {
            sent.push(bytes.clone());
        }
    }
    sent
}

fn stopped(initiator: Initiator) -> Event {
    Event::Refused {
        initiator,
        reason: Refusal::Stopped,
    }
}

/// The refusals because of a stop.
fn refusals(rig: &Rig) -> Vec<Event> {
    let events = rig.events.iter().map(|(_, event)| event.clone());
    let is_stopped = |event: &Event| {
        matches!(
            event,
            Event::Refused {
                reason: Refusal::Stopped,
                ..
            }
        )
    };
    events.filter(is_stopped).collect()
}

fn command(rig: &mut Rig, sequence: u8) {
    let command = Command {
        sequence,
        joints: [2048; 6],
        speed: 50,
        gripper: 100,
    };
    for frame in command.to_frames(Node::default()) {
        rig.can_frame(&frame);
    }
}

#[test]
fn stop_holds_pose_and_last_gripper_goal() {
    // The goal of any host's move counts; without one, the reading, as far as it is an opening.
    for (goal_by, gripper, expected) in [
        (Some(Initiator::Usb), 310, 250),
        (Some(Initiator::Can), 310, 250),
        (Some(Initiator::Command), 310, 400),
        (None, 310, 310),
        (None, 2051, 1000),
    ] {
        let mut rig = rig(config());
        let [joints @ .., _] = POSE;
        let [a, b, c, d, e, f] = joints;
        let pose = [a, b, c, d, e, f, gripper];
        rig.responder = Box::new(arm(vec![(pose, LOCKED)]));
        match goal_by {
            Some(Initiator::Usb) => rig.usb_out.extend(motion_with_gripper(250)),
            Some(Initiator::Can) => rig.can_out.push_back(motion_with_gripper(250)),
            Some(_) => [0, 1].into_iter().for_each(|sequence| command(&mut rig, sequence)),
            None => {}
        }
        rig.run(10_000);
        rig.sent.clear();
        let begin = rig.now;
        let sequence = rig.request(Request::Stop);
        rig.run(5_000);
        assert_eq!(sent(&rig), [hold(pose, expected)]);
        assert_eq!(rig.replies.last(), Some(&(sequence, Reply::Done)));
        // A reading of 7 bytes, its answer of 21 after 200 µs.
        assert_eq!(rig.sent[1].0 - begin, (7 + 21) * 10 + 200);
        rig.run(3_000_000);
        assert_eq!(sent(&rig).len(), 1, "the pose is sent once");
    }
}

#[test]
fn reading_from_before_the_stop_is_not_held() {
    let mut rig = rig(config());
    let before = POSE.map(|value| value - 100);
    let mut requests = 0;
    rig.responder = Box::new(move |request| {
        requests += u32::from(request == READ_JOINTS);
        let answer = match requests {
            1 => (12_000, reading(before, LOCKED)),
            _ => (200, reading(POSE, LOCKED)),
        };
        (request == READ_JOINTS).then_some(answer)
    });
    rig.usb_out.extend(READ_JOINTS);
    rig.run(1_000);
    rig.request(Request::Stop);
    rig.run(40_000);
    assert_eq!(sent(&rig), [hold(POSE, 310)]);
}

#[test]
fn late_reading_of_the_stop_is_held() {
    let mut rig = rig(config());
    rig.responder = Box::new(|request| (request == READ_JOINTS).then(|| (70_000, reading(POSE, LOCKED))));
    rig.request(Request::Stop);
    rig.run(75_000);
    assert_eq!(sent(&rig), [hold(POSE, 310)]);
}

#[test]
fn hold_is_repeated_and_never_changed() {
    let pose = |joint| {
        let mut pose = POSE;
        pose[1] = joint;
        pose
    };
    let mut rig = rig(config());
    // The arm sags in the hold.
    let readings = [2000, 1990, 1985, 1980].map(|joint| (pose(joint), LOCKED));
    rig.responder = Box::new(arm(readings.to_vec()));
    rig.request(Request::Stop);
    rig.run(3_000_000);
    assert_eq!(sent(&rig), [hold(pose(2000), 310)]);
    let holds = rig.sent.iter().filter(|(_, bytes)| *bytes != READ_JOINTS).count();
    assert_eq!(holds, 5);
}

/// Returns the hold of a stop, after these requests to an arm that stands near its last goal.
fn hold_after(requests: &[Vec<u8>]) -> Vec<u8> {
    let mut rig = rig(Config::default());
    rig.responder = Box::new(arm(vec![([2040; JOINTS + 1], LOCKED)]));
    for request in requests {
        rig.usb_out.extend(request);
        rig.run(10_000);
    }
    rig.run(REFUSAL);
    rig.sent.clear();
    rig.request(Request::Stop);
    rig.run(1_000_000);
    let holds = sent(&rig);
    assert_eq!(holds.len(), 1);
    holds[0].clone()
}

#[test]
fn standing_arm_is_held_at_its_known_goal() {
    let (goal, here) = (hold([2048; JOINTS + 1], 250), |gripper| {
        hold([2040; JOINTS + 1], gripper)
    });
    let set_zero = ling(0x03, 0, &[0xFE]);
    let limit = frame(ling::Request::SetTemperatureLimit(TemperatureLimit::new(60).unwrap()));
    assert_eq!(hold_after(&[motion_with_gripper(250)]), goal);
    assert_eq!(
        hold_after(&[motion_with_gripper(250), limit, ling::TORQUE_ON.to_vec()]),
        goal
    );
    // The goal is not known any more.
    let mode = frame(ling::Request::SetMode(ControlMode::Position));
    let feedback = [true, false].map(|is_on| frame(ling::Request::SetForceFeedback(is_on)));
    for forgotten in [ling::TORQUE_OFF.to_vec(), set_zero, mode].into_iter().chain(feedback) {
        assert_eq!(hold_after(&[motion_with_gripper(250), forgotten]), here(1000));
    }
    let mut undecodable = motion_with_gripper(250);
    let data_len = undecodable.len() - ling::OVERHEAD;
    undecodable[4..6].copy_from_slice(&[0xFF, 0xFF]);
    let undecodable = ling(0x06, 3, &undecodable[4..4 + data_len]);
    assert_eq!(hold_after(&[motion_with_gripper(250), undecodable]), here(1000));
}

/// The time from a stop to its hold, in µs, of an arm with these readings that was sent to 2048.
fn time_to_hold(readings: impl Iterator<Item = u16>) -> u64 {
    let mut rig = rig(Config::default());
    let readings = readings.map(|ticks| ([ticks; JOINTS + 1], LOCKED));
    rig.responder = Box::new(arm(readings.collect()));
    rig.usb_out.extend(motion_with_gripper(250));
    rig.run(REFUSAL);
    rig.sent.clear();
    let begin = rig.now;
    rig.request(Request::Stop);
    rig.run(1_000_000);
    let is_hold = |bytes: &[u8]| bytes != READ_JOINTS;
    let (at, _) = rig.sent.iter().find(|(_, bytes)| is_hold(bytes)).unwrap();
    at - begin
}

#[test]
fn hold_beside_the_last_move_is_out_within_its_bound() {
    let away = time_to_hold([2000].into_iter());
    assert!(away < 2_000, "{away}");
    let standing = time_to_hold([2010].into_iter());
    assert!((100_000..125_000).contains(&standing), "{standing}");
    let passing = time_to_hold((2010..2100).step_by(4));
    assert!((300_000..325_000).contains(&passing), "{passing}");
}

/// Hosts that wait for the line, which a self-check of another has for 500 ms: bytes and a half request on USB, a full
/// queue on CAN and one more PDU, a command.
fn rig_with_waiting_motion() -> Rig {
    let mut rig = rig(config());
    // A frame in transmission: its rest comes later.
    rig.usb_out.extend(&motion()[..20]);
    rig.run(1_000);
    rig.can_out.push_back(ling::SELF_CHECK.to_vec());
    rig.run(15_000);
    assert_eq!(rig.sent.last().unwrap().1, ling::SELF_CHECK);
    let read = ling(0x06, 2, &[0xFE]);
    rig.usb_out.extend([motion(), read.clone(), motion()].concat());
    rig.can_out.extend([motion(), read, motion()]);
    for sequence in 0..2 {
        command(&mut rig, sequence);
    }
    rig.run(20_000);
    assert_eq!(rig.bridge.line.settled().waiting(), (2, 2 * motion().len() + 7));
    rig.sent.clear();
    rig
}

#[test]
fn stop_drops_the_waiting_motion_of_all_hosts() {
    let mut rig = rig_with_waiting_motion();
    rig.request(Request::Stop);
    rig.run(1_000_000);
    let read = ling(0x06, 2, &[0xFE]);
    // The reads remain.
    assert_eq!(sent(&rig), [&hold(POSE, 310), &read, &read].map(Clone::clone));
    let events = refusals(&rig);
    assert_eq!(
        events,
        [Initiator::Command, Initiator::Can, Initiator::Usb, Initiator::Can].map(stopped)
    );
    assert_eq!(rig.bridge.counters().refused_stopped, 5);
}

#[test]
fn hold_is_out_within_its_bound() {
    // An unanswered request of another host is on the line, and the reading is answered at the last moment.
    let slow = |rig: &mut Rig| {
        let mut arm = arm(vec![(POSE, LOCKED)]);
        rig.responder = Box::new(move |request| arm(request).map(|(_, answer)| (49_900, answer)));
    };
    let behind = |request: Vec<u8>| {
        let mut rig = rig(config());
        rig.responder = Box::new(|_| None);
        // The middle of an upload.
        rig.usb_out.extend([0x55; 100]);
        rig.can_out.push_back(request);
        rig.run(10_000);
        rig.can_out.extend([motion(), motion(), motion()]);
        rig.run(2_000);
        rig
    };
    for (mut rig, bound) in [
        (rig_with_waiting_motion(), 555_000),
        (behind(ling::SELF_CHECK.to_vec()), 555_000),
        (behind(READ_JOINTS.to_vec()), 155_000),
        (behind(ling(0x06, 2, &[0xFE])), 155_000),
    ] {
        slow(&mut rig);
        let begin = rig.now;
        rig.sent.clear();
        rig.request(Request::Stop);
        rig.run(1_000_000);
        let hold = hold(POSE, 310);
        let (start, _) = rig.sent.iter().find(|(_, bytes)| *bytes == hold).unwrap();
        let took = start + 10 * hold.len() as u64 - begin;
        assert!((50_000..bound).contains(&took), "{took} µs");
    }
}

#[test]
fn stop_cuts_a_partial_move_by_zeros() {
    for begun in 1..motion().len() {
        let mut rig = rig(config());
        rig.usb_out.extend(&motion()[..begun]);
        rig.run(1_000);
        rig.sent.clear();
        rig.request(Request::Stop);
        rig.run(5_000);
        // Its rest, and a request behind it.
        rig.usb_out.extend(&motion()[begun..]);
        rig.usb_out.extend(ling(0x06, 2, &[0xFE]));
        rig.run(3_000);
        let expected = [void(), vec![hold(POSE, 310), ling(0x06, 2, &[0xFE])]].concat();
        assert_eq!(sent(&rig), expected, "{begun} bytes");
        assert_eq!(refusals(&rig), [stopped(Initiator::Usb)]);
        assert_eq!(rig.bridge.counters().refused_stopped, 1);
    }
}

#[test]
fn cut_read_is_refused_and_counted() {
    let mut rig = rig(config());
    let read = ling(0x06, 2, &[0xFE]);
    rig.usb_out.extend(&read[..3]);
    rig.run(1_000);
    rig.request(Request::Stop);
    rig.run(3_000);
    rig.usb_out.extend(&read[3..]);
    rig.run(REFUSAL);
    assert_eq!(rig.sent.last().unwrap().1, READ_JOINTS);
    assert_eq!(rig.bridge.counters().refused_stopped, 1);
}

#[test]
fn stop_cuts_an_upload_by_its_reading() {
    let mut rig = rig(config());
    let upload = vec![0x55; 100];
    rig.usb_out.extend(&upload);
    rig.run(500);
    rig.request(Request::Stop);
    rig.run(20_000);
    let bytes: Vec<u8> = rig.line().into_iter().filter(|byte| *byte == 0x55).collect();
    assert_eq!(bytes, upload);
    // One burst is on the line at most: the rest of the upload goes out behind the hold.
    let bursts: Vec<_> = rig.sent.iter().take(3).map(|(_, bytes)| bytes.clone()).collect();
    assert_eq!(bursts, [upload[..70].to_vec(), READ_JOINTS.to_vec(), hold(POSE, 310)]);
}

#[test]
fn motion_is_refused_for_two_seconds() {
    let mut rig = rig(config());
    let begin = rig.now;
    rig.request(Request::Stop);
    rig.run(1_000);
    command(&mut rig, 0);
    for sequence in 1..21 {
        // In pieces of any size.
        let mut head = motion();
        let tail = head.split_off(usize::from(sequence));
        rig.usb_out.extend(head);
        rig.can_out.push_back(motion());
        command(&mut rig, sequence);
        rig.run(5_000);
        rig.usb_out.extend(tail);
        rig.run(5_000);
    }
    assert_eq!(sent(&rig), [hold(POSE, 310)]);
    assert_eq!(rig.bridge.counters().refused_stopped, 3 * 20);
    let events = refusals(&rig);
    let of = |initiator| events.iter().filter(|event| **event == stopped(initiator)).count();
    assert_eq!(
        (of(Initiator::Usb), of(Initiator::Can), of(Initiator::Command)),
        (1, 20, 20)
    );
    let on_bus = rig.frames.iter().filter_map(|(_, frame)| event_from_frame(frame));
    assert_eq!(on_bus.map(|(_, event)| event).collect::<Vec<_>>(), events);
    // Not a microsecond longer.
    rig.run(begin + REFUSAL - 1 - rig.now);
    rig.usb_out.extend(motion());
    rig.run(0);
    assert_eq!(sent(&rig).len(), 1);
    rig.run(1);
    rig.usb_out.extend(motion());
    rig.can_out.push_back(motion());
    rig.run(5_000);
    assert_eq!(sent(&rig), [hold(POSE, 310), motion(), motion()]);
}

/// The motors may push the joints from then on.
#[test]
fn force_feedback_is_refused_after_a_stop() {
    for request in [
        ling::Request::SetForceFeedback(true),
        ling::Request::SetMode(ControlMode::Current),
    ] {
        let mut rig = rig(config());
        rig.request(Request::Stop);
        rig.run(5_000);
        rig.usb_out.extend(frame(request));
        rig.can_out.push_back(frame(request));
        rig.run(5_000);
        assert_eq!(sent(&rig), [hold(POSE, 310)]);
        assert_eq!(rig.bridge.counters().refused_stopped, 2);
    }
}

#[test]
fn stop_in_force_tells_its_host_and_the_time_left() {
    let mut rig = rig(config());
    let stop = |by, left_ms| Reply::Stop(Some(StopInForce { by, left_ms }));
    assert_eq!(rig.call(Request::GetStop), Reply::Stop(None));
    rig.request(Request::Stop);
    assert_eq!(rig.call(Request::GetStop), stop(Initiator::Usb, STOP_MS));
    rig.run(1_000_001);
    assert_eq!(rig.call(Request::GetStop), stop(Initiator::Usb, 1_000));
    // The last host counts.
    rig.request_on_can(1, Request::Stop);
    rig.run(10_000);
    let Reply::Stop(Some(StopInForce {
        by: Initiator::Can,
        left_ms,
    })) = rig.call(Request::GetStop)
    else {
        panic!("the stop by CAN is in force");
    };
    assert!((1_980..=2_000).contains(&left_ms), "{left_ms}");
    rig.run(REFUSAL);
    assert_eq!(rig.call(Request::GetStop), Reply::Stop(None));
}

#[test]
fn other_requests_pass_after_a_stop() {
    let mut rig = rig(config());
    rig.request(Request::Stop);
    rig.run(5_000);
    let read = ling(0x06, 2, &[0xFE]);
    let of_leader = [
        ling::Request::SetMode(ControlMode::Position),
        ling::Request::ReadMode,
        ling::Request::SetForceFeedback(false),
        ling::Request::ReadForceFeedback,
    ];
    let torque = [ling::TORQUE_OFF.to_vec(), ling::TORQUE_ON.to_vec()];
    for request in [read].into_iter().chain(torque).chain(of_leader.map(frame)) {
        for is_usb in [true, false] {
            match is_usb {
                true => rig.usb_out.extend(&request),
                false => rig.can_out.push_back(request.clone()),
            }
            rig.run(150_000);
            assert_eq!(sent(&rig).last(), Some(&request));
        }
    }
    assert_eq!(rig.bridge.counters().refused_stopped, 0);
}

#[test]
fn half_request_passes_after_the_stop() {
    let mut rig = rig(config());
    rig.request(Request::Stop);
    rig.run(5_000);
    let half = &ling(0x06, 2, &[0xFE])[..4];
    rig.usb_out.extend(half);
    rig.run(REFUSAL - 6_000);
    assert_eq!(sent(&rig), [hold(POSE, 310)]);
    rig.run(2_000);
    assert_eq!(sent(&rig), [&hold(POSE, 310)[..], half]);
}

#[test]
fn stop_ends_streams_and_keeps_the_torque() {
    let mut rig = rig(config());
    command(&mut rig, 0);
    for sequence in 1..6 {
        rig.usb_out.extend(motion());
        rig.can_out.push_back(motion());
        command(&mut rig, sequence);
        rig.run(20_000);
    }
    assert!(rig.bridge.update(Instant::ZERO).is_armed);
    rig.request(Request::Stop);
    rig.run(5_000);
    assert!(!rig.bridge.update(Instant::ZERO).is_armed);
    rig.run(3_000_000);
    assert_eq!(rig.bridge.counters().host_silences, 0);
    assert_eq!(sent(&rig).last(), Some(&hold(POSE, 0)));
}

#[test]
fn torque_off_that_waits_wins() {
    let mut rig = rig(config());
    for _ in 0..3 {
        rig.can_out.push_back(motion());
        rig.run(1_000);
    }
    // The host on USB pauses in a request: torque-off of the silent host waits 10 ms.
    rig.run(498_000);
    rig.usb_out.extend(&motion()[..20]);
    rig.run(3_000);
    rig.sent.clear();
    let sequence = rig.request(Request::Stop);
    assert_eq!(rig.replies.last(), Some(&(sequence, Reply::Done)));
    rig.run(REFUSAL - 10_000);
    rig.usb_out.extend(motion());
    rig.run(5_000);
    assert_eq!(sent(&rig), [void(), vec![ling::TORQUE_OFF.to_vec()]].concat());
    assert_eq!(rig.bridge.counters().refused_stopped, 1);
}

#[test]
fn nothing_is_sent_to_an_arm_without_torque() {
    for status in [IDLE, 0xE2] {
        let mut rig = rig(config());
        rig.responder = Box::new(arm(vec![(POSE, status)]));
        let sequence = rig.request(Request::Stop);
        rig.run(5_000);
        rig.usb_out.extend(motion());
        rig.run(1_000_000);
        assert_eq!(rig.line(), READ_JOINTS);
        assert_eq!(rig.replies.last(), Some(&(sequence, Reply::Done)));
        assert_eq!(rig.bridge.counters().refused_stopped, 1);
    }
}

#[test]
fn silent_arm_is_reported_after_two_seconds() {
    let mut rig = rig(config());
    rig.responder = Box::new(|_| None);
    let sequence = rig.request(Request::Stop);
    // Only its first reading goes before the requests of others.
    rig.can_out.push_back(ling::TORQUE_OFF.to_vec());
    rig.run(60_000);
    assert_eq!(sent(&rig), [ling::TORQUE_OFF]);
    rig.usb_out.extend(motion());
    rig.run(REFUSAL - 60_001);
    assert!(rig.replies.iter().all(|(of, _)| *of != sequence));
    rig.run(1);
    let reply = Reply::Failed(Failure::ArmSilent);
    assert_eq!(rig.replies.last(), Some(&(sequence, reply)));
    assert_eq!(sent(&rig), [ling::TORQUE_OFF]);
    // A reading every 102 ms: its timeout, and the time for which its answer may be late.
    let readings = rig.sent.iter().filter(|(_, bytes)| *bytes == READ_JOINTS).count();
    assert_eq!(readings, 20);
}

#[test]
fn late_reading_holds_the_arm() {
    let mut rig = rig(config());
    let answers = Rc::new(RefCell::new(false));
    let (mut arm, is_answering) = (arm(vec![(POSE, LOCKED)]), answers.clone());
    rig.responder = Box::new(move |request| arm(request).filter(|_| *is_answering.borrow()));
    let sequence = rig.request(Request::Stop);
    rig.run(1_000_000);
    *answers.borrow_mut() = true;
    rig.run(150_000);
    assert_eq!(sent(&rig), [hold(POSE, 310)]);
    assert_eq!(rig.replies.last(), Some(&(sequence, Reply::Done)));
}

#[test]
fn pose_out_of_range_is_not_held() {
    let mut rig = rig(config());
    rig.responder = Box::new(arm(vec![([4096, 0, 0, 0, 0, 0, 0], LOCKED)]));
    let sequence = rig.request(Request::Stop);
    // Another reading confirms it.
    rig.run(25_000);
    let reply = Reply::Failed(Failure::PoseOutOfRange);
    assert_eq!(rig.replies.last(), Some(&(sequence, reply)));
    rig.usb_out.extend(motion());
    rig.run(5_000);
    assert_eq!(rig.line(), READ_JOINTS.repeat(2));
}

/// The vendor's two-armed robot, which the adapter also polls.
#[test]
fn another_robot_is_not_held() {
    for poll in [Poll::Off, Poll::Hertz(100)] {
        let mut rig = rig(Config { poll, ..config() });
        rig.responder = Box::new(|request| (request == READ_JOINTS).then(|| (400, BESSICA.to_vec())));
        rig.run(50_000);
        let sequence = rig.request(Request::Stop);
        rig.run(100_000);
        let reply = Reply::Failed(Failure::PoseOutOfRange);
        assert_eq!(rig.replies.last(), Some(&(sequence, reply)));
        assert_eq!(sent(&rig), [[]; 0]);
    }
}

#[test]
fn arm_of_unknown_status_is_held() {
    let mut rig = rig(config());
    rig.responder = Box::new(arm(vec![(POSE, 0x42)]));
    let sequence = rig.request(Request::Stop);
    rig.run(25_000);
    assert_eq!(rig.replies.last(), Some(&(sequence, Reply::Done)));
    assert_eq!(sent(&rig), [hold(POSE, 310)]);
}

#[test]
fn identification_and_stop_do_not_mix() {
    let mut rig = rig(config());
    rig.responder = Box::new(|_| None);
    let identify = rig.request(Request::IdentifyArm);
    let stop = rig.request(Request::Stop);
    rig.run(3_000_000);
    let reply = |of| {
        let mut replies = rig.replies.iter().filter(|(sequence, _)| *sequence == of);
        replies.next_back().map(|(_, reply)| reply.clone())
    };
    assert!(matches!(reply(identify), Some(Reply::Arm(arm)) if arm.answer.is_none()));
    assert_eq!(reply(stop), Some(Reply::Failed(Failure::ArmSilent)));
}

#[test]
fn stop_is_refused_during_reservation() {
    let mut rig = rig(config());
    assert_eq!(rig.call(Request::ReserveLine), Reply::Done);
    assert_eq!(rig.call(Request::Stop), Reply::Failed(Failure::LineReserved));
    rig.usb_out.extend(motion());
    rig.run(5_000);
    assert_eq!(rig.line(), motion());
}

#[test]
fn reservation_waits_for_a_stop() {
    let mut rig = rig(config());
    rig.request(Request::Stop);
    rig.run(5_000);
    assert_eq!(rig.call(Request::ReserveLine), Reply::Failed(Failure::Busy));
    rig.run(1_900_000);
    assert_eq!(rig.call(Request::ReserveLine), Reply::Failed(Failure::Busy));
    rig.run(200_000);
    assert_eq!(rig.call(Request::ReserveLine), Reply::Done);
}

#[test]
fn restart_waits_for_the_hold() {
    let mut rig = rig(config());
    rig.request(Request::Stop);
    assert_eq!(rig.call(Request::Restart), Reply::Done);
    assert!(!rig.actions.contains(&Action::Restart));
    rig.run(300_000);
    assert!(rig.actions.contains(&Action::Restart));
}

#[test]
fn flash_is_not_written_during_a_stop() {
    let mut rig = rig(config());
    rig.request(Request::Stop);
    for request in [Request::SaveConfig, Request::ResetConfig] {
        assert_eq!(rig.call(request), Reply::Failed(Failure::Busy));
    }
    rig.run(400_000);
    rig.request(Request::SaveConfig);
    assert_eq!(rig.actions.len(), 1);
}

#[test]
fn stop_takes_line_from_another_rate() {
    let mut rig = rig(config());
    rig.bridge.usb_event(UsbEvent::Dtr(true), at(rig.now));
    let coding = crate::LineCoding {
        baud: 9_600,
        ..crate::LineCoding::LING
    };
    rig.bridge.set_line_coding(coding.to_cdc(), at(rig.now)).unwrap();
    rig.usb_out.extend([0x55; 300]);
    rig.run(20_000);
    assert_eq!(rig.bauds.last(), Some(&9_600));
    let begin = rig.now;
    rig.request(Request::Stop);
    rig.run(10_000);
    assert!(rig.bauds[1..].iter().all(|baud| *baud == 1_000_000));
    let (held, bytes) = rig.sent.last().unwrap();
    assert_eq!((bytes, held - begin < 7_000), (&hold(POSE, 310), true));
    let Reply::Line(line) = rig.call(Request::GetLine) else {
        panic!("no state of the line");
    };
    assert_eq!(line.reservation, LineReservation::None);
}

#[test]
fn repeated_stop_takes_the_line_too() {
    let mut rig = rig(config());
    rig.request(Request::Stop);
    rig.run(500_000);
    rig.bridge.usb_event(UsbEvent::Dtr(true), at(rig.now));
    let coding = crate::LineCoding {
        baud: 9_600,
        ..crate::LineCoding::LING
    };
    rig.bridge.set_line_coding(coding.to_cdc(), at(rig.now)).unwrap();
    // The last three bytes may begin a request.
    rig.usb_out.extend([&[0x55; 300][..], &motion()[..3]].concat());
    rig.run(20_000);
    let sent: usize = rig
        .sent
        .iter()
        .filter(|(_, bytes)| bytes[0] == 0x55)
        .map(|(_, bytes)| bytes.len())
        .sum();
    assert_eq!(rig.bauds.last(), Some(&9_600));
    rig.request(Request::Stop);
    // It stands at its goal, the last hold.
    rig.run(150_000);
    let last = rig.sent.iter().rev().find(|(_, bytes)| *bytes != READ_JOINTS);
    assert_eq!(rig.bauds.last(), Some(&1_000_000));
    assert_eq!(last.unwrap().1, hold(POSE, 310));
    assert_eq!(rig.bridge.counters().refused_rate_bytes as usize, 303 - sent);
}

#[test]
fn repeated_stop_renews_the_refusal() {
    let mut rig = rig(config());
    rig.request(Request::Stop);
    rig.run(REFUSAL - 1_000);
    let sequence = rig.request(Request::Stop);
    rig.run(REFUSAL - 1_000);
    assert_eq!(rig.replies.last(), Some(&(sequence, Reply::Done)));
    // The arm was at rest: it is held anew.
    let holds = rig.sent.iter().filter(|(_, bytes)| *bytes == hold(POSE, 310)).count();
    assert_eq!((holds, sent(&rig).len()), (10, 1));
    for refused in [true, false] {
        rig.can_out.push_back(motion());
        rig.run(5_000);
        assert_eq!(sent(&rig).last() != Some(&motion()), refused);
    }
}

#[test]
fn every_port_gets_the_reply_to_its_stop() {
    let mut rig = rig(config());
    rig.can_out.push_back(ling::SELF_CHECK.to_vec());
    rig.run(5_000);
    let usb = rig.request(Request::Stop);
    rig.request_on_can(9, Request::Stop);
    rig.run(5_000);
    let busy = rig.request(Request::Stop);
    assert_eq!(rig.replies.last(), Some(&(busy, Reply::Failed(Failure::Busy))));
    assert_eq!(rig.can_control, []);
    rig.run(600_000);
    assert_eq!(rig.replies.last(), Some(&(usb, Reply::Done)));
    let (sequence, reply) = (9, Reply::Done);
    assert_eq!(rig.can_control, [FromAdapter::Reply { sequence, reply }]);
    assert_eq!(sent(&rig).len(), 2, "one self-check, one hold");
    // A stop of an arm that is held is answered at once.
    rig.request_on_can(10, Request::Stop);
    rig.run(5_000);
    assert_eq!(rig.can_control.len(), 2);
}

#[test]
fn kind_without_a_stop_is_named() {
    for arm in [ArmKind::Raw, ArmKind::Alpha1Servo] {
        let mut rig = Rig::new(Config {
            arm,
            ..Config::default()
        });
        assert_eq!(rig.call(Request::Stop), Reply::Failed(Failure::NotStoppable(arm)));
        rig.usb_out.extend(motion());
        rig.run(100_000);
        assert_eq!(rig.line(), motion());
    }
}

#[test]
fn other_kind_ends_a_stop() {
    for (arm, reply) in [
        (ArmKind::Raw, Reply::Failed(Failure::NotStoppable(ArmKind::Raw))),
        (ArmKind::Alpha1, Reply::Done),
    ] {
        let mut rig = rig(config());
        rig.responder = Box::new(|_| None);
        let stop = rig.request(Request::Stop);
        rig.run(5_000);
        let config = Config {
            arm,
            ..Config::default()
        };
        let set = rig.request(Request::SetConfig(config));
        rig.run(1_000_000);
        assert_eq!(
            rig.replies[rig.replies.len() - 2..],
            [(set, Reply::Done), (stop, reply)]
        );
        rig.sent.clear();
        rig.usb_out.extend(motion());
        rig.run(100_000);
        assert_eq!(rig.line(), motion());
    }
}

/// A request for a stored action of an Alpha1.
fn play() -> Vec<u8> {
    vec![0xF3, 0x3F, 6, b'd', b'a', b'n', b'c', b'e', 0x01, 0xED]
}

#[test]
fn alpha1_is_stopped_behind_an_unanswered_action() {
    let mut rig = Rig::new(Config {
        arm: ArmKind::Alpha1,
        ..Config::default()
    });
    rig.responder = Box::new(|_| None);
    rig.usb_out.extend(play());
    rig.run(10_000);
    rig.sent.clear();
    let begin = rig.now;
    rig.request(Request::Stop);
    rig.run(3_000_000);
    let (at, bytes) = rig.sent.last().unwrap();
    assert_eq!((&bytes[..], rig.sent.len()), (&alpha1::STOP[..], 1));
    assert!((900_000..1_200_000).contains(&(at - begin)), "{}", at - begin);
}

#[test]
fn alpha1_gets_its_stop_request() {
    let mut rig = Rig::new(Config {
        arm: ArmKind::Alpha1,
        ..Config::default()
    });
    rig.responder = Box::new(|request: &[u8]| (request == alpha1::STOP).then(|| (200, vec![0xF2, 0x2F, 0xAA, 0xED])));
    rig.subscribe();
    let sequence = rig.request(Request::Stop);
    let play = play();
    rig.run(10_000);
    assert_eq!(rig.replies.last(), Some(&(sequence, Reply::Done)));
    rig.usb_out.extend(&play);
    rig.run(10_000);
    assert_eq!(rig.line(), [0xF2, 0x2F, 0, 0, 0, 0, 0, 0, 0, 0xED]);
    assert_eq!(rig.bridge.counters().refused_stopped, 1);
    // Its answer goes to nobody.
    assert_eq!((rig.usb.len(), rig.bridge.counters().unsolicited_frames), (0, 0));
    rig.run(REFUSAL);
    rig.usb_out.extend(&play);
    rig.run(10_000);
    assert_eq!(rig.line(), [&alpha1::STOP[..], &play].concat());
}
