//! Hosts on USB and CAN and the adapter's own poll share one arm.

extern crate std;

use std::boxed::Box;
use std::vec;
use std::vec::Vec;

use armwire::alpha1::{self, Alpha1};
use armwire::framing::LONGEST_VOID;
use armwire::messages::Messages;
use proptest::prelude::*;

use super::rig::{Rig, at, ling, ling_responder, void};
use crate::can::Node;
use crate::config::{ArmKind, Can, Config, Poll};
use crate::control::{Event, Initiator, Refusal, Reply, Request};
use crate::{Action, Duration};

const JOINTS: [u8; 7] = [0xAA, 0x06, 0x00, 0x01, 0xFE, 0x9A, 0xFF];

fn info() -> Vec<u8> {
    ling(0x01, 0, &[0xFE])
}

fn temperatures() -> Vec<u8> {
    ling(0x06, 1, &[0xFE])
}

fn velocities() -> Vec<u8> {
    ling(0x06, 2, &[0xFE])
}

fn polling(poll: Poll) -> Rig {
    Rig::new(Config {
        poll,
        ..Config::default()
    })
}

/// The commands and functions of the frames in a stream that consists of frames.
fn kinds(mut stream: &[u8]) -> Vec<(u8, u8)> {
    let mut kinds = vec![];
    while let [0xAA, command, function, len, ..] = *stream {
        kinds.push((command, function));
        stream = &stream[usize::from(len) + 6..];
    }
    assert_eq!(stream, []);
    kinds
}

#[test]
fn each_reply_goes_to_its_initiator_only() {
    let mut rig = polling(Poll::Hertz(300));
    rig.subscribe();
    for n in 0..50 {
        rig.usb_out.extend(temperatures());
        rig.can_out.push_back(velocities());
        rig.run(1_500 + n);
    }
    rig.run(20_000);
    let c = rig.bridge.counters();
    assert_eq!((c.requests_usb, c.requests_can), (50, 50));
    assert_eq!((c.unanswered_requests, c.unsolicited_frames, c.late_answers), (0, 0, 0));
    assert_eq!(kinds(&rig.usb), vec![(0x06, 1); 50]);
    assert_eq!(rig.can.len(), 50);
    assert!(rig.can.iter().all(|pdu| kinds(pdu) == [(0x06, 2)]));
    assert_eq!(u64::from(c.requests_poll), rig.now * 300 / 1_000_000);

    // Subscribers receive all frames with their initiators.
    let frames_of = |initiator: Option<Initiator>| {
        rig.events
            .iter()
            .filter(move |(_, event)| matches!(event, Event::Frame { initiator: a, .. } if *a == initiator))
    };
    assert_eq!(frames_of(Some(Initiator::Usb)).count(), 50);
    assert_eq!(frames_of(Some(Initiator::Can)).count(), 50);
    assert_eq!(frames_of(Some(Initiator::Poll)).count() as u32, c.requests_poll);
    assert!(rig.events.is_sorted_by_key(|&(at, _)| at));
    assert_eq!(c.frames as usize, rig.events.len());
}

#[test]
fn frame_stamp_is_time_of_last_byte() {
    let mut rig = Rig::new(Config::default());
    rig.subscribe();
    rig.run(1_000);
    rig.usb_out.extend(JOINTS);
    rig.run(1_000);
    // 7 bytes, 200 µs, 21 bytes.
    assert_eq!(rig.events.last().unwrap().0.0, 1_000 + 70 + 200 + 210);
    assert_eq!(rig.bridge.line.settled().latencies().answer.counts[8], 1);
}

#[test]
fn usb_request_waits_from_its_first_byte() {
    let mut rig = Rig::new(Config::default());
    rig.can_out.push_back(info());
    rig.run(200);
    rig.usb_out.extend(&JOINTS[..3]);
    rig.run(300);
    rig.usb_out.extend(&JOINTS[3..]);
    rig.run(10_000);
    let waited = rig.sent[1].0 - 200;
    assert!((300..512).contains(&waited), "{waited}");
    // The request from CAN did not wait.
    let latencies = rig.bridge.line.settled().latencies().turn.counts;
    assert_eq!((latencies[0], latencies[8], latencies.iter().sum()), (1, 1, 2));
}

#[test]
fn unsolicited_frame_reaches_usb_and_subscribers_during_exchange() {
    let mut rig = Rig::new(Config::default());
    rig.subscribe();
    let unsolicited = ling(0x06, 0, &[9; 15]);
    let mut ling_responder = ling_responder();
    let sent = unsolicited.clone();
    // The arm sends another frame first, then noise and the answer.
    rig.responder = Box::new(move |request| {
        ling_responder(request).map(|(after, answer)| (after, [&sent[..], b"??", &answer[..]].concat()))
    });
    rig.can_out.push_back(info());
    rig.run(10_000);
    assert_eq!(rig.usb, [&unsolicited[..], b"??"].concat());
    assert_eq!(kinds(&rig.can.concat()), [(0x01, 0)]);
    let c = rig.bridge.counters();
    assert_eq!((c.unsolicited_frames, c.noise_bytes, c.frames), (1, 2, 2));
    assert!(matches!(&rig.events[0].1, Event::Frame { initiator: None, bytes } if bytes[..] == unsolicited));
    assert!(matches!(
        &rig.events[1].1,
        Event::Frame {
            initiator: Some(Initiator::Can),
            ..
        }
    ));
}

