//! The line's rate: changes by a host on USB, the return to the arm's rate, and reservations.

extern crate std;

use std::vec;
use std::vec::Vec;

use armwire::ling;

use super::rig::{Rig, at, ling, motion, void};
use crate::can::Node;
use crate::can::command::Command;
use crate::can::telemetry::event_from_frame;
use crate::config::{ArmKind, Can, Config, HostTimeout, Poll};
use crate::control::{
    Event, Failure, FromAdapter, Initiator, LineReservation, LineState, RESERVATION_MS, Refusal, Reply, Request,
};
use crate::{Instant, LineCoding, PACKET, UsbEvent};

const TORQUE_OFF: [u8; 7] = [0xAA, 0x05, 0x00, 0x01, 0x00, 0x6F, 0xFF];

const READ_JOINTS: [u8; 7] = [0xAA, 0x06, 0x00, 0x01, 0xFE, 0x9A, 0xFF];

const MS: u64 = 1_000;
const SECOND: u64 = 1_000_000;

/// Duration of a reservation.
const RESERVATION: u64 = RESERVATION_MS as u64 * MS;

fn coding(baud: u32) -> LineCoding {
    LineCoding {
        baud,
        ..LineCoding::LING
    }
}

fn set_rate(rig: &mut Rig, baud: u32) {
    let bytes = coding(baud).to_cdc();
    rig.bridge.set_line_coding(bytes, at(rig.now)).unwrap();
    rig.run(0);
}

fn dtr(rig: &mut Rig, high: bool) {
    rig.bridge.usb_event(UsbEvent::Dtr(high), at(rig.now));
    rig.run(0);
}

fn baud(rig: &Rig) -> u32 {
    rig.uart.coding.baud
}

/// An adapter with polls, commands and torque-off, whose port is open.
fn open(poll: Poll) -> Rig {
    let mut rig = Rig::new(Config {
        poll,
        can: Can {
            commands: true,
            ..Can::default()
        },
        host_timeout: HostTimeout {
            after_ms: 500,
            torque_off: true,
        },
        ..Config::default()
    });
    rig.subscribe();
    dtr(&mut rig, true);
    rig
}

/// The same with a host at 9600 baud.
fn open_at_9600(poll: Poll) -> Rig {
    let mut rig = open(poll);
    set_rate(&mut rig, 9_600);
    rig.usb_out.push_back(1);
    rig.run(10 * MS);
    assert_eq!(baud(&rig), 9_600);
    rig
}

const COMMAND: Command = Command {
    sequence: 1,
    joints: [2048; 6],
    speed: 10,
    gripper: 0,
};

/// Sends a cyclic command.
fn command(rig: &mut Rig, sequence: u8) {
    for frame in (Command { sequence, ..COMMAND }).to_frames(Node::default()) {
        rig.can_frame(&frame);
    }
}

/// The refusals with their initiators.
fn refusals(rig: &Rig) -> Vec<(Initiator, Refusal)> {
    let refused = rig.events.iter().filter_map(|(_, event)| match event {
        Event::Refused { initiator, reason } => Some((*initiator, *reason)),
        _ => None,
    });
    refused.collect()
}

fn line_state(rig: &mut Rig) -> LineState {
    match rig.call(Request::GetLine) {
        Reply::Line(state) => state,
        reply => panic!("{reply:?}"),
    }
}

fn polls(rig: &Rig) -> usize {
    rig.initiators
        .iter()
        .filter(|&&initiator| initiator == Initiator::Poll)
        .count()
}

#[test]
fn rate_takes_effect_with_the_first_byte() {
    // With DTR, without it, and where a port was closed.
    for dtrs in [&[true][..], &[], &[true, false]] {
        let mut rig = Rig::new(Config::default());
        dtrs.iter().for_each(|&high| dtr(&mut rig, high));
        rig.usb_out.extend([1; 5]);
        rig.run(0);
        set_rate(&mut rig, 115_200);
        assert_eq!((baud(&rig), rig.bridge.line_coding().baud), (1_000_000, 115_200));
        rig.usb_out.extend([2; 5]);
        rig.run(MS);
        assert_eq!(
            rig.sent.iter().map(|(_, bytes)| bytes.clone()).collect::<Vec<_>>(),
            [[1; 5], [2; 5]]
        );
        assert_eq!(rig.bauds, [1_000_000, 115_200]);
    }
}

