//! A host on CAN that streams motion while the adapter delays it: the arm owes an answer to another host.

use armwire::ling::{Frame, Request, Torque};
use armwire_bridge::Duration;
use armwire_bridge::config::{Config, HostTimeout, Poll};
use armwire_bridge::control::{Event, Initiator};
use armwire_host_tests::image::requests::{encoded, frame, motion};
use armwire_host_tests::image::{Session, counters, session};
use armwire_virtual_board::Nanos;

const TURNAROUND: Duration = Duration::from_micros(100);

const fn millis(millis: u64) -> Nanos {
    Nanos::from_millis(millis)
}

/// Runs a test with torque-off after this number of milliseconds of silence, and no requests but the test's.
fn with_torque_off(after_ms: u16, poll: Poll, test: impl FnOnce(&mut Session<'_>)) {
    let config = Config {
        poll,
        host_timeout: HostTimeout {
            after_ms,
            torque_off: true,
        },
        ..Config::default()
    };
    session(TURNAROUND, config, |session| {
        session.hosts.set_paused(true);
        test(session);
    });
}

/// The host on CAN sends motion in this period, for this time.
fn stream(session: &mut Session<'_>, period: Nanos, time: Nanos) {
    let end = session.board.now() + time;
    while session.board.now() < end {
        session.hosts.can.orders.push_back(motion());
        session.run_for(period);
    }
}

/// The host on USB sends a self-check. The arm answers it after this time, or never.
fn check(session: &mut Session<'_>, period: Nanos, answer: Option<Nanos>) {
    session.board.usb().write(&frame(Request::SelfCheck)).unwrap();
    if let Some(after) = answer {
        stream(session, period, after);
        let healthy = Frame {
            command: 0xFE,
            function: 0x00,
            data: &[0, 0],
        };
        let answer = encoded(|bytes| healthy.encode(bytes));
        session.board.with_arm(|arm| arm.send(&answer));
    }
}

/// Streams motion beside self-checks for two seconds. The host is alive, then it stops: within 150 ms of its timeout
/// torque-off is at the arm.
fn stream_beside_checks(after_ms: u16, period: Nanos, poll: Poll, answer: Option<Nanos>) {
    with_torque_off(after_ms, poll, |session| {
        session.board.with_arm(|arm| arm.silent = true);
        stream(session, period, millis(100));
        for _ in 0..2 {
            check(session, period, answer);
            stream(session, period, millis(1_000));
        }
        let torque_off = frame(Request::SetTorque(Torque::Off));
        let is_silent = |event: &Event| matches!(event, Event::HostSilent { .. });
        let silences = |session: &mut Session<'_>| {
            let events = session.hosts.subscriber.events.drain(..);
            events.map(|(_, event)| event).filter(is_silent).collect::<Vec<_>>()
        };
        assert_eq!(silences(session), []);
        assert_eq!(counters(session.board).unanswered_requests == 0, answer.is_some());
        let at_arm = session.board.with_arm(|arm| arm.take_others());
        assert!(!at_arm.contains(&torque_off));
        assert!(at_arm.iter().filter(|frame| **frame == motion()).count() > 20);

        // It dies behind a full queue.
        check(session, period, None);
        stream(session, period, millis(100).max(Nanos(4 * period.0)));
        session.hosts.can.orders.clear();
        session.run_for(millis(u64::from(after_ms) + 150));
        let silences = silences(session);
        assert!(
            matches!(
                silences[..],
                [Event::HostSilent {
                    initiator: Initiator::Can,
                    torque_off: true,
                    ..
                }]
            ),
            "{silences:?}"
        );
        let at_arm = session.board.with_arm(|arm| arm.take_others());
        assert_eq!(at_arm.last(), Some(&torque_off));
    });
}

#[test]
fn live_stream_outlasts_an_answered_self_check() {
    stream_beside_checks(300, millis(20), Poll::Off, Some(millis(450)));
}

#[test]
fn live_stream_at_1_khz_outlasts_a_missing_answer() {
    stream_beside_checks(500, millis(1), Poll::Off, None);
}

#[test]
fn live_stream_outlasts_missing_answers_to_polls() {
    stream_beside_checks(500, millis(20), Poll::Hertz(100), None);
}
