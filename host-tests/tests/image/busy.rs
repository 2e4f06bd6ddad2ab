//! The firmware image under full load: requests of hosts on USB and CAN, the adapter's own polls, cyclic telemetry, and
//! a subscriber to all frames and events.

use std::env;
use std::thread;
use std::time::Instant;

use armwire_bridge::Duration;
use armwire_bridge::control::Initiator;
use armwire_host_tests::image::{Hosts, TicketArm, chip, counters, facts, polled, session};
use armwire_virtual_board::Nanos;

/// Turnaround of the arm and poll rate, for each part of the long run.
const PARTS: [(Duration, u16); 4] = [
    (Duration::ZERO, 100),
    (Duration::from_micros(50), 200),
    (Duration::from_micros(100), 333),
    (Duration::from_micros(200), 400),
];

/// Runs all hosts until the arm has answered `frames` times, and checks the results.
///
/// The arm has this turnaround, and is polled `hertz` times per second.
fn busy(frames: u32, turnaround: Duration, hertz: u16) {
    let began = Instant::now();
    session(turnaround, polled(hertz), |session| {
        let start = session.board.now();
        while session.arm_counts().answers < frames {
            session.run_for(Nanos::from_millis(50));
        }
        let seconds = session.board.now().since(start).0 as f64 / 1e9;
        session.finish();

        let arm_counts = session.arm_counts();
        session.expect_counters(|_, _| {});
        let dropped_events = counters(session.board).dropped_events;
        let Hosts { usb, can, subscriber } = &session.hosts;
        println!(
            "{} answers in {seconds:.1} s of virtual time, {:.0} s of real time: {} for USB, {} for CAN, {} polls",
            arm_counts.answers,
            began.elapsed().as_secs_f64(),
            usb.tracker.answered,
            can.tracker.answered,
            arm_counts.polls
        );
        let is_shared = facts(chip()).can;
        // Each request was answered once, in order, with its own answer.
        for (tracker, is_used) in session.hosts.trackers().into_iter().zip([true, is_shared]) {
            assert_eq!((tracker.answered, tracker.given_up), (tracker.issued, 0));
            assert_eq!(tracker.strays, Vec::<Vec<u8>>::new());
            // The line was shared.
            assert!(
                !is_used || tracker.answered > arm_counts.answers / 10,
                "{} of {}",
                tracker.answered,
                arm_counts.answers
            );
        }
        assert_eq!(usb.noise_bytes, 0);
        assert_eq!((&can.failures[..], &can.can_events[..]), (&[][..], &[][..]));
        // Each poll was reported, on the bus and at the control interface.
        let reported = if is_shared { arm_counts.polls } else { 0 };
        assert_eq!((can.telemetry.samples, can.telemetry.gaps), (reported, 0));
        assert!(f64::from(arm_counts.polls) > 0.99 * seconds * f64::from(hertz));
        let reported = [Initiator::Usb, Initiator::Can, Initiator::Poll].map(|one| subscriber.frames_for(Some(one)));
        let answered = [usb.tracker.answered, can.tracker.answered, arm_counts.polls];
        assert!(
            reported
                .iter()
                .zip(answered)
                .all(|(&reported, answered)| reported <= answered)
        );
        assert_eq!(
            reported.iter().sum::<u32>() + dropped_events,
            answered.iter().sum::<u32>()
        );
        assert_eq!((subscriber.frames_for(None), subscriber.disorder), (0, 0));
        assert_eq!(subscriber.events, []);
        // The arm received nothing else.
        assert_eq!(arm_counts.tickets(), usb.tracker.answered + can.tracker.answered);
        assert_eq!((arm_counts.unanswered(), arm_counts.noise_bytes), (0, 0));
        assert_eq!(session.board.with_arm(TicketArm::take_others), Vec::<Vec<u8>>::new());
        assert_eq!(session.traffic.broken_frames, 0);
    });
}

/// 40 000 answers of the arm, 4 000 without CAN, or `ARMWIRE_FRAMES`. The parts run in parallel, each on its own board.
#[test]
fn every_frame_of_a_busy_arm_passes() {
    let usual = if facts(chip()).can { 40_000 } else { 4_000 };
    let frames = env::var("ARMWIRE_FRAMES").map_or(usual, |frames| frames.parse().expect("a number"));
    let answers = frames / PARTS.len() as u32;
    thread::scope(|scope| {
        for (turnaround, hertz) in PARTS {
            scope.spawn(move || busy(answers, turnaround, hertz));
        }
    });
}
