//! Hosts on CAN that the adapter delays: their motion finds no room while another's request waits for its answer.

extern crate std;

use std::boxed::Box;
use std::vec;
use std::vec::Vec;

use armwire::ling::SELF_CHECK;

use super::rig::{Responder, Rig, ling, ling_responder, motion};
use crate::can::command::Command;
use crate::can::{Frame, Function, Node};
use crate::config::{ArmKind, Can, Config, HostTimeout, Poll};
use crate::control::{Event, Initiator};

const TORQUE_OFF: [u8; 7] = [0xAA, 0x05, 0x00, 0x01, 0x00, 0x6F, 0xFF];
const READ_JOINTS: [u8; 7] = [0xAA, 0x06, 0x00, 0x01, 0xFE, 0x9A, 0xFF];

const SECOND: u64 = 1_000_000;

/// Torque-off after this number of milliseconds of silence.
fn torque_off_after(after_ms: u16) -> Config {
    Config {
        host_timeout: HostTimeout {
            after_ms,
            torque_off: true,
        },
        can: Can {
            commands: true,
            ..Can::default()
        },
        ..Config::default()
    }
}

/// The silences that subscribers received: their times and initiators.
fn silences(rig: &Rig) -> Vec<(u64, Initiator)> {
    let silent = |(at, event): &(crate::control::Stamp, Event)| match event {
        Event::HostSilent { initiator, .. } => Some((at.0, *initiator)),
        _ => None,
    };
    rig.events.iter().filter_map(silent).collect()
}

/// The times at which torque-off went out.
fn torque_offs(rig: &Rig) -> Vec<u64> {
    let offs = rig.sent.iter().filter(|(_, bytes)| bytes == &TORQUE_OFF);
    offs.map(|(at, _)| *at).collect()
}

/// An arm that answers a self-check after this time, or never, and polls if `polls`.
fn arm(self_check: Option<u64>, polls: bool) -> Responder {
    let mut others = ling_responder();
    Box::new(move |request| match request[1] {
        0xFE => Some((self_check?, ling(0xFE, 0, &[0, 0]))),
        _ => others(request).filter(|_| polls),
    })
}

/// An adapter with an arm, and a host on CAN that has a stream.
fn streaming(config: Config, arm: Responder) -> Rig {
    let mut rig = Rig::new(config);
    rig.subscribe();
    for _ in 0..3 {
        rig.can_out.push_back(motion());
        rig.run(5_000);
    }
    rig.responder = arm;
    rig
}

/// The host on CAN sends motion in this period for `micros`. Returns the time of the last.
fn stream(rig: &mut Rig, period: u64, micros: u64) -> u64 {
    let end = rig.now + micros;
    let mut last = rig.now;
    while rig.now < end {
        last = rig.now;
        rig.can_out.push_back(motion());
        rig.run(period);
    }
    last
}

/// The host on USB sends a self-check.
fn check(rig: &mut Rig) {
    rig.usb_out.extend(SELF_CHECK);
    rig.run(1_000);
}

/// The silence of the host on CAN switched the torque off once, this time after its last motion.
fn assert_silent(rig: &Rig, last: u64, after_ms: u16) {
    // A motion takes up to 1 ms on the bus.
    let due = last + u64::from(after_ms) * 1_000;
    let due = due..due + 1_000;
    let (silent, offs) = (silences(rig), torque_offs(rig));
    assert!(
        matches!(silent[..], [(at, Initiator::Can)] if due.contains(&at)),
        "{silent:?}, due in {due:?}"
    );
    assert!(
        matches!(offs[..], [at] if due.contains(&at)),
        "{offs:?}, due in {due:?}"
    );
}

#[test]
fn delayed_can_stream_is_not_silent() {
    const MILLISECOND: u64 = 1_000;
    let polls = |hertz| Poll::Hertz(hertz);
    // The timeout, the period of the motion, the self-check's answer, the polls, and whether they are answered.
    for (after_ms, period, self_check, poll, answers) in [
        (300, 20 * MILLISECOND, Some(450 * MILLISECOND), Poll::Off, true),
        (500, MILLISECOND, None, Poll::Off, true),
        (500, 20 * MILLISECOND, None, polls(100), false),
        (100, 10 * MILLISECOND, None, polls(50), false),
        (200, 5 * MILLISECOND, None, polls(1_000), false),
        (300, 100 * MILLISECOND, None, polls(20), true),
        (300, 140 * MILLISECOND, Some(490 * MILLISECOND), Poll::Off, true),
        (300, 200 * MILLISECOND, None, Poll::Fastest, false),
        (500, 400 * MILLISECOND, None, polls(100), false),
    ] {
        let config = Config {
            poll,
            ..torque_off_after(after_ms)
        };
        let mut rig = streaming(config, arm(self_check, answers));
        let mut last = 0;
        for _ in 0..4 {
            check(&mut rig);
            last = stream(&mut rig, period, SECOND);
        }
        assert_eq!(silences(&rig), [], "after {after_ms} ms, every {period} µs, {poll:?}");
        assert!(rig.bridge.counters().refused_can_requests > 0 || period > 100 * MILLISECOND);
        rig.run(SECOND);
        assert_silent(&rig, last, after_ms);
    }
}

