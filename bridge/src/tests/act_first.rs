//! Act first, account later: the order has no effect on what the adapter does.

extern crate std;

use std::vec;
use std::vec::Vec;

use armwire::ling::READ_JOINTS;
use proptest::prelude::*;

use super::rig::{at, ling, motion};
use crate::config::{Can, Config, Poll};
use crate::control::{Identity, MAX_FRAME};
use crate::{Bridge, PACKET, Start, Transmit, UartEvent, UsbEvent};

/// A call of the adapter.
#[derive(Clone, Debug)]
enum Step {
    /// The arm sends this many bytes.
    Receive(usize),
    Idle,
    /// The host on USB sends requests.
    Request {
        motion: bool,
    },
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
        8 => (1..=64_usize).prop_map(Step::Receive),
        8 => Just(Step::Receive(answer().len())),
        1 => Just(Step::Idle),
        4 => any::<bool>().prop_map(|motion| Step::Request { motion }),
        8 => Just(Step::Packet),
        8 => Just(Step::Transmit),
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
fn call(bridge: &mut Bridge, step: &Step, arm: &[u8], now: u64) -> (usize, Vec<u8>, Option<Transmit>) {
    let now = at(now);
    match step {
        Step::Receive(_) => (bridge.uart_received(arm, now), vec![], None),
        Step::Idle => (bridge.uart_event(UartEvent::Idle, now), vec![], None),
        Step::Request { motion: true } => (bridge.usb_received(&motion(), now).into(), vec![], None),
        Step::Request { motion: false } => (bridge.usb_received(&READ_JOINTS, now).into(), vec![], None),
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

proptest! {
    #[test]
    fn late_accounting_changes_nothing(
        steps in steps(),
        poll in prop_oneof![Just(Poll::Off), Just(Poll::Fastest), Just(Poll::Hertz(500))],
    ) {
        // One accounts for each frame at once, the other when it must.
        let [mut at_once, mut later] = [adapter(poll), adapter(poll)];
        let mut arm = answer().into_iter().cycle();
        let mut now = 1_000;
        for step in &steps {
            let bytes: Vec<u8> = match step {
                Step::Receive(len) => arm.by_ref().take(*len).collect(),
                Step::Wait(micros) => {
                    now += micros;
                    vec![]
                }
                _ => vec![],
            };
            let expected = call(&mut at_once, step, &bytes, now);
            let _ = at_once.timeout();
            prop_assert_eq!(call(&mut later, step, &bytes, now), expected);
        }
        prop_assert_eq!(later.counters(), at_once.counters());
        prop_assert_eq!(later.line.settled().latencies(), at_once.line.settled().latencies());
        prop_assert_eq!(later.timeout(), at_once.timeout());
        prop_assert_eq!(later.update(at(now)), at_once.update(at(now)));
    }
}