#[test]
fn rate_takes_effect_on_open_port_after_100ms() {
    for high in [true, false] {
        let mut rig = Rig::new(Config::default());
        dtr(&mut rig, high);
        set_rate(&mut rig, 115_200);
        rig.run(100 * MS - 1);
        assert_eq!(baud(&rig), 1_000_000);
        rig.run(1);
        assert_eq!(baud(&rig), if high { 115_200 } else { 1_000_000 });
    }
}

#[test]
fn second_of_two_rates_wins() {
    let mut rig = open(Poll::Hertz(100));
    rig.run(100 * MS);
    let before = polls(&rig);
    set_rate(&mut rig, 9_600);
    rig.run(50 * MS);
    set_rate(&mut rig, 1_000_000);
    rig.run(450 * MS);
    assert_eq!(polls(&rig) - before, 50);
    let c = rig.bridge.counters();
    assert_eq!((c.line_codings, c.missed_polls, c.refused_line_reserved), (0, 0, 0));
}

#[test]
fn line_returns_to_arm_rate_without_host() {
    type Goes = fn(&mut Rig);
    let ways: [Goes; 4] = [
        |rig| {
            rig.bridge.usb_event(UsbEvent::Dtr(false), at(rig.now));
        },
        |rig| {
            rig.bridge.usb_event(UsbEvent::Reset, Instant::ZERO);
        },
        |rig| {
            rig.bridge.usb_event(UsbEvent::Configured(false), Instant::ZERO);
        },
        |rig| {
            rig.bridge.usb_event(UsbEvent::Suspended, Instant::ZERO);
        },
    ];
    for goes in ways {
        let mut rig = open_at_9600(Poll::Hertz(100));
        // The host's bytes go out at the rate they were meant for.
        rig.usb_out.extend([2; 40]);
        rig.run(0);
        goes(&mut rig);
        rig.run(200 * MS);
        assert_eq!(baud(&rig), 1_000_000);
        let last = rig
            .sent
            .iter()
            .zip(&rig.bauds)
            .filter(|((_, bytes), _)| bytes.contains(&2));
        let last: Vec<_> = last.map(|((_, bytes), &baud)| (bytes.len(), baud)).collect();
        assert_eq!(last, [(40, 9_600)]);
        let late = |n: &usize| rig.initiators[*n] == Initiator::Poll && rig.sent[*n].0 > 100 * MS;
        assert!((0..rig.sent.len()).filter(late).count() > 10);
        assert_eq!(rig.bridge.timeout().map(|at| at.as_micros() > rig.now), Some(true));
    }
}

#[test]
fn previous_rate_returns_only_with_a_byte() {
    let mut rig = open_at_9600(Poll::Off);
    dtr(&mut rig, false);
    rig.run(SECOND);
    assert_eq!((baud(&rig), rig.bridge.line_coding().baud), (1_000_000, 9_600));
    // The host's driver does not repeat SET_LINE_CODING.
    dtr(&mut rig, true);
    rig.run(50 * MS);
    assert_eq!(baud(&rig), 1_000_000);
    rig.usb_out.push_back(1);
    rig.run(MS);
    assert_eq!(baud(&rig), 9_600);
}

#[test]
fn another_program_may_reuse_port_with_raised_dtr() {
    let mut rig = open_at_9600(Poll::Hertz(100));
    rig.run(20 * SECOND);
    assert_eq!((baud(&rig), polls(&rig)), (9_600, 0));
    set_rate(&mut rig, 1_000_000);
    rig.run(100 * MS);
    assert_eq!((baud(&rig), polls(&rig)), (1_000_000, 10));
}

#[test]
fn host_without_dtr_loses_rate_after_10s_quiet() {
    let mut rig = Rig::new(Config::default());
    set_rate(&mut rig, 9_600);
    rig.usb_out.push_back(1);
    // Bytes in either direction extend it.
    rig.run(9 * SECOND);
    rig.arm_sends(&[0x11; 3]);
    rig.run(9 * SECOND);
    rig.usb_out.push_back(2);
    rig.run(10 * SECOND - 1);
    assert_eq!(baud(&rig), 9_600);
    rig.run(1);
    assert_eq!(baud(&rig), 1_000_000);
    rig.usb_out.push_back(3);
    rig.run(MS);
    assert_eq!(rig.bauds, [9_600; 3]);
}

