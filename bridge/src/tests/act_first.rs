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

/// A call of the adapter.
#[derive(Clone, Debug)]
enum Step {
    /// The arm sends an answer, or its first bytes.
    Receive(usize),
    /// The arm sends a frame that nobody asked for.
    Unsolicited,
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

/// The answer to [`READ_JOINTS`].
fn answer() -> Vec<u8> {
    ling(0x06, 0, &[0; 15])
}

fn steps() -> impl Strategy<Value = Vec<Step>> {
    let step = prop_oneof![
        2 => (1..answer().len()).prop_map(Step::Receive),
        16 => Just(Step::Receive(answer().len())),
        2 => Just(Step::Unsolicited),
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
        Step::Receive(len) => (bridge.uart_received(&answer()[..*len], now), vec![], None),
        Step::Unsolicited => (bridge.uart_received(&ling(0x77, 1, &[0; 3]), now), vec![], None),
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
            let transmit = bridge.uart_transmit(&mut out, now);
            match transmit {
                Some(Transmit::Burst { len, .. }) => {
                    bridge.uart_transmitted(now);
                    (len, out[..len].to_vec(), transmit)
                }
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

#[test]
fn next_poll_may_start_with_answer() {
    let mut bridge = adapter(Poll::Fastest);
    let mut out = [0; MAX_FRAME];
    bridge.tick(at(1_000));
    let poll = at_once_burst(READ_JOINTS.len());
    assert_eq!(bridge.uart_transmit(&mut out, at(1_000)), Some(poll));
    bridge.uart_transmitted(at(1_000));
    assert_eq!(bridge.uart_ahead(), None);

    bridge.uart_received(&answer(), at(2_000));
    assert_eq!(bridge.uart_ahead(), Some(&READ_JOINTS[..]));
    assert_eq!(bridge.uart_transmit(&mut out, at(2_001)), Some(poll));
    bridge.uart_transmitted(at(2_001));

    // A request of the host on USB may go first.
    bridge.usb_received(&READ_JOINTS, at(2_500));
    bridge.uart_received(&answer(), at(3_000));
    assert_eq!(bridge.uart_ahead(), None);
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
            if let Some(poll) = later.uart_ahead() {
                let expected = (poll.len(), poll.to_vec(), Some(at_once_burst(poll.len())));
                prop_assert_eq!(&call(&mut later, &Step::Transmit, now), &expected);
                prop_assert_eq!(call(&mut at_once, &Step::Transmit, now), expected);
            }
        }
        prop_assert_eq!(later.counters(), at_once.counters());
        prop_assert_eq!(later.line.settled().latencies(), at_once.line.settled().latencies());
        prop_assert_eq!(later.timeout(), at_once.timeout());
        prop_assert_eq!(later.update(at(now)), at_once.update(at(now)));
    }
}
