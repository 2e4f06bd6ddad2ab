//! Faults around the firmware image: losses are counted, and other traffic continues.

use armwire::ling::{Request, Torque};
use armwire_bridge::can::{Frame, Function, Node};
use armwire_bridge::config::{Config, HostTimeout};
use armwire_bridge::control::{self, Event, Initiator, Refusal};
use armwire_bridge::isotp;
use armwire_bridge::{Duration, PACKET};
use armwire_host_tests::image::requests::{frame, motion};
use armwire_host_tests::image::{
    Control, MEGABAUD, RequestTracker, Session, Ticket, TicketArm, board_config, byte_time, chip, facts, plug_in,
    polled, session,
};
use armwire_virtual_board::line::{Direction, Fault, LineByte};
use armwire_virtual_board::report::Cause;
use armwire_virtual_board::{Nanos, VirtualBoard};

const TURNAROUND: Duration = Duration::from_micros(100);

/// Polls per second.
const HERTZ: u16 = 100;

const fn millis(millis: u64) -> Nanos {
    Nanos::from_millis(millis)
}

/// Answers to the host on USB so far, to the one on CAN, and to polls.
fn answered(session: &mut Session<'_>) -> [u32; 3] {
    let polls = session.arm_counts().answers - session.arm_counts().tickets();
    [
        session.hosts.usb.tracker.answered,
        session.hosts.can.tracker.answered,
        polls,
    ]
}

/// Expects at least this number of answers since `before`, by host.
fn expect_more(session: &mut Session<'_>, before: [u32; 3], mut least: [u32; 3]) {
    if !facts(chip()).can {
        least[1] = 0;
    }
    let after = answered(session);
    let more = [0, 1, 2].map(|nth| after[nth] - before[nth]);
    assert!(
        more.iter().zip(least).all(|(&more, least)| more >= least),
        "{more:?} more, at least {least:?}"
    );
}

/// Checks that no host received an unexpected frame.
fn expect_no_strays(session: &mut Session<'_>) {
    assert_eq!(session.hosts.usb.tracker.strays, Vec::<Vec<u8>>::new());
    assert_eq!(session.hosts.can.tracker.strays, Vec::<Vec<u8>>::new());
}

/// The host on CAN was not disturbed: it received every answer and every sample of a poll, if the chip has CAN.
fn expect_can_undisturbed(session: &mut Session<'_>) {
    if !facts(chip()).can {
        return;
    }
    let polls = session.arm_counts().polls;
    let can = &session.hosts.can;
    assert_eq!((can.tracker.given_up, &can.failures[..]), (0, &[][..]));
    assert_eq!((can.telemetry.samples, can.telemetry.gaps), (polls, 0));
}

/// The subscriber's events other than frames.
fn events(session: &mut Session<'_>) -> Vec<Event> {
    session
        .hosts
        .subscriber
        .events
        .drain(..)
        .map(|(_, event)| event)
        .collect()
}

#[test]
fn unplugged_host_loses_only_its_own_answers() {
    const TIMES: u32 = 4;
    session(TURNAROUND, polled(HERTZ), |session| {
        for nth in 0..u64::from(TIMES) {
            session.run_for(millis(100) + Nanos(137_000 * nth));
            let before = answered(session);
            session.board.usb().detach();
            session.hosts.usb.on_closed();
            session.run_for(millis(200));
            expect_more(session, before, [0, 100, 19]);

            plug_in(session.board, MEGABAUD);
            session.subscribe();
            let before = answered(session);
            session.run_for(millis(100));
            expect_more(session, before, [100, 30, 9]);
        }
        session.finish();
        let reported = session.hosts.subscriber.frames.len() as u32;
        expect_no_strays(session);
        expect_can_undisturbed(session);
        session.expect_slots();

        let sent_by_arm = session.arm_counts().bytes_for_usb();
        let usb = &session.hosts.usb;
        assert_eq!(usb.noise_bytes, 0);
        assert_eq!(usb.tracker.answered + usb.tracker.given_up, usb.tracker.issued);
        let missed = sent_by_arm - usb.bytes;
        let handed_over = session.traffic.packets_to_host;
        let taken = session.arm_counts().tickets_usb;
        session.expect_counters(|expected, counted| {
            // A cable that is pulled out, and one that is put in until the host resets the bus, is a suspended bus.
            expected.usb_resets += TIMES;
            expected.usb_suspends += 2 * TIMES;
            // Each request is a packet. The adapter may have taken one whose handshake no longer reached the host.
            expected.packets_from_host = taken;
            // One packet waits in the USB core, and one for its place there.
            expected.packets_to_host = counted.packets_to_host;
            assert!((handed_over..=handed_over + 2 * TIMES).contains(&counted.packets_to_host));
            // The adapter counts bytes in the USB core as sent.
            expected.undelivered_bytes = counted.undelivered_bytes;
            assert!((counted.undelivered_bytes..=counted.undelivered_bytes + TIMES * PACKET as u32).contains(&missed));
            // All but the events queued for the subscriber at the unplug.
            expected.dropped_events = counted.dropped_events;
            let queued = counted.frames - reported - counted.dropped_events;
            assert!((1..TIMES * 40).contains(&queued), "{queued} queued events");
        });
    });
}

