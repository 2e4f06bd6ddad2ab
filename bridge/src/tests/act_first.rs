//! Act first, account later: the order has no effect on what the adapter does.

extern crate std;

use std::vec;
use std::vec::Vec;

use armwire::ling::{READ_INFO, READ_JOINTS};
use proptest::prelude::*;

use super::rig::{at, ling, motion, send_request};
use crate::can::{Frame, Function, Node};
use crate::config::{Can, Config, Poll};
use crate::control::{Identity, MAX_FRAME, Request};
use crate::{Bridge, PACKET, Start, Transmit, UartEvent, UsbEvent};

/// Status bytes of an arm with and without torque.
const LOCKED: u8 = 1;
const UNLOCKED: u8 = 0;

/// A position that no joint has.
const OUT_OF_RANGE: u16 = 5_000;

/// A call of the adapter.
#[derive(Clone, Debug)]
enum Step {
    /// The arm sends answers, their first bytes, or frames that nobody asked for.
    Receive(Vec<u8>),
    Idle,
    /// The host on USB sends requests.
    Request {
        motion: bool,
    },
    PartOfRequest,
    /// A host on CAN sends a request.
    CanRequest,
    Stop,
    LineCoding(u32),
    Packet,
    Transmit,
    Tick,
    Wait(u64),
}

/// The answer to [`READ_JOINTS`] of an arm with its joints at this position and this status.
fn answer(position: u16, status: u8) -> Vec<u8> {
    let data = [position; 7].into_iter().flat_map(u16::to_le_bytes);
    ling(0x06, 0, &data.chain([status]).collect::<Vec<_>>())
}

/// An answer of an arm whose torque is on.
fn at_rest() -> Vec<u8> {
    answer(500, LOCKED)
}

/// The answers of an arm that moves, rests, has no torque, or is out of range.
fn answers() -> impl Strategy<Value = Vec<u8>> {
    prop_oneof![
        4 => Just(at_rest()),
        2 => (490..510_u16).prop_map(|position| answer(position, LOCKED)),
        1 => Just(answer(500, UNLOCKED)),
        2 => Just(answer(OUT_OF_RANGE, LOCKED)),
    ]
}

fn steps() -> impl Strategy<Value = Vec<Step>> {
    let first_bytes = (answers(), 1..at_rest().len()).prop_map(|(answer, len)| answer[..len].to_vec());
    let frame = prop_oneof![4 => answers(), 1 => Just(ling(0x77, 1, &[0; 3])), 1 => first_bytes];
    let frames = prop::collection::vec(frame, 1..4).prop_map(|frames| frames.concat());
    let step = prop_oneof![
        16 => answers().prop_map(Step::Receive),
        6 => frames.prop_map(Step::Receive),
        2 => Just(Step::Idle),
        4 => any::<bool>().prop_map(|motion| Step::Request { motion }),
        1 => Just(Step::PartOfRequest),
        2 => Just(Step::CanRequest),
        1 => Just(Step::Stop),
        1 => prop_oneof![Just(115_200), Just(1_000_000)].prop_map(Step::LineCoding),
        8 => Just(Step::Packet),
        16 => Just(Step::Transmit),
        2 => Just(Step::Tick),
        4 => (0..2_000_u64).prop_map(Step::Wait),
        1 => Just(Step::Wait(60_000)),
    ];
    prop::collection::vec(step, 0..200)
}

/// An adapter with an open port, telemetry on CAN, and a poll at this rate.
fn adapter(poll: Poll) -> Bridge {
    let can = Can {
        telemetry_hz: 50,
        ..Can::default()
    };
    let config = Config {
        poll,
        can,
        ..Config::default()
    };
    let mut bridge = Bridge::new(Identity::default(), config, Start::default());
    bridge.usb_event(UsbEvent::Configured(true), at(0));
    bridge.usb_event(UsbEvent::Dtr(true), at(0));
    bridge
}

/// The results of a call.
fn call(bridge: &mut Bridge, step: &Step, now: u64) -> (usize, Vec<u8>, Option<Transmit>) {
    let now = at(now);
    match step {
        Step::Receive(bytes) => (bridge.uart_received(bytes, now), vec![], None),
        Step::Idle => (bridge.uart_event(UartEvent::Idle, now), vec![], None),
        Step::Request { motion: true } => (bridge.usb_received(&motion(), now).into(), vec![], None),
        Step::Request { motion: false } => (bridge.usb_received(&READ_JOINTS, now).into(), vec![], None),
        Step::PartOfRequest => (bridge.usb_received(&READ_JOINTS[..3], now).into(), vec![], None),
        Step::CanRequest => {
            // The PDU fits into one frame.
            let id = Function::ArmRequest.id(Node::default());
            let data = [&[READ_INFO.len() as u8][..], &READ_INFO].concat();
            bridge.can_received(&Frame::new(id, &data).unwrap(), now);
            (0, vec![], None)
        }
        Step::Stop => {
            send_request(bridge, 1, Request::Stop, now);
            (0, vec![], None)
        }
        Step::LineCoding(baud) => {
            let [a, b, c, d] = baud.to_le_bytes();
            let coding = bridge.set_line_coding([a, b, c, d, 0, 0, 8], now);
            (coding.is_ok().into(), vec![], None)
        }
        Step::Packet => {
            let mut packet = [0; PACKET];
            let len = bridge.usb_transmit(&mut packet);
            (len.map_or(0, |len| len + 1), packet[..len.unwrap_or(0)].to_vec(), None)
        }
        Step::Transmit => {
            let mut out = [0; MAX_FRAME];
            let transmit = bridge.uart_transmit(&mut out, now, |_, _| {});
            match transmit {
                Some(Transmit::Burst { len, .. }) => (len, out[..len].to_vec(), transmit),
                Some(Transmit::Configure(uart)) => (bridge.uart_event(UartEvent::Configured(uart), now), vec![], None),
                None => (0, vec![], None),
            }
        }
        Step::Tick => {
            bridge.tick(now);
            (0, vec![], None)
        }
        Step::Wait(_) => (0, vec![], None),
    }
}