#[test]
fn another_rate_waits_for_the_stream_on_can() {
    for by_command in [false, true] {
        let mut rig = open(Poll::Off);
        let mut sequence = 255_u8;
        let mut moves = |rig: &mut Rig| {
            sequence = sequence.wrapping_add(1);
            match by_command {
                true => command(rig, sequence),
                false => rig.can_out.push_back(motion()),
            }
            rig.run(20 * MS);
        };
        // The first command starts a stream, and moves nothing.
        (0..5 + u8::from(by_command)).for_each(|_| moves(&mut rig));
        set_rate(&mut rig, 9_600);
        for _ in 0..10 {
            rig.usb_out.extend([7; 100]);
            moves(&mut rig);
        }
        assert_eq!((baud(&rig), rig.bridge.line_coding().baud), (1_000_000, 9_600));
        let c = rig.bridge.counters();
        assert_eq!(
            (c.refused_rate_bytes, c.refused_other_rate, c.refused_line_reserved),
            (1_000, 1, 0)
        );
        assert_eq!(refusals(&rig), [(Initiator::Usb, Refusal::OtherRate)]);
        assert_eq!(rig.line(), motion().repeat(15));
        let waits = LineState {
            waiting: Some(coding(9_600)),
            ..LineState::default()
        };
        assert_eq!(line_state(&mut rig), waits);
        // The stream ends.
        rig.request_on_can(1, Request::EndStream);
        rig.run(10 * MS);
        assert_eq!(baud(&rig), 9_600);
    }
}

#[test]
fn polls_and_can_are_refused_at_other_rate() {
    for poll in [Poll::Hertz(100), Poll::Fastest] {
        let mut rig = open(poll);
        rig.run(50 * MS);
        set_rate(&mut rig, 9_600);
        rig.usb_out.push_back(1);
        rig.run(50 * MS);
        let before = rig.sent.len();
        rig.can_out.push_back(READ_JOINTS.to_vec());
        rig.run(50 * MS);
        for sequence in [0, 1] {
            command(&mut rig, sequence);
        }
        assert_eq!(rig.call(Request::IdentifyArm), Reply::Failed(Failure::LineReserved));
        rig.run(100 * MS);
        assert_eq!(rig.sent.len(), before, "{:?}", rig.sent);
        let initiators = [Initiator::Poll, Initiator::Can, Initiator::Command, Initiator::Adapter];
        let expected = initiators.map(|initiator| (initiator, Refusal::LineReserved));
        assert_eq!(refusals(&rig), expected);
        let events = rig.frames.iter().filter_map(|(_, frame)| event_from_frame(frame));
        let events: Vec<_> = events.map(|(_, event)| event).collect();
        assert_eq!(
            events,
            expected.map(|(initiator, reason)| Event::Refused { initiator, reason })
        );
        let c = rig.bridge.counters();
        assert_eq!(
            (c.refused_line_reserved, c.missed_polls),
            (4, if poll == Poll::Fastest { 0 } else { 20 })
        );
        let state = LineState {
            coding: coding(9_600),
            arm: coding(1_000_000),
            reservation: LineReservation::OtherRate,
            waiting: None,
        };
        assert_eq!(line_state(&mut rig), state);

        set_rate(&mut rig, 1_000_000);
        rig.can_out.push_back(READ_JOINTS.to_vec());
        rig.run(50 * MS);
        assert_eq!(rig.can.len(), 1);
        assert!(polls(&rig) >= 9 && *rig.bauds.last().unwrap() == 1_000_000);
        let sequence = rig.request(Request::IdentifyArm);
        rig.run(10 * MS);
        assert!(matches!(rig.replies.last(), Some((of, Reply::Arm(_))) if *of == sequence));
        assert_eq!(line_state(&mut rig), LineState::default());
    }
}

#[test]
fn waiting_request_is_refused_when_line_is_reserved() {
    let mut rig = open(Poll::Off);
    // The arm does not answer its self-check for the first host.
    rig.responder = std::boxed::Box::new(|_| None);
    rig.can_out.push_back(ling::SELF_CHECK.to_vec());
    rig.can_out.push_back(READ_JOINTS.to_vec());
    rig.run(10 * MS);
    let identify = rig.request(Request::IdentifyArm);
    set_rate(&mut rig, 9_600);
    rig.usb_out.push_back(1);
    rig.run(SECOND);
    assert_eq!(
        refusals(&rig),
        [
            (Initiator::Can, Refusal::LineReserved),
            (Initiator::Adapter, Refusal::LineReserved)
        ]
    );
    assert_eq!(
        rig.replies.last(),
        Some(&(identify, Reply::Failed(Failure::LineReserved)))
    );
    // The timeout of the pending answer was that of the arm's rate.
    assert_eq!(rig.bauds, [1_000_000, 9_600]);
}