#[test]
fn bus_off_is_counted_once_and_recovers() {
    /// Attempts, and errors that the controller sees in them, until it is off (RM0090 32.7.6): 16 in the error flag of the
    /// first, one in each of 16 more.
    const ATTEMPTS: u32 = 17;
    const ERRORS: u32 = 32;
    const TIMES: u32 = 3;
    session(TURNAROUND, polled(HERTZ), |session| {
        for _ in 0..TIMES {
            let before = answered(session);
            session.run_for(millis(300));
            expect_more(session, before, [300, 60, 29]);
            let before = answered(session);
            session.board.can().short();
            session.run_for(millis(100));
            // The other hosts have a larger share of the arm.
            expect_more(session, before, [200, 0, 9]);
            session.board.can().release();
            session.run_for(millis(2));
        }
        session.run_for(millis(300));
        session.finish();
        expect_no_strays(session);
        // A PDU in transfer is lost, at most one answer each time. The next request interrupts a started transfer.
        let lost = session.hosts.can.tracker.given_up;
        assert!((1..=TIMES).contains(&lost), "{lost} answers lost");
        let failures = &session.hosts.can.failures;
        let interrupted = |failure: &isotp::Error| matches!(failure, isotp::Error::Interrupted { .. });
        assert!(
            failures.len() as u32 <= TIMES && failures.iter().all(interrupted),
            "{failures:?}"
        );
        assert_eq!(
            (session.hosts.usb.tracker.given_up, session.hosts.usb.noise_bytes),
            (0, 0)
        );
        let polls = session.arm_counts().polls;
        let telemetry = &session.hosts.can.telemetry;
        assert!(telemetry.gaps <= TIMES, "one that had begun: {telemetry:?}");
        assert!(
            (polls - TIMES * 10..polls).contains(&telemetry.samples),
            "{telemetry:?}"
        );
        session.expect_slots();
        // Each change is reported on both interfaces.
        let can_events = session.hosts.can.can_events.clone();
        let reported: Vec<_> = [true, false].repeat(TIMES as usize);
        let reported: Vec<_> = reported.into_iter().map(|off| Event::BusOff { off }).collect();
        assert_eq!(events(session), reported);
        assert_eq!(can_events, reported);

        let broken = session.traffic.broken_frames;
        session.expect_counters(|expected, counted| {
            expected.can_bus_offs += TIMES;
            // A node's frame that waited while the bus was shorted passes while the adapter is still off it.
            let missed = expected.can_frames_received - counted.can_frames_received;
            assert!(missed <= TIMES, "{missed} frames of nodes not received");
            expected.can_frames_received -= missed;
            // All lost answers: there are no requests while the bus is shorted. One whose last frames were in the
            // controller had left ISO-TP, and is not counted.
            expected.isotp_failures += lost;
            let had_left = expected.isotp_failures - counted.isotp_failures;
            assert!(had_left < lost, "{had_left} of {lost} answers not counted");
            expected.isotp_failures -= had_left;
            // The errors of one error flag are too close together to be counted separately.
            expected.can_bus_errors = counted.can_bus_errors;
            assert!(
                (broken..=broken * ERRORS / ATTEMPTS + TIMES * ERRORS).contains(&counted.can_bus_errors),
                "{broken}"
            );
        });
    });
}