#[test]
fn error_frame_goes_to_the_initiator_waiting() {
    let mut rig = Rig::new(Config::default());
    let error = ling(0xEE, 0, &[1, 3]);
    rig.arm_sends(&error);
    rig.run(10_000);
    assert_eq!(rig.usb, error, "nobody waits");
    let answer = error.clone();
    rig.responder = Box::new(move |_| Some((200, answer.clone())));
    rig.can_out.push_back(info());
    rig.run(10_000);
    rig.usb_out.extend(JOINTS);
    rig.run(10_000);
    assert_eq!(rig.can, [&error[..]]);
    assert_eq!(rig.usb, [&error[..], &error].concat());
    let c = rig.bridge.counters();
    assert_eq!((c.requests_can, c.requests_usb), (1, 1));
    assert_eq!((c.unanswered_requests, c.unsolicited_frames, c.late_answers), (0, 1, 0));
}

#[test]
fn unsolicited_frame_reaches_can_if_configured() {
    for unsolicited in [false, true] {
        let mut rig = Rig::new(Config {
            can: Can {
                unsolicited,
                ..Can::default()
            },
            ..Config::default()
        });
        let frame = ling(0x06, 0, &[9; 15]);
        rig.arm_sends(&frame);
        rig.usb_out.extend(info());
        rig.run(10_000);
        assert_eq!(rig.can, vec![frame; usize::from(unsolicited)]);
        assert_eq!(kinds(&rig.usb).len(), 2);
    }
}

#[test]
fn frame_started_before_request_is_no_answer() {
    let mut rig = Rig::new(Config::default());
    let mut unsolicited = ling(0x06, 0, &[9; 15]);
    rig.arm_sends(&unsolicited);
    rig.run(55);
    rig.can_out.push_back(JOINTS.to_vec());
    rig.run(10_000);
    assert_eq!(rig.usb, unsolicited);
    assert_eq!(rig.can.len(), 1);
    assert_eq!(rig.can[0][4], 1);
    unsolicited.clear();
}

#[test]
fn second_of_usb_alone_ends_sharing() {
    // Requests, partial requests and noise, split anywhere, byte by byte and in packets of any size.
    let mut rig = Rig::new(Config::default());
    let mut sent = vec![];
    for n in 0..200_usize {
        let piece = match n % 4 {
            0 => JOINTS.to_vec(),
            1 => info()[..3].to_vec(),
            2 => vec![n as u8; n],
            _ => [temperatures(), velocities(), JOINTS.to_vec(), JOINTS.to_vec()].concat(),
        };
        rig.usb_out.extend(&piece);
        sent.extend(piece);
        rig.run(5_000);
    }
    assert_eq!(rig.line(), sent);
    assert_eq!(rig.bridge.counters().host_to_arm_bytes as usize, sent.len());
}

#[test]
fn untracked_usb_requests_give_answers_to_no_other() {
    let mut rig = Rig::new(Config::default());
    for _ in 0..20 {
        rig.usb_out.extend(JOINTS);
    }
    rig.run(1_500);
    rig.can_out.push_back(JOINTS.to_vec());
    rig.run(500_000);
    assert_eq!(kinds(&rig.usb), vec![(0x06, 0); 20]);
    assert_eq!(
        rig.usb.chunks(21).map(|frame| frame[4]).collect::<Vec<_>>(),
        (1..=20).collect::<Vec<u8>>()
    );
    // The 21st request, the 21st answer.
    assert_eq!(rig.can.len(), 1);
    assert_eq!(rig.can[0][4], 21);
}

#[test]
fn unsolicited_frame_is_no_answer_despite_open_requests() {
    let mut rig = Rig::new(Config::default());
    // The arm answers late: all requests are in flight when it sends another frame.
    rig.responder = Box::new(|_| None);
    rig.usb_out.extend(JOINTS.repeat(9));
    rig.run(700);
    rig.can_out.push_back(JOINTS.to_vec());
    rig.run(1_000);
    rig.arm_sends(&ling(0x77, 0, &[]));
    for n in 1..=9 {
        rig.arm_sends(&ling(0x06, 0, &[n; 15]));
        rig.run(1_000);
    }
    // The answer to the ninth request, which is not tracked, is unsolicited, too.
    let c = rig.bridge.counters();
    assert_eq!((c.unsolicited_frames, c.untracked_requests), (2, 1));
    assert_eq!((kinds(&rig.usb).len(), rig.can.len()), (10, 0));
}

#[test]
fn answer_may_arrive_while_host_sends_more() {
    let mut rig = Rig::new(Config::default());
    rig.usb_out.extend(JOINTS.repeat(8));
    rig.run(50_000);
    // The first answer is in at 480 µs, the last request out at 560 µs.
    let c = rig.bridge.counters();
    assert_eq!((c.frames, c.unsolicited_frames, c.unanswered_requests), (8, 0, 0));
    // From the request to its answer, which waits for the answers before it.
    let latencies = rig.bridge.line.settled().latencies().answer.counts;
    assert_eq!((latencies[8], latencies[9], latencies.iter().sum()), (1, 1, 8));
}

