//! The timing of the adapter's own poll.

extern crate std;

use std::boxed::Box;
use std::vec::Vec;

use super::rig::{Rig, at, ling, ling_responder, transmit};
use crate::config::{Config, Poll};
use crate::control::{Identity, Initiator, MAX_FRAME, Reply, Request};
use crate::{Bridge, Duration, Instant, POLL_LEAD_TIME, Start, UsbEvent};

fn polling(poll: Poll) -> Rig {
    Rig::new(Config {
        poll,
        ..Config::default()
    })
}

/// Start times of the polls.
fn polls(rig: &Rig) -> Vec<u64> {
    let bursts = rig.initiators.iter().zip(&rig.sent);
    let polls = bursts.filter(|(initiator, _)| **initiator == Initiator::Poll);
    polls.map(|(_, (at, _))| *at).collect()
}

#[test]
fn poll_is_handed_over_early_and_blocks_line() {
    let config = Config {
        poll: Poll::Hertz(1_000),
        ..Config::default()
    };
    let mut bridge = Bridge::new(Identity::default(), config, Start::default());
    bridge.usb_event(UsbEvent::Configured(true), Instant::ZERO);
    assert_eq!(bridge.timeout(), Some(Instant::ZERO));
    bridge.tick(at(300));
    let due = at(1_300) - POLL_LEAD_TIME;
    assert_eq!(bridge.timeout(), Some(due));
    assert!(!bridge.update(due - Duration::from_micros(1)).uart);
    assert!(bridge.update(due).uart);
    let mut out = [0; 70];
    let burst = transmit(&mut bridge, &mut out, at(1_290)).unwrap();
    assert_eq!((burst.len, burst.start), (7, Some(at(1_300))));
    bridge.usb_received(b"hello", at(1_291));
    assert!(!bridge.update(at(1_291)).uart);
    assert_eq!(transmit(&mut bridge, &mut out, at(1_299)), None);
}

#[test]
fn lead_time_lasts_over_changes_of_the_rate() {
    const LEAD: Duration = Duration::from_micros(100);
    let mut rig = polling(Poll::Hertz(200));
    rig.bridge.set_poll_lead_time(LEAD);
    rig.run(2_000);
    assert_eq!(rig.bridge.timeout(), Some(at(5_000) - LEAD));
    let config = Config {
        poll: Poll::Hertz(100),
        ..Config::default()
    };
    rig.request(Request::SetConfig(config));
    assert_eq!(rig.bridge.timeout(), Some(at(12_000) - LEAD));
    rig.run(20_000);
    assert_eq!(polls(&rig), [12_000, 22_000]);
    assert_eq!(rig.bridge.counters().late_polls, 0);
}

#[test]
fn polls_start_at_their_slots_for_minutes() {
    for (rate, seconds) in [(7, 120), (300, 60), (1_000, 10)] {
        let mut rig = polling(Poll::Hertz(rate));
        rig.run(u64::from(seconds) * 1_000_000);
        let slots = (1_u64..).map(|n| n * 1_000_000 / u64::from(rate));
        let polls = polls(&rig);
        let count = seconds * u32::from(rate);
        assert_eq!(polls.len() as u32, count);
        assert!(polls.iter().zip(slots).all(|(at, slot)| *at == slot));
        let c = rig.bridge.counters();
        assert_eq!((c.late_polls, c.missed_polls, c.unanswered_requests), (0, 0, 0));
        assert_eq!(rig.bridge.line.settled().latencies().poll.counts[0], count);
    }
}

#[test]
fn same_poll_configuration_keeps_the_slots() {
    let mut rig = polling(Poll::Hertz(100));
    rig.run(25_000);
    let mut config = rig.bridge.config();
    config.host_timeout.after_ms = 0;
    assert_eq!(rig.call(Request::SetConfig(config)), Reply::Done);
    rig.run(30_000);
    assert_eq!(polls(&rig), [10_000, 20_000, 30_000, 40_000, 50_000]);
}

#[test]
fn poll_is_delayed_only_by_current_exchange_counted() {
    let mut rig = polling(Poll::Hertz(1_000));
    for n in 0..2_000 {
        rig.usb_out.extend(ling(0x06, 1, &[0xFE]));
        if n % 3 == 0 {
            rig.can_out.push_back(ling(0x06, 2, &[0xFE]));
        }
        rig.run(1_700 + n % 211);
    }
    let c = rig.bridge.counters();
    assert_eq!((c.missed_polls, c.unanswered_requests), (0, 0));
    let mut late = 0;
    for (n, at) in polls(&rig).into_iter().enumerate() {
        let slot = (n as u64 + 1) * 1_000;
        late += u32::from(at > slot);
        // The longest of the other exchanges takes 70 + 200 + 180 µs.
        assert!((slot..=slot + 460).contains(&at), "poll {n} at {at}");
    }
    assert!(late > 100);
    assert_eq!(c.late_polls, late);
    let rest = &rig.bridge.line.settled().latencies().poll.counts[9..];
    assert!(rest.iter().all(|count| *count == 0));
}

#[test]
fn slots_during_arm_turnaround_are_missed_and_counted() {
    let mut rig = polling(Poll::Hertz(1_000));
    let mut ling_responder = ling_responder();
    rig.responder = Box::new(move |request| ling_responder(request).map(|(_, answer)| (2_000, answer)));
    rig.run(1_000_000);
    // 70 + 2000 + 210 µs: every third slot.
    assert_eq!(polls(&rig)[..3], [1_000, 4_000, 7_000]);
    let c = rig.bridge.counters();
    assert_eq!((c.late_polls, c.requests_poll), (0, 333 + 1));
    assert_eq!(c.missed_polls, 2 * 333);
}

#[test]
fn fastest_poll_follows_the_answer_at_once() {
    let mut rig = polling(Poll::Fastest);
    rig.run(1_000_000);
    let polls = polls(&rig);
    assert!(polls.windows(2).all(|pair| pair[1] - pair[0] == 70 + 200 + 210));
    assert_eq!(polls.len(), 1_000_000 / 480 + 1);
}

#[test]
fn configuration_switches_polling_on_and_off() {
    let mut rig = Rig::new(Config::default());
    rig.run(10_123);
    assert_eq!(rig.bridge.timeout(), None);
    let on = Config {
        poll: Poll::Hertz(100),
        ..Config::default()
    };
    assert_eq!(rig.call(Request::SetConfig(on)), Reply::Done);
    rig.run(35_000);
    assert_eq!(polls(&rig), [20_123, 30_123, 40_123]);
    assert_eq!(rig.call(Request::SetConfig(Config::default())), Reply::Done);
    rig.run(100_000);
    assert_eq!(polls(&rig).len(), 3);
}

#[test]
fn poll_requested_at_its_slot_is_not_late() {
    for (now, start, late) in [(10_499, Some(at(10_500)), 0), (10_500, None, 0), (10_501, None, 1)] {
        let config = Config {
            poll: Poll::Hertz(100),
            ..Config::default()
        };
        let mut bridge = Bridge::new(Identity::default(), config, Start::default());
        bridge.tick(at(500));
        let burst = transmit(&mut bridge, &mut [0; MAX_FRAME], at(now)).unwrap();
        assert_eq!(
            (burst.start, bridge.counters().late_polls),
            (start, late),
            "at {now} µs"
        );
    }
}