#[test]
fn line_errors_and_strays_cost_no_other_answer() {
    const TIMES: u32 = 20;
    session(TURNAROUND, polled(HERTZ), |session| {
        for nth in 0..u64::from(TIMES) {
            session.board.uart().plan_fault(nth * 7 % 15, Fault::Framing);
            session.board.uart().plan_fault(20 + nth, Fault::Noise);
            session.run_for(millis(20));
            session.board.with_arm(|arm| arm.send(&[0x55, 0x00, 0xFF, nth as u8]));
            session.run_for(millis(160));
        }
        let before = answered(session);
        session.run_for(millis(200));
        expect_more(session, before, [200, 60, 19]);
        session.finish();
        expect_no_strays(session);
        session.expect_slots();

        let traffic = session.traffic;
        assert_eq!((traffic.framing_faults, traffic.noise_faults), (TIMES, TIMES));
        let arm_counts = session.arm_counts();
        let subscriber = &session.hosts.subscriber;
        let frames = subscriber.frames.len() as u32;
        let noise = traffic.bytes_from_arm - subscriber.frame_bytes();
        let polls = subscriber.frames_for(Some(Initiator::Poll));
        let lost = [
            session.hosts.usb.tracker.given_up,
            session.hosts.can.tracker.given_up,
            arm_counts.polls - polls,
        ];
        println!("answers lost for USB, CAN and polls: {lost:?}");
        assert!((1..=TIMES).contains(&lost.iter().sum()));
        assert_eq!(session.hosts.can.telemetry.samples, polls);
        assert_eq!(session.hosts.usb.noise_bytes, noise);
        session.expect_counters(|expected, counted| {
            expected.framing_errors += TIMES;
            expected.noise_errors += TIMES;
            expected.frames = frames;
            expected.noise_bytes += noise;
            expected.unanswered_requests += lost.iter().sum::<u32>();
            expected.missed_polls = counted.missed_polls;
        });
    });
}

#[test]
fn unread_host_data_is_dropped_and_counted() {
    session(TURNAROUND, polled(HERTZ), |session| {
        session.run_for(millis(100));
        // The host keeps sending requests, and does not read.
        session.board.usb().set_reading(false);
        session.hosts.usb.ignores_window = true;
        let before = answered(session);
        session.run_for(millis(400));
        expect_more(session, before, [0, 100, 39]);
        session.hosts.usb.ignores_window = false;
        session.hosts.usb.tracker.paused = true;
        session.run_for(millis(100));
        session.board.usb().set_reading(true);
        session.run_for(millis(50));
        session.hosts.usb.tracker.paused = false;

        let before = answered(session);
        session.run_for(millis(200));
        expect_more(session, before, [200, 60, 19]);
        session.finish();
        assert_eq!(session.hosts.can.tracker.strays, Vec::<Vec<u8>>::new());
        expect_can_undisturbed(session);
        assert_eq!(events(session), []);
        session.expect_slots();

        let arm_counts = session.arm_counts();
        let usb = &session.hosts.usb;
        // The kept answers belong to given-up requests, in sequence from the first.
        let kept: Vec<_> = usb
            .tracker
            .strays
            .iter()
            .map(|stray| Ticket::of_answer(stray).unwrap().0.number)
            .collect();
        assert!(
            kept.len() > 100 && kept.windows(2).all(|pair| pair[1] == pair[0] + 1),
            "{kept:?}"
        );
        assert_eq!(usb.tracker.issued, arm_counts.tickets_usb);
        let dropped = arm_counts.bytes_for_usb() - usb.bytes;
        println!("{dropped} bytes dropped of {}", arm_counts.bytes_for_usb());
        assert!(dropped > 1_000);
        assert!(
            usb.noise_bytes < 15,
            "more than the rest of an answer: {}",
            usb.noise_bytes
        );
        session.expect_counters(|expected, _| expected.dropped_bytes += dropped);
    });
}