#[test]
fn pipelined_requests_are_cut_at_frame_for_others() {
    let mut rig = Rig::new(Config::default());
    for _ in 0..8 {
        rig.usb_out.extend(temperatures());
    }
    rig.can_out.push_back(info());
    rig.can_out.push_back(velocities());
    rig.run(100_000);
    let order = kinds(&rig.line());
    let place = |kind| order.iter().position(|&k| k == kind).unwrap();
    // The bus brings a request after the first packet has gone, and the two alternate from then on.
    assert_eq!(order.len(), 10);
    assert!(place((0x06, 2)) - place((0x01, 0)) <= 2 || place((0x06, 2)) == 9);
    assert_eq!((kinds(&rig.usb).len(), rig.can.len()), (8, 2));
    assert_eq!(rig.bridge.counters().unanswered_requests, 0);
}

#[test]
fn others_wait_while_untracked_requests_are_pipelined() {
    let mut rig = Rig::new(Config::default());
    // The first burst has ten requests.
    for _ in 0..20 {
        rig.usb_out.extend(JOINTS);
    }
    rig.can_out.push_back(info());
    rig.run(15_000);
    // The host on USB does not continue either.
    assert_eq!((kinds(&rig.usb).len(), rig.can.len()), (10, 0));
    rig.run(100_000);
    assert_eq!((kinds(&rig.usb).len(), rig.can.len()), (20, 1));
    let c = rig.bridge.counters();
    assert_eq!((c.requests_usb, c.untracked_requests, c.frames), (20, 2, 21));
    assert_eq!((c.unsolicited_frames, c.unanswered_requests), (2, 0));
    // Alone on the line again, it may pipeline more requests, and unanswered ones are counted.
    rig.run(1_000_000);
    rig.responder = Box::new(|_| None);
    rig.usb_out.extend(JOINTS.repeat(10));
    rig.run(100_000);
    let c = rig.bridge.counters();
    assert_eq!((c.unanswered_requests, c.untracked_requests), (8, 4));
}

#[test]
fn same_request_alternates_with_polls_of_silent_arm() {
    let mut rig = polling(Poll::Hertz(100));
    rig.responder = Box::new(|_| None);
    for _ in 0..300 {
        if rig.can_out.is_empty() && rig.bridge.line.settled().waiting().0 == 0 {
            rig.can_out.push_back(JOINTS.to_vec());
        }
        rig.run(10_000);
    }
    // Neither may send while a late answer is possible. Both wait until then.
    let turns = |initiator| rig.initiators.iter().filter(|of| **of == initiator).count();
    let (can, polls) = (turns(Initiator::Can), turns(Initiator::Poll));
    assert!(can > 10 && can.abs_diff(polls) <= 1, "{can} of CAN, {polls} polls");
}

#[test]
fn initiators_wait_at_most_one_turn_each() {
    // All initiators have requests all the time.
    for poll in [Poll::Fastest, Poll::Hertz(1_000)] {
        let mut rig = polling(poll);
        let mut requests = 0;
        for _ in 0..2_000 {
            if rig.usb_out.len() < 100 {
                rig.usb_out.extend(temperatures());
            }
            if rig.can_out.is_empty() && rig.bridge.line.settled().waiting().0 == 0 {
                rig.can_out.push_back(velocities());
                requests += 1;
            }
            rig.run(200);
        }
        assert!(requests > 100);
        for initiator in [Initiator::Usb, Initiator::Can, Initiator::Poll] {
            let turns = rig.initiators.iter().enumerate().filter(|(_, of)| **of == initiator);
            let turns: Vec<_> = turns.map(|(n, _)| n).skip(3).collect();
            assert!(turns.len() > 100);
            assert!(
                turns.windows(2).all(|pair| pair[1] - pair[0] <= 5),
                "{initiator}: {turns:?}"
            );
        }
        assert_eq!(rig.bridge.counters().unanswered_requests, 0);
    }
}

#[test]
fn fastest_poll_takes_turns_like_others() {
    let mut rig = polling(Poll::Fastest);
    for _ in 0..500 {
        if rig.usb_out.len() < 100 {
            rig.usb_out.extend(temperatures());
        }
        if rig.can_out.is_empty() {
            rig.can_out.push_back(velocities());
        }
        rig.run(200);
    }
    // The first request from CAN comes later.
    let turns = &rig.initiators[6..];
    assert!(turns.len() > 100);
    for round in turns.windows(3) {
        for initiator in [Initiator::Usb, Initiator::Can, Initiator::Poll] {
            assert!(round.contains(&initiator), "{round:?}");
        }
    }
}