#[test]
fn each_host_refused_by_a_reservation_gets_an_event_frame() {
    let mut rig = open(Poll::Hertz(100));
    rig.subscribe();
    rig.responder = std::boxed::Box::new(|_| None);
    rig.can_out.push_back(ling::SELF_CHECK.to_vec());
    rig.run(10 * MS);
    for sequence in 0..2 {
        command(&mut rig, sequence);
    }
    // Two in the queue, and one in the connection.
    for _ in 0..3 {
        rig.can_out.push_back(READ_JOINTS.to_vec());
    }
    rig.run(5 * MS);
    rig.request(Request::IdentifyArm);
    set_rate(&mut rig, 9_600);
    rig.usb_out.push_back(1);
    rig.run(5 * MS);
    let refused = |event: &Event| match event {
        Event::Refused {
            initiator,
            reason: Refusal::LineReserved,
        } => Some(*initiator),
        _ => None,
    };
    let frames = rig.frames.iter().filter_map(|(_, frame)| event_from_frame(frame));
    let on_can: Vec<_> = frames.filter_map(|(_, event)| refused(&event)).collect();
    assert_eq!(
        on_can,
        [
            Initiator::Poll,
            Initiator::Command,
            Initiator::Can,
            Initiator::Can,
            Initiator::Adapter,
            Initiator::Can
        ]
    );
    let to_subscribers: Vec<_> = rig.events.iter().filter_map(|(_, event)| refused(event)).collect();
    assert_eq!(to_subscribers, on_can);
    assert_eq!(rig.bridge.counters().dropped_events, 0);
}

/// A host on USB that streams motion at the arm's rate, then sets another one and sends continuously.
fn streams_then_sends_at(baud: u32) -> Rig {
    let mut rig = open(Poll::Off);
    for _ in 0..5 {
        rig.usb_out.extend(motion());
        rig.run(20 * MS);
    }
    set_rate(&mut rig, baud);
    rig.usb_out.extend(vec![0x55; 10_000]);
    rig
}

#[test]
fn torque_off_is_always_sent_at_arm_rate() {
    for baud in [1_200, 9_600, 115_200, 2_000_000] {
        let mut rig = streams_then_sends_at(baud);
        while rig.now < 2 * SECOND {
            // At a high rate the queue would be empty.
            if rig.usb_out.len() < 1_000 {
                rig.usb_out.extend(vec![0x55; 10_000]);
            }
            rig.run(MS);
        }
        // The last motion arrived after 80 ms.
        let due = 80 * MS + 500 * MS;
        let n = rig.sent.iter().position(|(_, bytes)| *bytes == TORQUE_OFF).unwrap();
        assert!(
            (due..due + 50 * MS).contains(&rig.sent[n].0),
            "{baud}: {}",
            rig.sent[n].0
        );
        assert_eq!((&rig.bauds[n - 4..=n], rig.bauds[n - 5]), (&[1_000_000; 5][..], baud));
        assert!(rig.sent[n - 4..n].iter().map(|(_, bytes)| bytes.clone()).eq(void()));
        assert_eq!(rig.sent.len(), n + 1, "the host's rate does not come back by itself");
        assert!(rig.bridge.counters().refused_rate_bytes > 0);
        assert_eq!(refusals(&rig), [(Initiator::Usb, Refusal::OtherRate)]);
        let state = LineState {
            waiting: Some(coding(baud)),
            ..LineState::default()
        };
        assert_eq!(line_state(&mut rig), state);
        rig.usb_out.clear();
        set_rate(&mut rig, baud);
        rig.usb_out.extend([0xA5; 3]);
        rig.run(100 * MS);
        assert_eq!((rig.line().last(), rig.bauds.last()), (Some(&0xA5), Some(&baud)));
    }
}