#[test]
fn unread_subscriber_data_is_dropped_and_counted() {
    session(TURNAROUND, polled(HERTZ), |session| {
        session.run_for(millis(100));
        session.board.usb().vendor().set_reading(false);
        let before = answered(session);
        session.run_for(millis(300));
        expect_more(session, before, [300, 60, 29]);
        session.board.usb().vendor().set_reading(true);
        session.run_for(millis(100));
        session.finish();
        expect_no_strays(session);
        session.expect_slots();
        let reported = session.hosts.subscriber.frames.len() as u32;
        let dropped = session.arm_counts().answers - reported;
        println!("{dropped} events dropped, {reported} reported");
        assert!(dropped > 300);
        session.expect_counters(|expected, _| expected.dropped_events += dropped);
    });
}

#[test]
fn hanging_can_host_loses_one_answer_delays_none() {
    const TIMES: u32 = 2;
    session(TURNAROUND, polled(HERTZ), |session| {
        for _ in 0..TIMES {
            session.run_for(millis(100));
            // Its request is on its way, and it will not give flow control for the answer.
            let is_sent = session.run_until(millis(20), |session| {
                !session.hosts.can.tracker.is_done() && session.board.can().unsent() == 0
            });
            assert!(is_sent);
            session.hosts.can.hangs = true;
            let before = answered(session);
            session.run_for(millis(1_100));
            expect_more(session, before, [1_100, 0, 109]);
            session.hosts.can.hangs = false;
            let before = answered(session);
            session.run_for(millis(300));
            expect_more(session, before, [200, 60, 29]);
        }
        session.finish();
        expect_no_strays(session);
        session.expect_slots();
        assert_eq!(session.hosts.can.tracker.given_up, TIMES);
        assert_eq!(
            (session.hosts.usb.tracker.given_up, session.hosts.usb.noise_bytes),
            (0, 0)
        );
        session.expect_counters(|expected, _| expected.isotp_failures += TIMES);
    });
}

#[test]
fn silent_arm_is_polled_in_same_slots() {
    session(TURNAROUND, polled(HERTZ), |session| {
        session.run_for(millis(300));
        session.board.with_arm(|arm| arm.silent = true);
        session.run_for(millis(700));
        // Now the host on CAN has only polls beside it.
        session.hosts.usb.tracker.paused = true;
        session.run_for(millis(800));
        session.hosts.usb.tracker.paused = false;
        session.board.with_arm(|arm| arm.silent = false);
        // The answer to the last given-up request may be pending.
        session.run_for(millis(200));
        let before = answered(session);
        session.run_for(millis(300));
        expect_more(session, before, [200, 60, 29]);
        session.finish();
        session.expect_slots();

        let arm_counts = session.arm_counts();
        let reported = [Initiator::Usb, Initiator::Can, Initiator::Poll]
            .map(|initiator| session.hosts.subscriber.frames_for(Some(initiator)));
        let lost = [
            arm_counts.tickets_usb - reported[0],
            arm_counts.tickets_can - reported[1],
            arm_counts.polls - reported[2],
        ];
        println!("unanswered requests of USB, CAN and polls: {lost:?}");
        // Requests that were given up before their turn are answered nevertheless.
        let answered = |tracker: &RequestTracker| tracker.answered + tracker.strays.len() as u32;
        assert_eq!(
            [
                answered(&session.hosts.usb.tracker),
                answered(&session.hosts.can.tracker)
            ],
            reported[..2]
        );
        assert_eq!(session.hosts.usb.tracker.issued, arm_counts.tickets_usb);
        let refused = session.hosts.can.tracker.issued - arm_counts.tickets_can;
        let refusal = Event::Refused {
            initiator: Initiator::Can,
            reason: Refusal::QueueFull,
        };
        assert_eq!(events(session), vec![refusal; refused as usize]);
        assert!(lost.iter().all(|&lost| lost > 1), "{lost:?}");
        assert_eq!(lost.iter().sum::<u32>(), arm_counts.unanswered());
        assert_eq!(session.hosts.usb.noise_bytes, 0);
        session.expect_counters(|expected, counted| {
            expected.refused_can_requests += refused;
            expected.unanswered_requests += arm_counts.unanswered();
            expected.missed_polls = counted.missed_polls;
        });
    });
}