#[test]
fn partial_frame_keeps_line_for_10_ms() {
    let mut rig = Rig::new(Config::default());
    rig.usb_out.extend(&JOINTS[..3]);
    rig.run(100);
    rig.can_out.push_back(info());
    rig.run(5_000);
    assert_eq!(rig.line(), JOINTS[..3]);
    // The rest arrives in time and goes first.
    rig.usb_out.extend(&JOINTS[3..]);
    rig.run(5_000);
    assert_eq!(rig.line(), [&JOINTS[..], &info()].concat());

    let mut rig = Rig::new(Config::default());
    rig.usb_out.extend(&JOINTS[..3]);
    rig.run(100);
    rig.can_out.push_back(info());
    rig.run(20_000);
    // An arm that waits for the rest would read the next bytes as that rest: zeros end it.
    let sent = rig.sent[1..].iter().map(|(_, bytes)| bytes.clone());
    assert!(sent.eq([void(), vec![info()]].concat()));
    assert_eq!((rig.sent[1].0, rig.sent[5].0), (10_000, 12_610));
    assert_eq!(rig.can.len(), 1);
}

#[test]
fn zeros_of_the_adapter_follow_each_other() {
    // A request and a poll become ready among the zeros.
    let mut rig = Rig::new(Config::default());
    rig.usb_out.extend(&JOINTS[..3]);
    rig.run(100);
    rig.can_out.push_back(info());
    rig.run(10_500);
    rig.usb_out.extend(JOINTS);
    rig.can_out.push_back(info());
    rig.run(20_000);
    let sent = rig.sent[1..5].iter().map(|(_, bytes)| bytes.clone());
    assert!(sent.eq(void()));
    assert_eq!(rig.bridge.counters().requests_adapter, 4);
    assert_eq!(rig.sent.len(), 5 + 3);
}

#[test]
fn void_of_usb_host_ends_its_turn() {
    for begun in [&JOINTS[..2], &[0xAA, 0x06, 0x03, 0x40, 0xAA], b"raw"] {
        for (zeros, waits) in [(LONGEST_VOID - 1, true), (LONGEST_VOID, false)] {
            let mut rig = Rig::new(Config::default());
            rig.usb_out.extend(begun);
            rig.run(100);
            rig.can_out.push_back(info());
            rig.usb_out.extend(vec![0; zeros]);
            rig.run(50_000);
            let of_usb = rig
                .initiators
                .iter()
                .filter(|initiator| **initiator == Initiator::Usb)
                .count();
            let sent = begun.len() + zeros;
            let line = rig.sent[..of_usb].iter().map(|(_, bytes)| bytes.len()).sum::<usize>();
            assert_eq!(line, sent, "the void keeps its turn");
            // The request follows directly, without zeros of the adapter.
            assert_eq!(rig.sent.len(), of_usb + 1);
            let (at, request) = &rig.sent[of_usb];
            assert_eq!(
                (request, *at > sent as u64 * 10 + 2_000),
                (&info(), waits),
                "{begun:?} {zeros}"
            );
            assert_eq!(rig.bridge.counters().voids_usb, u32::from(!waits));
        }
    }
}

#[test]
fn raw_bytes_keep_line_until_quiet_or_100ms() {
    let mut rig = Rig::new(Config::default());
    rig.usb_out.extend(b"hello");
    rig.run(100);
    rig.can_out.push_back(info());
    rig.run(1_000);
    // The arm answers: the 5 ms count from its last byte, which is in at 1200 µs.
    rig.arm_sends(&[1; 10]);
    rig.run(20_000);
    assert_eq!(rig.sent[1], (1_200 + 5_000, info()));

    // A host that never pauses: its turn ends 100 ms after the other began to wait.
    let mut rig = Rig::new(Config::default());
    let mut began = None;
    for n in 0..200_u64 {
        rig.usb_out.extend([0x55; 30]);
        if n == 10 {
            rig.can_out.push_back(info());
        }
        rig.run(1_000);
        if began.is_none() && rig.bridge.line.settled().waiting().0 > 0 {
            began = Some(rig.now);
        }
    }
    let (at, _) = rig.sent.iter().find(|(_, bytes)| *bytes == info()).unwrap();
    assert!((at - began.unwrap()).abs_diff(100_000) <= 1_000, "{at}");
    // No byte was lost.
    rig.run(100_000);
    assert_eq!(rig.line().len(), 200 * 30 + info().len());
}

#[test]
fn two_senders_of_raw_bytes_take_turns() {
    let mut rig = Rig::new(Config {
        arm: ArmKind::Raw,
        ..Config::default()
    });
    rig.usb_out.extend([b'u'; 600]);
    for _ in 0..3 {
        rig.can_out.push_back(vec![b'c'; 20]);
    }
    rig.run(400_000);
    let line = rig.line();
    assert_eq!(line.iter().filter(|&&byte| byte == b'u').count(), 600);
    // The bytes of one PDU stay together.
    let text = std::string::String::from_utf8(line).unwrap();
    let pdus: Vec<_> = text.split('u').filter(|run| !run.is_empty()).collect();
    assert_eq!(pdus.iter().map(|run| run.len()).sum::<usize>(), 60);
    assert!(pdus.iter().all(|run| run.len() % 20 == 0));
    assert_eq!(rig.bridge.counters().noise_bytes, 0);
    rig.arm_sends(b"raw answer");
    rig.run(1_000);
    assert_eq!(rig.usb, b"raw answer");
}