#[test]
fn zeros_end_earlier_and_other_rate_bytes() {
    // Half a frame before the change, half a frame at the other rate, and a whole one that the arm cannot have
    // received.
    for (before, after) in [
        (&[0xAA, 0x06][..], &[0x55; 100][..]),
        (&[], &[0xAA, 0x06]),
        (&[0xAA, 0x06], &READ_JOINTS),
    ] {
        let mut rig = open(Poll::Off);
        for _ in 0..5 {
            rig.usb_out.extend(motion());
            rig.run(20 * MS);
        }
        rig.usb_out.extend(before);
        rig.run(MS);
        set_rate(&mut rig, 2_000_000);
        rig.usb_out.extend(after);
        rig.run(50 * MS);
        dtr(&mut rig, false);
        rig.run(SECOND);
        let n = rig.sent.iter().position(|(_, bytes)| *bytes == TORQUE_OFF).unwrap();
        assert!(rig.sent[n - 4..n].iter().map(|(_, bytes)| bytes.clone()).eq(void()));
        assert_eq!(rig.bauds[n - 4..n], [1_000_000; 4]);
    }
}

#[test]
fn bytes_at_other_rate_are_no_motion() {
    let mut rig = open_at_9600(Poll::Off);
    for _ in 0..10 {
        rig.usb_out.extend(motion());
        rig.run(100 * MS);
    }
    rig.run(2 * SECOND);
    assert_eq!(
        (
            rig.bridge.update(Instant::ZERO).is_armed,
            rig.bridge.counters().host_silences
        ),
        (false, 0)
    );
}

#[test]
fn raw_arm_uses_the_host_rate() {
    let mut rig = Rig::new(Config {
        arm: ArmKind::Raw,
        ..Config::default()
    });
    dtr(&mut rig, true);
    set_rate(&mut rig, 115_200);
    dtr(&mut rig, false);
    rig.can_out.push_back(b"anything".to_vec());
    rig.run(10 * MS);
    assert_eq!((rig.line(), rig.bauds.clone()), (b"anything".to_vec(), vec![115_200]));
    let state = LineState {
        coding: coding(115_200),
        arm: coding(115_200),
        ..LineState::default()
    };
    assert_eq!(line_state(&mut rig), state);
}

#[test]
fn reservation_gives_usb_the_line_alone() {
    let mut rig = open(Poll::Hertz(100));
    rig.run(50 * MS);
    let before = polls(&rig);
    assert_eq!(rig.call(Request::ReserveLine), Reply::Done);
    rig.run(10 * MS);
    let start = rig.sent.len();
    let image: Vec<u8> = (0..20_000_u32).map(|n| (n * 7 / 3) as u8).collect();
    rig.usb_out.extend(&image);
    rig.can_out.push_back(READ_JOINTS.to_vec());
    rig.run(500 * MS);
    assert_eq!(
        rig.sent[start..]
            .iter()
            .flat_map(|(_, bytes)| bytes.clone())
            .collect::<Vec<_>>(),
        image
    );
    assert!(polls(&rig) <= before + 1);
    assert_eq!(
        refusals(&rig),
        [
            (Initiator::Poll, Refusal::LineReserved),
            (Initiator::Can, Refusal::LineReserved)
        ]
    );
    assert_eq!(line_state(&mut rig).reservation, LineReservation::Requested);
    let others = polls(&rig);
    assert_eq!(rig.call(Request::ReleaseLine), Reply::Done);
    rig.run(100 * MS);
    assert_eq!(polls(&rig) - others, 10);
    assert_eq!(line_state(&mut rig), LineState::default());
}

#[test]
fn reservation_ends_in_time_unless_renewed() {
    let mut rig = open(Poll::Hertz(100));
    for _ in 0..3 {
        assert_eq!(rig.call(Request::ReserveLine), Reply::Done);
        rig.run(RESERVATION - 1);
        assert_eq!(line_state(&mut rig).reservation, LineReservation::Requested);
    }
    rig.run(1);
    assert_eq!(line_state(&mut rig), LineState::default());
    rig.run(100 * MS);
    assert_eq!(polls(&rig), 10);
}