#[test]
fn polls_keep_slots_after_silent_arm() {
    session(TURNAROUND, polled(HERTZ), |session| {
        session.hosts.set_paused(true);
        let mut starts = Vec::new();
        for silent in [false, true, false] {
            session.board.with_arm(|arm| arm.silent = silent);
            // A poll waits as long as its answer could be confused with a late one.
            session.run_for(millis(200));
            for _ in 0..60 {
                session.board.run_for(millis(5)).unwrap();
                let line = session.board.uart().bytes();
                let first = |byte: &&LineByte| !silent && byte.direction == Direction::ToArm && byte.sent == 0xAA;
                starts.extend(line.iter().filter(first).map(|byte| byte.at.0 - byte_time(MEGABAUD).0));
                session.traffic.count(session.board);
            }
        }
        session.finish();
        session.expect_slots();
        let period = 1_000_000_000 / u64::from(HERTZ);
        let late = starts.iter().map(|start| (start - starts[0] + period / 2) % period);
        let (least, most) = (late.clone().min().unwrap(), late.max().unwrap());
        println!(
            "{} polls within {} ns of each other's slots",
            starts.len(),
            most - least
        );
        assert!(starts.len() >= 58 && most - least <= 10_000);
        let unanswered = session.arm_counts().unanswered();
        assert!(unanswered >= 4, "{unanswered}");
        session.expect_counters(|expected, counted| {
            expected.unanswered_requests += unanswered;
            expected.missed_polls = counted.missed_polls;
        });
    });
}