#[test]
fn motion_refused_beside_another_can_host_keeps_stream() {
    let mut rig = streaming(torque_off_after(300), arm(None, false));
    // Each read is in a single frame. Together they take every place.
    let read = [&[READ_JOINTS.len() as u8], &READ_JOINTS[..]].concat();
    let read = Frame::new(Function::ArmRequest.id(Node::default()), &read).unwrap();
    check(&mut rig);
    let mut last = 0;
    for _ in 0..100 {
        for _ in 0..3 {
            rig.can_frame(&read);
            rig.run(300);
        }
        last = stream(&mut rig, 19_100, 1);
    }
    assert_eq!(silences(&rig), []);
    assert!(rig.bridge.counters().refused_can_requests > 200);
    rig.run(SECOND);
    assert_silent(&rig, last, 300);
}

#[test]
fn host_dying_behind_full_queue_switches_torque_off() {
    for (after_ms, period) in [(100, 10_000), (200, 1_000), (300, 20_000), (300, 100_000), (400, 2_000)] {
        let mut rig = streaming(torque_off_after(after_ms), arm(None, false));
        check(&mut rig);
        let began = rig.now;
        let last = stream(&mut rig, period, 90_000);
        rig.run(SECOND);
        // The motion that waits gets 150 ms.
        let last = last.max(began + 150_000 - u64::from(after_ms.min(150)) * 1_000);
        assert_silent(&rig, last, after_ms);
    }
}

#[test]
fn motion_waiting_in_the_connection_keeps_stream() {
    let mut rig = streaming(torque_off_after(300), arm(None, false));
    check(&mut rig);
    // Two take the queue, and the third waits in the connection.
    stream(&mut rig, 5_000, 10_000);
    rig.run(250_000);
    let last = stream(&mut rig, 10_000, 1);
    assert_eq!(rig.bridge.counters().refused_can_requests, 0);
    rig.run(SECOND);
    assert_silent(&rig, last, 300);
}

#[test]
fn motion_waiting_in_the_connection_gets_150_ms() {
    let mut rig = streaming(torque_off_after(100), arm(None, false));
    check(&mut rig);
    for _ in 0..2 {
        rig.can_out.push_back(READ_JOINTS.to_vec());
    }
    rig.run(2_000);
    let last = stream(&mut rig, 10_000, 1);
    assert_eq!(rig.bridge.line.settled().waiting(), (2, 0));
    rig.run(SECOND);
    assert_silent(&rig, last + 50_000, 100);
}

/// Sends `pdu` on CAN every 10 ms, beside a self-check and a full queue. Returns the time of the last motion.
fn refuse_behind_stream(rig: &mut Rig, pdu: &[u8]) -> u64 {
    check(rig);
    let last = stream(rig, 2_000, 6_000);
    for _ in 0..40 {
        rig.can_out.push_back(pdu.to_vec());
        rig.run(10_000);
    }
    last
}

/// A frame with other bytes at these places.
fn with(mut frame: Vec<u8>, bytes: &[(usize, u8)]) -> Vec<u8> {
    for &(at, byte) in bytes {
        frame[at] = byte;
    }
    frame
}

#[test]
fn other_requests_without_room_keep_no_stream() {
    let longer = [motion(), vec![0]].concat();
    for pdu in [
        READ_JOINTS.to_vec(),
        ling(0x05, 0, &[1]),
        // A setting in several frames, another header, another length, and more bytes than in any frame.
        ling(0x06, 0x01, &[0; 20]),
        with(motion(), &[(0, 0xBB)]),
        with(motion(), &[(3, 10)]),
        longer,
        vec![0xAA; 90],
        vec![0xAA, 0x06, 0x03],
    ] {
        let mut rig = streaming(torque_off_after(200), arm(None, false));
        let last = refuse_behind_stream(&mut rig, &pdu);
        assert!(rig.bridge.counters().refused_can_requests >= 20, "{pdu:02X?}");
        assert_silent(&rig, last, 200);
    }
}

#[test]
fn whole_frame_without_room_must_be_valid() {
    for is_valid in [true, false] {
        let mut config = torque_off_after(200);
        config.can.data_bit_rate = Some(2_000_000);
        let mut rig = streaming(config, arm(None, false));
        // It is in one frame of CAN FD.
        let pdu = match is_valid {
            true => motion(),
            false => with(motion(), &[(20, 0x55)]),
        };
        let last = refuse_behind_stream(&mut rig, &pdu);
        match is_valid {
            true => assert_eq!(silences(&rig), []),
            false => assert_silent(&rig, last, 200),
        }
    }
}