#[test]
fn pdu_other_than_arm_frame_is_refused() {
    let mut rig = Rig::new(Config::default());
    rig.subscribe();
    let twice = [JOINTS, JOINTS].concat();
    let mut broken = JOINTS;
    broken[5] ^= 1;
    for pdu in [&JOINTS[..6], &twice, &broken, b"x"] {
        rig.can_out.push_back(pdu.to_vec());
    }
    rig.run(20_000);
    assert_eq!(rig.line(), []);
    assert_eq!(rig.bridge.counters().refused_can_frames, 4);
    let refused = Event::Refused {
        initiator: Initiator::Can,
        reason: Refusal::NotAFrame,
    };
    assert_eq!(rig.events.iter().filter(|(_, event)| *event == refused).count(), 4);
    let refusals: Vec<_> = rig
        .frames
        .iter()
        .filter_map(|(_, frame)| crate::can::telemetry::event_from_frame(frame))
        .collect();
    assert_eq!(refusals.len(), 4);
    assert!(refusals.iter().all(|(_, event)| *event == refused));
}

#[test]
fn can_queue_overflow_is_refused_and_counted() {
    let mut rig = Rig::new(Config::default());
    rig.subscribe();
    // A silent arm: one request in flight, two pending, one in the connection, and no more.
    rig.responder = Box::new(|_| None);
    let request = ling(0x05, 0, &[1]);
    rig.can_out.push_back(JOINTS.to_vec());
    rig.run(1_000);
    for _ in 0..5 {
        rig.can_out.push_back(request.clone());
    }
    rig.run(10_000);
    assert_eq!(rig.bridge.counters().refused_can_requests, 2);
    let full = Event::Refused {
        initiator: Initiator::Can,
        reason: Refusal::QueueFull,
    };
    assert_eq!(rig.events.iter().filter(|(_, event)| *event == full).count(), 2);
    rig.run(100_000);
    assert_eq!(kinds(&rig.line()), [(0x06, 0), (0x05, 0), (0x05, 0), (0x05, 0)]);
    assert_eq!(rig.bridge.counters().requests_can, 4);
}

#[test]
fn bytes_waiting_for_timely_answer_are_no_fault() {
    let mut rig = Rig::new(Config::default());
    let mut ling_responder = ling_responder();
    rig.responder = Box::new(move |request| {
        let (_, answer) = ling_responder(request)?;
        let takes = if request == armwire::ling::SELF_CHECK {
            490_000
        } else {
            200
        };
        Some((takes, answer))
    });
    rig.usb_out.extend(armwire::ling::SELF_CHECK.repeat(4));
    rig.run(1_000);
    // Another initiator waits: the next bytes of the host on USB wait too.
    rig.can_out.push_back(JOINTS.to_vec());
    rig.run(1_000);
    rig.usb_out.extend(JOINTS);
    for _ in 0..19 {
        rig.run(100_000);
        assert!(!rig.bridge.is_stuck(at(rig.now)), "{}", rig.now);
        assert_eq!(rig.bridge.counters().requests_usb, 4);
    }
    rig.run(1_000_000);
    assert_eq!(rig.bridge.counters().requests_usb, 5);
    assert_eq!(rig.bridge.counters().unanswered_requests, 0);
}

#[test]
fn missing_answer_frees_line_but_blocks_its_kind() {
    let mut rig = Rig::new(Config::default());
    let mut ling_responder = ling_responder();
    let mut first = true;
    // The first answer comes after 80 ms.
    rig.responder = Box::new(move |request| {
        let (after, answer) = ling_responder(request)?;
        Some((if core::mem::take(&mut first) { 80_000 } else { after }, answer))
    });
    rig.can_out.push_back(JOINTS.to_vec());
    rig.run(1_000);
    rig.can_out.push_back(JOINTS.to_vec());
    rig.run(60_000);
    assert_eq!(rig.bridge.counters().unanswered_requests, 1);
    assert_eq!(rig.sent.len(), 1, "the same kind waits");
    rig.run(100_000);
    let c = rig.bridge.counters();
    assert_eq!((c.late_answers, c.unsolicited_frames, c.unanswered_requests), (1, 0, 1));
    // The late answer went to the host on USB as an unsolicited frame. The second request got its own.
    assert_eq!(rig.usb[4], 1);
    assert_eq!(rig.can.iter().map(|pdu| pdu[4]).collect::<Vec<_>>(), [2]);
    assert_eq!(rig.bridge.line.settled().open_initiator(), None);
}

#[test]
fn others_proceed_while_same_kind_waits() {
    let mut rig = polling(Poll::Hertz(100));
    let mut ling_responder = ling_responder();
    // The arm does not support joint requests.
    rig.responder = Box::new(move |request| ling_responder(request).filter(|_| request[1..3] != [6, 0]));
    rig.run(65_000);
    rig.can_out.push_back(info());
    rig.run(5_000);
    assert_eq!(rig.can.len(), 1);
    rig.run(1_000_000);
    let c = rig.bridge.counters();
    // Each takes 50 ms to time out, and as long until the next may go out.
    assert!((9..=11).contains(&c.requests_poll), "{}", c.requests_poll);
    assert!(c.unanswered_requests.abs_diff(c.requests_poll) <= 1);
    assert!(c.missed_polls > 50);
}