#[test]
fn reservation_ends_when_its_host_is_gone() {
    type Goes = fn(&mut Rig);
    let ways: [Goes; 2] = [
        |rig| {
            rig.bridge.usb_event(UsbEvent::Reset, Instant::ZERO);
        },
        |rig| {
            rig.bridge.usb_event(UsbEvent::Configured(true), Instant::ZERO);
        },
    ];
    for goes in ways {
        let mut rig = open(Poll::Off);
        assert_eq!(rig.call(Request::ReserveLine), Reply::Done);
        goes(&mut rig);
        rig.run(MS);
        assert_eq!(line_state(&mut rig), LineState::default());
    }
}

#[test]
fn reservation_is_refused_during_motion_stream() {
    for on_can in [true, false] {
        let mut rig = open(Poll::Off);
        for _ in 0..3 {
            match on_can {
                true => rig.can_out.push_back(motion()),
                false => rig.usb_out.extend(motion()),
            }
            rig.run(20 * MS);
        }
        assert_eq!(rig.call(Request::ReserveLine), Reply::Failed(Failure::StreamArmed));
        assert_eq!(line_state(&mut rig), LineState::default());
        rig.run(SECOND);
        assert_eq!(rig.sent.last().unwrap().1, TORQUE_OFF);
        assert_eq!(rig.call(Request::ReserveLine), Reply::Done);
    }
}

#[test]
fn nobodys_torque_goes_off_under_reservation() {
    let mut rig = open(Poll::Off);
    assert_eq!(rig.call(Request::ReserveLine), Reply::Done);
    for _ in 0..5 {
        rig.usb_out.extend(motion());
        rig.run(20 * MS);
    }
    rig.run(5 * SECOND);
    assert_eq!(
        (rig.line(), rig.bridge.update(Instant::ZERO).is_armed),
        (motion().repeat(5), false)
    );
}

#[test]
fn control_port_cannot_end_reservation_of_other_port() {
    let mut rig = open(Poll::Off);
    assert_eq!(rig.call(Request::ReserveLine), Reply::Done);
    rig.request_on_can(1, Request::ReserveLine);
    rig.request_on_can(2, Request::ReleaseLine);
    rig.run(10 * MS);
    let reply = |sequence, reply| FromAdapter::Reply { sequence, reply };
    let replies = [reply(1, Reply::Failed(Failure::Busy)), reply(2, Reply::Done)];
    assert_eq!(rig.can_control, replies);
    assert_eq!(line_state(&mut rig).reservation, LineReservation::Requested);
}

#[test]
fn under_reservation_any_rate_is_the_hosts() {
    let mut rig = open(Poll::Hertz(100));
    assert_eq!(rig.call(Request::ReserveLine), Reply::Done);
    set_rate(&mut rig, 115_200);
    rig.usb_out.extend([0x7F; PACKET]);
    rig.run(100 * MS);
    assert_eq!(rig.bauds.last(), Some(&115_200));
    assert_eq!(line_state(&mut rig).reservation, LineReservation::Requested);
    assert_eq!(rig.call(Request::ReleaseLine), Reply::Done);
    assert_eq!(line_state(&mut rig).reservation, LineReservation::OtherRate);
    dtr(&mut rig, false);
    rig.run(100 * MS);
    assert_eq!((baud(&rig), polls(&rig)), (1_000_000, 10));
    assert_eq!(ling(0x05, 0, &[0]), TORQUE_OFF);
}

#[test]
fn dropped_change_of_rate_reserves_no_line() {
    for torque_off in [false, true] {
        let mut rig = Rig::new(Config {
            poll: Poll::Hertz(10),
            host_timeout: HostTimeout {
                after_ms: 100,
                torque_off,
            },
            ..Config::default()
        });
        rig.subscribe();
        for _ in 0..3 {
            rig.usb_out.extend(motion());
            rig.run(10 * MS);
        }
        // A missing answer to a self-check from CAN blocks the host's bytes, which were for two rates in a row.
        rig.responder = std::boxed::Box::new(|_| None);
        rig.can_out.push_back(ling(0xFE, 0, &[0xFE]));
        rig.run(MS);
        rig.usb_out.extend(motion());
        rig.run(0);
        set_rate(&mut rig, 115_200);
        rig.usb_out.extend(motion());
        rig.run(0);
        set_rate(&mut rig, 1_000_000);
        rig.run(2 * SECOND);
        assert_eq!(rig.bridge.counters().host_silences, 1);
        assert_eq!(line_state(&mut rig), LineState::default());
        let before = rig.sent.len();
        rig.run(SECOND);
        assert!(rig.sent.len() > before, "{torque_off}: no polls");
    }
}