#[test]
fn motion_without_room_begins_no_stream() {
    let mut rig = Rig::new(torque_off_after(300));
    rig.subscribe();
    rig.responder = arm(None, false);
    check(&mut rig);
    for _ in 0..3 {
        rig.can_out.push_back(READ_JOINTS.to_vec());
    }
    rig.run(2_000);
    stream(&mut rig, 10_000, 100_000);
    assert_eq!(rig.bridge.counters().refused_can_requests, 10);
    assert!(!rig.bridge.update(super::rig::at(rig.now)).is_armed);
    rig.run(2 * SECOND);
    assert_eq!((silences(&rig), torque_offs(&rig)), (vec![], vec![]));
}

#[test]
fn header_decides_by_the_configured_arm() {
    // A servo moves, and a servo releases its motor (servo manual): each takes two frames.
    let servo = |angle: u8| {
        let data = [1, 0x01, angle, 10, 0, 10];
        let check = data.iter().fold(0_u8, |sum, byte| sum.wrapping_add(*byte));
        [&[0xFA, 0xAF], &data[..], &[check, 0xED]].concat()
    };
    for (pdu, keeps) in [(servo(90), true), (servo(0xFF), false), (motion(), false)] {
        let config = Config {
            arm: ArmKind::Alpha1,
            can: Can::default(),
            ..torque_off_after(200)
        };
        let mut rig = Rig::new(config);
        rig.subscribe();
        rig.responder = Box::new(|_| None);
        for _ in 0..3 {
            rig.can_out.push_back(servo(90));
            rig.run(10_000);
        }
        // The robot's answer takes up to a second (row F3).
        rig.usb_out.extend([0xF3, 0x3F, 1, 1, 0xED]);
        rig.run(5_000);
        let mut last = 0;
        for _ in 0..3 {
            last = rig.now;
            rig.can_out.push_back(servo(90));
            rig.run(2_000);
        }
        for _ in 0..50 {
            rig.can_out.push_back(pdu.clone());
            rig.run(10_000);
        }
        assert!(rig.bridge.counters().refused_can_requests >= 20);
        let silent = silences(&rig);
        match keeps {
            true => assert_eq!(silent, []),
            false => assert!(matches!(silent[..], [(at, _)] if at < last + 201_000), "{silent:?}"),
        }
    }
}

fn send(rig: &mut Rig, command: Command) {
    for frame in command.to_frames(Node::default()) {
        rig.can_frame(&frame);
    }
}

fn command(sequence: u8) -> Command {
    Command {
        sequence,
        joints: [2048; 6],
        speed: 50,
        gripper: 0,
    }
}

/// Starts a stream of commands, and continues it every 10 ms by these. Returns the time of the last of the first ten.
fn stream_commands(rig: &mut Rig, number: u64, others: impl Fn(u8) -> Command) -> u64 {
    for sequence in 0..10 {
        send(rig, command(sequence));
        rig.run(10_000);
    }
    let last = rig.now - 10_000;
    for nth in 0..number {
        send(rig, others((10 + nth) as u8));
        rig.run(10_000);
    }
    last
}

#[test]
fn command_refused_for_its_speed_keeps_stream() {
    for speed in [0, 251, 255] {
        let mut rig = Rig::new(torque_off_after(300));
        rig.subscribe();
        // More than the sequence number counts.
        stream_commands(&mut rig, 400, |sequence| Command {
            speed,
            ..command(sequence)
        });
        assert_eq!(silences(&rig), []);
        let c = rig.bridge.counters();
        assert_eq!((c.commands_out_of_range, c.commands_stale), (400, 0));
        // The next command moves the arm.
        let before = rig.sent.len();
        send(&mut rig, command(410_u16 as u8));
        rig.run(10_000);
        let last = rig.now - 10_000;
        assert_eq!(rig.sent.len(), before + 1);
        rig.run(SECOND);
        assert_eq!(silences(&rig), [(last + 300_000, Initiator::Command)]);
    }
}

#[test]
fn command_refused_for_more_than_speed_keeps_no_stream() {
    let refused: [fn(u8) -> Command; 4] = [
        |sequence| Command {
            gripper: 251,
            ..command(sequence)
        },
        |sequence| Command {
            joints: [4096; 6],
            ..command(sequence)
        },
        |sequence| Command {
            speed: 0,
            gripper: 251,
            ..command(sequence)
        },
        |_| Command { speed: 0, ..command(9) },
    ];
    for others in refused {
        let mut rig = Rig::new(torque_off_after(300));
        rig.subscribe();
        let last = stream_commands(&mut rig, 100, others);
        assert_eq!(silences(&rig), [(last + 300_000, Initiator::Command)]);
    }
}

#[test]
fn commands_refused_for_speed_begin_no_stream() {
    let mut rig = Rig::new(torque_off_after(300));
    rig.subscribe();
    for sequence in 0..100 {
        send(
            &mut rig,
            Command {
                speed: 0,
                ..command(sequence)
            },
        );
        rig.run(10_000);
    }
    assert!(!rig.bridge.update(super::rig::at(rig.now)).is_armed);
    rig.run(SECOND);
    assert_eq!((silences(&rig), rig.sent.len()), (vec![], 0));
}