#[test]
fn other_arm_kind_is_shared_by_its_frames() {
    // UBTECH Alpha1: the robot reports its servo states; a servo acknowledges with one byte.
    let states = [0xEF, 0xFE, 0, 0, 0, 0, 0, 0, 0, 0xED];
    let move_one = [0xFA, 0xAF, 0x01, 0x01, 0x5A, 0x32, 0x00, 0x32, 0xC0, 0xED];
    for (arm, half_duplex) in [(ArmKind::Alpha1, false), (ArmKind::Alpha1Servo, true)] {
        let mut rig = Rig::new(Config {
            arm,
            ..Config::default()
        });
        rig.run(1_000);
        assert_eq!((rig.uart.coding.baud, rig.uart.half_duplex), (115_200, half_duplex));
        rig.responder = Box::new(|request| match request[0] {
            0xEF => Some((100, vec![0xEF, 0xFE, 1, 2, 3, 4, 10, 0xED])),
            _ => Some((100, vec![request[2] + 0xAA])),
        });
        rig.can_out.push_back(move_one.to_vec());
        rig.usb_out.extend(states);
        rig.run(50_000);
        assert_eq!(rig.can, [[0xAB]], "{:?} {:?}", rig.sent, rig.bridge.counters());
        assert_eq!(rig.usb, [0xEF, 0xFE, 1, 2, 3, 4, 10, 0xED]);
        let c = rig.bridge.counters();
        assert_eq!((c.unanswered_requests, c.unsolicited_frames, c.frames), (0, 0, 2));
    }
}

#[test]
fn line_coding_waits_for_answer_to_other_initiator() {
    let mut rig = Rig::new(Config::default());
    rig.can_out.push_back(JOINTS.to_vec());
    rig.run(250);
    let coding = [0x00, 0xC2, 0x01, 0x00, 0, 0, 8];
    rig.bridge.set_line_coding(coding, at(rig.now)).unwrap();
    rig.bridge.usb_received(&[1], at(rig.now));
    assert_eq!(
        (
            rig.bridge.line.settled().uart_change(),
            rig.bridge.update(at(rig.now)).uart
        ),
        (None, false)
    );
    rig.run(10_000);
    assert_eq!((rig.can.len(), rig.uart.coding.baud), (1, 115_200));
}

/// A host's bytes for the arm on USB.
fn host_bytes() -> impl Strategy<Value = Vec<u8>> {
    prop_oneof![
        Just(JOINTS.to_vec()),
        Just(temperatures()),
        Just(info()[..4].to_vec()),
        Just(ling(0x05, 0, &[1])),
        Just(ling(0x77, 3, &[1, 2])),
        prop::collection::vec(prop_oneof![Just(0xAA), any::<u8>()], 0..100),
    ]
}

#[derive(Clone, Debug)]
enum Step {
    Usb(Vec<u8>),
    Can(Vec<u8>),
    Arm(Vec<u8>),
    Run(u64),
}

fn step() -> impl Strategy<Value = Step> {
    prop_oneof![
        host_bytes().prop_map(Step::Usb),
        prop_oneof![
            Just(velocities()),
            Just(JOINTS.to_vec()),
            Just(ling(0x05, 0, &[0])),
            Just(vec![1, 2])
        ]
        .prop_map(Step::Can),
        prop_oneof![Just(ling(0x0A, 1, &[7; 9])), prop::collection::vec(any::<u8>(), 0..40)].prop_map(Step::Arm),
        (0..30_000_u64).prop_map(Step::Run),
        (0..300_u64).prop_map(Step::Run),
    ]
}

#[test]
fn both_late_answers_of_a_kind_are_late() {
    let mut rig = polling(Poll::Off);
    let (mut ling_responder, mut n) = (ling_responder(), 0);
    rig.responder = Box::new(move |request| {
        let (after, answer) = ling_responder(request)?;
        n += 1;
        Some(([80_000, 5_000].get(n - 1).copied().unwrap_or(after), answer))
    });
    rig.usb_out.extend(JOINTS.repeat(2));
    rig.run(60_000);
    rig.can_out.push_back(JOINTS.to_vec());
    rig.run(200_000);
    let c = rig.bridge.counters();
    assert_eq!((c.late_answers, c.unsolicited_frames), (2, 0));
    assert_eq!(rig.can.iter().map(|pdu| pdu[4]).collect::<Vec<_>>(), [3]);
}