/// Sends motion by `send` every 20 ms, then stops, while other hosts use the arm.
fn fall_silent(initiator: Initiator, torque_off: bool, send: impl Fn(&mut Session<'_>, &[u8])) {
    const MOVES: u32 = 10;
    let config = Config {
        host_timeout: HostTimeout {
            after_ms: 300,
            torque_off,
        },
        ..polled(HERTZ)
    };
    session(TURNAROUND, config, |session| {
        match initiator {
            Initiator::Usb => session.hosts.usb.tracker.paused = true,
            _ => session.hosts.can.tracker.paused = true,
        }
        for _ in 0..MOVES {
            send(session, &motion());
            session.run_for(millis(20));
        }
        session.run_for(millis(270));
        assert_eq!(events(session), []);
        session.run_for(millis(20));
        let event = Event::HostSilent {
            initiator,
            dropped: 0,
            torque_off,
        };
        let event = [event];
        assert_eq!(events(session), event);
        let on_can = if facts(chip()).can { &event[..] } else { &[] };
        assert_eq!(session.hosts.can.can_events, on_can);
        let mut expected = vec![motion(); MOVES as usize];
        if torque_off {
            expected.push(frame(Request::SetTorque(Torque::Off)));
        }
        assert_eq!(session.board.with_arm(|arm| arm.take_others()), expected);

        // The host may start again, and only this host is reported as silent.
        send(session, &motion());
        session.hosts.set_paused(false);
        let before = answered(session);
        session.run_for(millis(700));
        expect_more(session, before, [400, 100, 69]);
        assert_eq!(events(session), []);
        assert_eq!(session.board.with_arm(|arm| arm.take_others()), [motion()]);
        session.finish();
        expect_no_strays(session);
        session.expect_slots();
        session.expect_counters(|expected, _| {
            match initiator {
                Initiator::Usb => expected.requests_usb += MOVES + 1,
                _ => expected.requests_can += MOVES + 1,
            }
            expected.requests_adapter += u32::from(torque_off);
            expected.host_silences += 1;
        });
    });
}

#[test]
fn silent_usb_host_is_reported() {
    fall_silent(Initiator::Usb, false, |session, motion| {
        session.board.usb().write(motion).unwrap()
    });
}

#[test]
fn silent_usb_host_switches_torque_off_if_configured() {
    fall_silent(Initiator::Usb, true, |session, motion| {
        session.board.usb().write(motion).unwrap()
    });
}

#[test]
fn silent_can_host_is_reported() {
    fall_silent(Initiator::Can, false, |session, motion| {
        session.hosts.can.orders.push_back(motion.to_vec())
    });
}

#[test]
fn silent_can_host_switches_torque_off_if_configured() {
    fall_silent(Initiator::Can, true, |session, motion| {
        session.hosts.can.orders.push_back(motion.to_vec())
    });
}

#[test]
fn watchdog_restart_of_armed_adapter_switches_torque_off() {
    let mut board = VirtualBoard::start(board_config(TicketArm::new(TURNAROUND))).unwrap();
    plug_in(&mut board, MEGABAUD);
    let mut control = Control::open(&mut board);
    let host_timeout = HostTimeout {
        after_ms: 300,
        torque_off: true,
    };
    let config = Config {
        host_timeout,
        ..Config::default()
    };
    control.order(&mut board, control::Request::SetConfig(config));
    for _ in 0..10 {
        board.usb().write(&motion()).unwrap();
        board.run_for(millis(20)).unwrap();
    }
    assert_eq!(board.with_arm(TicketArm::take_others), vec![motion(); 10]);
    board.hold_core();
    board.run_for(millis(5_000)).unwrap();
    let torque_off = frame(Request::SetTorque(Torque::Off));
    assert_eq!(board.with_arm(TicketArm::take_others), [torque_off]);

    let report = board.report();
    report.check().unwrap();
    let restarts: Vec<_> = report.restarts.iter().map(|restart| restart.cause).collect();
    assert_eq!(restarts, [Cause::Watchdog]);
}

#[test]
fn can_requests_without_room_are_refused_and_reported() {
    const BURST: usize = 12;
    // The arm's turnaround is as long as the burst.
    session(Duration::from_micros(2_000), polled(HERTZ), |session| {
        session.hosts.can.tracker.paused = true;
        session.run_for(millis(100));
        // All requests without a wait for the answers, each in one frame.
        let joints = frame(Request::ReadJoints);
        let single = [&[joints.len() as u8], &joints[..]].concat();
        let single = Frame::new(Function::ArmRequest.id(Node::default()), &single).unwrap();
        for _ in 0..BURST {
            session.board.can().send(&single).unwrap();
        }
        // And one in two.
        session.hosts.can.tracker.paused = false;
        session.run_for(millis(200));
        session.finish();

        let answers = std::mem::take(&mut session.hosts.can.tracker.strays);
        // The one in two frames was refused by flow control, too.
        assert_eq!(session.hosts.can.tracker.given_up, 1);
        assert!(matches!(
            session.hosts.can.failures[..],
            [isotp::Error::Overflow { .. }]
        ));
        assert!(answers.iter().all(|answer| answer[..3] == joints[..3]), "{answers:?}");
        let refused = (BURST + 1 - answers.len()) as u32;
        println!("{} of {BURST} in one frame answered", answers.len());
        // Two wait in the adapter and one in the connection, besides the one that is with the arm.
        assert!((4..BURST).contains(&answers.len()));
        let refusal = Event::Refused {
            initiator: Initiator::Can,
            reason: Refusal::QueueFull,
        };
        assert_eq!(events(session), vec![refusal.clone(); refused as usize]);
        assert_eq!(session.hosts.can.can_events, vec![refusal; refused as usize]);
        session.expect_counters(|expected, _| {
            expected.requests_can += answers.len() as u32;
            expected.requests_poll -= answers.len() as u32;
            expected.refused_can_requests += refused;
        });
    });
}

#[test]
fn unsolicited_frames_reach_can_and_overflow_is_counted() {
    const FRAMES: u32 = 40;
    let mut config = polled(HERTZ);
    config.can.unsolicited = true;
    session(TURNAROUND, config, |session| {
        session.run_for(millis(100));
        session.hosts.set_paused(true);
        session.run_for(millis(20));
        let unsolicited = frame(Request::SetTorque(Torque::On));
        session
            .board
            .with_arm(|arm| arm.send(&unsolicited.repeat(FRAMES as usize)));
        session.run_for(millis(100));
        let on_can = std::mem::take(&mut session.hosts.can.tracker.strays);
        assert!(on_can.iter().all(|frame| *frame == unsolicited));
        let on_usb = std::mem::take(&mut session.hosts.usb.tracker.strays);
        assert_eq!(on_usb, vec![unsolicited; FRAMES as usize]);
        session.hosts.set_paused(false);
        session.run_for(millis(100));
        session.finish();
        expect_no_strays(session);
        let dropped = FRAMES - on_can.len() as u32;
        println!("{} of {FRAMES} on CAN", on_can.len());
        session.expect_counters(|expected, _| {
            expected.frames += FRAMES;
            expected.unsolicited_frames += FRAMES;
            expected.dropped_can_answers += dropped;
        });
    });
}