/// A burst that starts at once.
const fn at_once_burst(len: usize) -> Transmit {
    Transmit::Burst { len, start: None }
}

/// Starts the poll that follows the last frame, and returns what is accounted for.
fn ahead(bridge: &mut Bridge, now: u64) -> Option<(usize, Vec<u8>, Option<Transmit>)> {
    let mut out = [0; MAX_FRAME];
    let mut sent: Option<&[u8]> = None;
    let is_sent = bridge.uart_transmit_ahead(&mut out, |poll| {
        sent = Some(poll);
        at(now)
    });
    assert_eq!(is_sent, sent.is_some());
    let poll = sent?;
    assert_eq!(out[..poll.len()], *poll);
    Some((poll.len(), poll.to_vec(), Some(at_once_burst(poll.len()))))
}

#[test]
fn next_poll_may_start_with_answer() {
    let mut bridge = adapter(Poll::Fastest);
    bridge.tick(at(1_000));
    let poll = (
        READ_JOINTS.len(),
        READ_JOINTS.to_vec(),
        Some(at_once_burst(READ_JOINTS.len())),
    );
    assert_eq!(call(&mut bridge, &Step::Transmit, 1_000), poll);
    assert_eq!(ahead(&mut bridge, 1_001), None);

    bridge.uart_received(&at_rest(), at(2_000));
    assert_eq!(ahead(&mut bridge, 2_001), Some(poll));

    // A request of the host on USB may go first.
    bridge.usb_received(&READ_JOINTS, at(2_500));
    bridge.uart_received(&at_rest(), at(3_000));
    assert_eq!(ahead(&mut bridge, 3_001), None);
}

#[test]
fn all_frames_of_a_read_end_with_it() {
    for poll in [Poll::Off, Poll::Fastest] {
        let mut bridge = adapter(poll);
        bridge.tick(at(1_000));
        call(&mut bridge, &Step::Transmit, 1_000);
        let unsolicited = ling(0x77, 1, &[0; 3]);
        let frames = [&unsolicited[..], &at_rest(), &unsolicited].concat();
        assert_eq!(bridge.uart_received(&frames, at(2_000)), 3);
        let for_usb = match poll {
            Poll::Fastest => 2 * unsolicited.len(),
            _ => frames.len(),
        };
        assert_eq!(bridge.usb_transmit(&mut [0; PACKET]), Some(for_usb));
        assert_eq!(bridge.counters().frames, 3);
    }
}

#[test]
fn unsolicited_frame_during_poll_is_due_at_once() {
    let mut bridge = adapter(Poll::Fastest);
    bridge.tick(at(1_000));
    call(&mut bridge, &Step::Transmit, 1_000);
    let frame = ling(0x77, 1, &[0; 3]);
    bridge.uart_received(&frame, at(2_000));
    assert_eq!(ahead(&mut bridge, 2_000), None);
    assert_eq!(bridge.usb_transmit(&mut [0; PACKET]), Some(frame.len()));
}

#[test]
fn hold_of_stop_goes_before_next_poll() {
    let mut bridge = adapter(Poll::Fastest);
    let mut out = [0; MAX_FRAME];
    let mut transmit = |bridge: &mut Bridge, now| match bridge.uart_transmit(&mut out, now, |_, _| {}) {
        Some(Transmit::Burst { len, .. }) => out[..len].to_vec(),
        other => panic!("{other:?}"),
    };
    bridge.tick(at(1_000));
    send_request(&mut bridge, 1, Request::Stop, at(1_000));
    // The first reading is no pose to hold. The next is a poll's.
    assert_eq!(transmit(&mut bridge, at(1_000)), READ_JOINTS);
    bridge.uart_received(&answer(OUT_OF_RANGE, LOCKED), at(5_000));
    assert_eq!(transmit(&mut bridge, at(5_000)), READ_JOINTS);
    assert_eq!(bridge.counters().requests_poll, 1);
    bridge.uart_received(&at_rest(), at(6_000));
    assert_eq!(ahead(&mut bridge, 6_000), None);
    assert_eq!(transmit(&mut bridge, at(6_000))[..2], [0xAA, 0x06]);
    assert_eq!(bridge.counters().requests_poll, 1);
}

proptest! {
    #[test]
    fn late_accounting_changes_nothing(
        steps in steps(),
        poll in prop_oneof![Just(Poll::Off), Just(Poll::Fastest), Just(Poll::Hertz(500))],
    ) {
        // One accounts for each frame at once, the other when it must.
        let [mut at_once, mut later] = [adapter(poll), adapter(poll)];
        let mut now = 1_000;
        for step in &steps {
            now += match step {
                Step::Wait(micros) => *micros,
                _ => 1,
            };
            let expected = call(&mut at_once, step, now);
            let _ = at_once.timeout();
            prop_assert_eq!(call(&mut later, step, now), expected);
            if let Some(poll) = ahead(&mut later, now) {
                prop_assert_eq!(call(&mut at_once, &Step::Transmit, now), poll);
            }
        }
        prop_assert_eq!(later.counters(), at_once.counters());
        prop_assert_eq!(later.line.settled().latencies(), at_once.line.settled().latencies());
        prop_assert_eq!(later.timeout(), at_once.timeout());
        prop_assert_eq!(later.update(at(now)), at_once.update(at(now)));
    }
}