#[test]
fn late_answer_goes_to_no_other_host() {
    // The host on USB repeats its request before the first answer, and another initiator sends the same: at 61 ms, or
    // when the first answer is in.
    for can_at in [61_000, 95_000] {
        let mut rig = polling(Poll::Off);
        let (mut ling_responder, mut n) = (ling_responder(), 0);
        // Each answer is 90 ms late, the second by its own request.
        rig.responder = Box::new(move |request| {
            n += 1;
            ling_responder(request).map(|(_, answer)| (if n == 2 { 59_000 } else { 90_000 }, answer))
        });
        rig.run(1_000);
        rig.usb_out.extend(JOINTS);
        rig.run(59_000);
        rig.usb_out.extend(JOINTS);
        rig.run(can_at - 60_000);
        rig.can_out.push_back(JOINTS.to_vec());
        rig.run(500_000);
        assert_eq!(rig.bridge.counters().late_answers, 3);
        assert_eq!(rig.usb.chunks(21).map(|frame| frame[4]).collect::<Vec<_>>(), [1, 2, 3]);
        assert_eq!(rig.can, Vec::<Vec<u8>>::new());
    }
}

#[test]
fn no_missing_answer_is_forgotten_for_another() {
    let mut rig = polling(Poll::Off);
    rig.responder = Box::new(|_| None);
    // Seven keys, and 20 requests with the last.
    for function in 0..6 {
        rig.usb_out.extend(ling(0x77, function, &[]));
    }
    rig.usb_out.extend(JOINTS.repeat(20));
    rig.run(60_000);
    let c = rig.bridge.counters();
    assert_eq!((c.unanswered_requests, c.untracked_requests), (8, 18));
    rig.can_out.push_back(ling(0x77, 0, &[]));
    rig.run(1_000);
    assert_eq!(rig.bridge.counters().requests_can, 0);
    // A late answer: it does not belong to the request of the host on CAN.
    rig.arm_sends(&ling(0x77, 0, &[1]));
    rig.run(5_000);
    let c = rig.bridge.counters();
    assert_eq!((c.late_answers, rig.can.len(), c.requests_can), (1, 0, 0));
    rig.run(100_000);
    assert_eq!(rig.bridge.counters().requests_can, 1);
}

#[test]
fn usb_waits_for_late_answers_of_same_kind() {
    let mut rig = polling(Poll::Off);
    let (mut ling_responder, mut n) = (ling_responder(), 0);
    rig.responder = Box::new(move |request| {
        n += 1;
        ling_responder(request).map(|(after, answer)| (if n == 1 { 70_000 } else { after }, answer))
    });
    rig.can_out.push_back(JOINTS.to_vec());
    rig.run(60_000);
    rig.usb_out.extend(JOINTS);
    rig.usb_out.extend(temperatures());
    rig.run(100_000);
    let requests = [&JOINTS.repeat(2)[..], &temperatures()].concat();
    assert_eq!(rig.line(), requests);
    // The second request with this key went out after the first answer.
    assert!(rig.sent[1].0 > 70_000 && rig.sent[1].0 < 72_000, "{:?}", rig.sent);
    assert_eq!(rig.bridge.counters().late_answers, 1);
}

#[test]
fn frame_started_during_request_is_no_answer() {
    for (ahead, answers) in [(1, true), (3, false), (8, false)] {
        let mut rig = polling(Poll::Off);
        rig.subscribe();
        rig.responder = Box::new(|_| None);
        rig.usb_out.extend(JOINTS);
        // It is out after 70 µs.
        rig.run(70 - 10 * (ahead - 1));
        rig.arm_sends(&ling(0x06, 0, &[99; 15]));
        rig.run(1_000);
        let initiator = answers.then_some(Initiator::Usb);
        let is_answer =
            |(_, event): &(_, Event)| matches!(event, Event::Frame { initiator: of, .. } if *of == initiator);
        assert!(
            rig.events.iter().any(is_answer),
            "{ahead} bytes ahead: {:?}",
            rig.events
        );
    }
}

