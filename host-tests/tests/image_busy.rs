//! Everything at once through the firmware image: requests of hosts on USB and CAN, the adapter's own polls, cyclic
//! telemetry, and a subscriber to all of it. Nobody may miss anything, or get what is another's.

use std::thread;
use std::time::Instant;

use armwire::Micros;
use armwire_bridge::can::Node;
use armwire_bridge::config::{self, Config, Poll};
use armwire_bridge::control::{Asker, Request};
use armwire_host_tests::image::{
    CanHost, Hosts, MEGABAUD, Subscriber, Traffic, UsbHost, Witness, counters, on_board, plug_in,
};
use armwire_virtual_board::Nanos;

/// Bits per second on the bus.
const RATE: u32 = 1_000_000;

/// Frames on the arm's line in the long run, half of them requests and half of them answers.
const MANY: u32 = 1_000_000;

/// How long the arm thinks and how often it is polled in each part of the long run.
const PARTS: [(Micros, u16); 4] = [
    (Micros(0), 100),
    (Micros(50), 200),
    (Micros(100), 333),
    (Micros(200), 400),
];

/// How often the wires' records are counted and forgotten.
const SPAN: Nanos = Nanos::from_millis(50);

/// Lets everybody work until the arm has answered `frames` times, and expects that all is in order.
///
/// The arm thinks for `turnaround` before each answer, and is polled `hertz` times a second.
fn busy(frames: u32, turnaround: Micros, hertz: u16) {
    on_board(Witness::new(turnaround), |board| {
        let began = Instant::now();
        plug_in(board, MEGABAUD);
        board.can().attach(RATE);
        let mut hosts = Hosts {
            usb: Some(UsbHost::default()),
            can: Some(CanHost::new(Node::default())),
            subscriber: Some(Subscriber::open(board)),
        };
        let mut config = Config {
            poll: Poll::Hertz(hertz),
            can: config::Can {
                telemetry_hz: 1_000,
                ..config::Can::default()
            },
            ..Config::default()
        };
        let before = counters(board);
        let mut traffic = Traffic::begin(board);
        let set = |board: &mut _, hosts: &mut Hosts, config| {
            let subscriber = hosts.subscriber.as_mut().unwrap();
            subscriber.control.order(board, Request::SetConfig(config));
        };
        set(board, &mut hosts, config);
        // Other settings of the bus begin with a controller that knows of nothing before.
        board.run_for(Nanos::from_millis(2)).unwrap();
        let start = board.now();
        while board.with_arm(|arm| arm.deeds().answers) < frames {
            hosts.run_for(board, SPAN);
            traffic.count(board);
        }
        let took = board.now().since(start);
        config.poll = Poll::Off;
        set(board, &mut hosts, config);
        hosts.finish(board);
        traffic.count(board);

        let deeds = board.with_arm(|arm| arm.deeds());
        let Hosts {
            usb: Some(usb),
            can: Some(can),
            subscriber: Some(subscriber),
        } = &hosts
        else {
            unreachable!()
        };
        let seconds = took.0 as f64 / 1e9;
        println!(
            "{} answers in {seconds:.1} s of virtual time, {:.0} s of ours: {} for USB, {} for CAN, {} polls",
            deeds.answers,
            began.elapsed().as_secs_f64(),
            usb.asking.answered,
            can.asking.answered,
            deeds.polls
        );
        // Each request was answered once, in order, with its own answer.
        for asking in [&usb.asking, &can.asking] {
            assert_eq!((asking.answered, asking.given_up), (asking.asked(), 0));
            assert_eq!(asking.strays, Vec::<Vec<u8>>::new());
            // Nobody was kept waiting for the others.
            assert!(asking.answered > deeds.answers / 8, "{} of {}", asking.answered, deeds.answers);
        }
        assert_eq!(usb.noise_bytes, 0);
        assert_eq!((&can.failures[..], &can.notes[..]), (&[][..], &[][..]));
        // Each poll was told of, on the bus and at the control interface.
        assert_eq!((can.telemetry.samples, can.telemetry.gaps), (deeds.polls, 0));
        assert!(f64::from(deeds.polls) > 0.99 * seconds * f64::from(hertz));
        assert_eq!(subscriber.frames(Some(Asker::Usb)), usb.asking.answered);
        assert_eq!(subscriber.frames(Some(Asker::Can)), can.asking.answered);
        assert_eq!(subscriber.frames(Some(Asker::Poll)), deeds.polls);
        assert_eq!((subscriber.frames(None), subscriber.disorder), (0, 0));
        assert_eq!(subscriber.events, []);
        // The arm heard nothing else.
        assert_eq!(deeds.tickets, usb.asking.answered + can.asking.answered);
        assert_eq!((deeds.answers, deeds.noise_bytes), (deeds.tickets + deeds.polls, 0));
        assert_eq!(board.with_arm(Witness::take_others), Vec::<Vec<u8>>::new());

        let after = counters(board);
        let mut expected = before;
        expected.late_polls = after.late_polls;
        expected.arm_to_host_bytes += traffic.bytes_from_arm;
        expected.host_to_arm_bytes += traffic.bytes_to_arm;
        expected.packets_to_host += traffic.packets_to_host;
        expected.empty_packets_to_host += traffic.empty_packets_to_host;
        expected.packets_from_host += traffic.packets_from_host;
        expected.frames += deeds.answers;
        expected.requests_usb += usb.asking.answered;
        expected.requests_can += can.asking.answered;
        expected.requests_poll += deeds.polls;
        expected.can_frames_received += traffic.frames_of_nodes;
        expected.can_frames_sent += traffic.frames_of_board;
        expected.control_requests += 2;
        assert_eq!(after, expected);
        assert!(after.late_polls < deeds.polls);
        assert_eq!((traffic.bytes_from_arm, traffic.bytes_to_arm), (deeds.bytes_said, deeds.bytes_heard));
        assert_eq!(traffic.broken_frames, 0);
    });
}

/// The parts run at once, each on a board of its own.
#[test]
fn a_million_frames_pass_and_none_is_lost() {
    let answers = MANY / 2 / PARTS.len() as u32;
    thread::scope(|scope| {
        for (turnaround, hertz) in PARTS {
            scope.spawn(move || busy(answers, turnaround, hertz));
        }
    });
}

#[test]
fn everybody_gets_every_answer_and_nobody_anothers() {
    busy(20_000, Micros(100), 200);
}