#[test]
fn request_from_old_bus_is_answered_or_refused() {
    let mut rig = polling(Poll::Off);
    let mut ling_responder = ling_responder();
    rig.responder = Box::new(move |request| ling_responder(request).map(|(_, answer)| (20_000, answer)));
    rig.can_out.extend([JOINTS.to_vec(), info(), temperatures()]);
    rig.run(5_000);
    let mut other = Config::default();
    other.can.node = Node::new(5).unwrap();
    assert_eq!(rig.call(Request::SetConfig(other)), Reply::Done);
    assert_eq!(rig.actions, []);
    rig.run(100_000);
    assert_eq!(rig.actions, [Action::RestartCan(other.can)]);
    let c = rig.bridge.counters();
    assert_eq!((c.requests_can, c.refused_can_requests, c.isotp_failures), (1, 2, 1));
    assert_eq!(rig.line(), JOINTS);
    assert_eq!((c.dropped_can_answers, rig.can.len(), rig.frames.len()), (0, 0, 0));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, ..ProptestConfig::default() })]

    #[test]
    fn no_byte_is_lost_and_requests_end_once(
        steps in prop::collection::vec(step(), 1..60),
        poll in prop_oneof![Just(Poll::Off), Just(Poll::Hertz(300)), Just(Poll::Fastest)],
        seed in any::<u8>(),
    ) {
        let mut rig = polling(poll);
        let mut ling_responder = ling_responder();
        let mut n = 0_u8;
        // Some answers are missing, some are late.
        rig.responder = Box::new(move |request| {
            n = n.wrapping_mul(5).wrapping_add(seed | 1);
            let (after, answer) = ling_responder(request)?;
            match n % 16 {
                0 => None,
                1 => Some((70_000, answer)),
                _ => Some((after, answer)),
            }
        });
        let (mut from_usb, mut from_can) = (vec![], 0);
        let received = |rig: &mut Rig| rig.bridge.counters().arm_to_host_bytes as usize;
        for step in steps {
            match step {
                Step::Usb(bytes) => {
                    rig.usb_out.extend(&bytes);
                    from_usb.extend(bytes);
                }
                Step::Can(pdu) => {
                    rig.can_out.push_back(pdu);
                    from_can += 1;
                }
                Step::Arm(bytes) => rig.arm_sends(&bytes),
                Step::Run(micros) => rig.run(micros),
            }
        }
        // All traffic ends.
        let off = Config { poll: Poll::Off, ..Config::default() };
        rig.run(5_000_000);
        rig.call(crate::control::Request::SetConfig(off));
        rig.run(1_000_000);

        // To the arm: requests of others are whole frames; without them the host's bytes are unchanged.
        let c = rig.bridge.counters();
        let line = rig.line();
        prop_assert_eq!(c.host_to_arm_bytes as usize, line.len());
        prop_assert_eq!(c.requests_can + c.refused_can_frames + c.refused_can_requests, from_can);
        let bursts = || rig.initiators.iter().zip(&rig.sent);
        let of_usb = bursts().filter(|(initiator, _)| **initiator == Initiator::Usb);
        let of_usb: Vec<u8> = of_usb.flat_map(|(_, (_, bytes))| bytes.clone()).collect();
        prop_assert_eq!(of_usb, from_usb);
        for (initiator, (_, bytes)) in bursts() {
            let ends_half_a_frame = *initiator == Initiator::Adapter && bytes.iter().all(|byte| *byte == 0);
            prop_assert!(*initiator == Initiator::Usb || ends_half_a_frame || kinds(bytes).len() == 1);
        }
        prop_assert_eq!(rig.initiators.iter().filter(|initiator| **initiator == Initiator::Can).count() as u32, c.requests_can);
        prop_assert_eq!(rig.initiators.iter().filter(|initiator| **initiator == Initiator::Poll).count() as u32, c.requests_poll);

        // To the host: answers of others are not on USB, and all other frames are.
        let on_can: usize = rig.can.iter().map(Vec::len).sum();
        let answered = c.requests_poll as usize;
        prop_assert_eq!(c.dropped_can_answers + c.dropped_bytes + c.undelivered_bytes, 0);
        let missing = received(&mut rig) - rig.usb.len() - on_can;
        prop_assert!(missing.is_multiple_of(21) && missing / 21 <= answered, "{} bytes of {} polls", missing, answered);
        if poll == Poll::Off {
            prop_assert_eq!(missing, 0);
        }

        // No answer is pending.
        prop_assert_eq!(rig.bridge.line.settled().open_initiator(), None);
        prop_assert_eq!(rig.bridge.line.settled().waiting(), (0, 0));
        prop_assert!(rig.usb_out.is_empty());
    }
}

#[test]
fn bytes_kept_for_missing_answer_are_not_stuck() {
    let mut rig = Rig::new(Config {
        arm: ArmKind::Alpha1,
        ..Config::default()
    });
    rig.responder = Box::new(|_| None);
    // The robot may take a second for it.
    let mut slow = [0; alpha1::MAX_FRAME];
    let len = Alpha1
        .encode_request(&alpha1::Request::SetUsbType(alpha1::UsbType::Disk), &mut slow)
        .unwrap();
    rig.can_out.push_back(slow[..len].to_vec());
    while rig.sent.is_empty() {
        rig.run(1);
    }
    rig.bridge.usb_received(&[1; 10], at(rig.now));
    let mut now = at(rig.now);
    while !rig.bridge.update(now).uart {
        now = rig.bridge.timeout().unwrap();
        rig.bridge.uart_received(&[], now);
        rig.bridge.tick(now);
    }
    assert!(now > at(rig.now + 1_000_000));
    assert!(!rig.bridge.is_stuck(now));
    assert!(rig.bridge.is_stuck(now + Duration::from_micros(1_000_001)));
}

#[test]
fn answer_behind_slow_one_reaches_its_initiator() {
    let mut rig = Rig::new(Config::default());
    let mut ling_responder = ling_responder();
    rig.responder = Box::new(move |request| match request[1] {
        0xFE => Some((300_000, ling(0xFE, 0, &[1, 1]))),
        _ => ling_responder(request),
    });
    // A self-check, which the arm may answer for 0.5 s, and a read after it.
    rig.usb_out.extend(ling(0xFE, 0, &[0xFE]));
    rig.usb_out.extend(JOINTS);
    rig.run(150_000);
    rig.can_out.push_back(JOINTS.to_vec());
    rig.run(1_000_000);
    let c = rig.bridge.counters();
    assert_eq!((c.unanswered_requests, c.late_answers, c.unsolicited_frames), (0, 0, 0));
    // The answers with joints count: the first is USB's, the second CAN's.
    assert_eq!(rig.can.iter().map(|answer| answer[4]).collect::<Vec<_>>(), [2]);
}
