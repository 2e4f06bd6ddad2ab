//! Polls by the firmware image: on time at a fixed rate, and as fast as the wire allows.

use std::env;

use armwire::ling::Request;
use armwire_bridge::Duration;
use armwire_bridge::config::{Config, Poll};
use armwire_bridge::control;
use armwire_host_tests::image::requests::frame;
use armwire_host_tests::image::{
    CanProgram, Control, MEGABAUD, Program, byte_time, chip, counters, facts, on_board, plug_in,
};
use armwire_sim::ling::LingArm;
use armwire_virtual_board::line::{Arm, Direction, LineByte};
use armwire_virtual_board::{Nanos, VirtualBoard};

fn ling(turnaround: Duration) -> LingArm {
    LingArm::new(armwire_sim::ling::Config {
        turnaround,
        ..armwire_sim::ling::Config::follower()
    })
}

fn poll<A: Arm>(board: &mut VirtualBoard<A>, poll: Poll) {
    let config = Config {
        poll,
        ..Config::default()
    };
    Control::open(board).order(board, control::Request::SetConfig(config));
}

/// A request on the line and its answer.
#[derive(Debug)]
struct Exchange {
    request: Vec<u8>,
    /// Start of the first start bit.
    start: Nanos,
    /// End of the last stop bit of the answer, or of the request without an answer yet.
    end: Nanos,
}

fn exchanges(line: &[LineByte]) -> Vec<Exchange> {
    let mut exchanges: Vec<Exchange> = Vec::new();
    let mut direction = Direction::ToBoard;
    for byte in line {
        if byte.direction == Direction::ToArm && direction == Direction::ToBoard {
            exchanges.push(Exchange {
                request: Vec::new(),
                start: Nanos(byte.at.0 - byte_time(MEGABAUD).0),
                end: byte.at,
            });
        }
        direction = byte.direction;
        if let Some(exchange) = exchanges.last_mut() {
            exchange.end = byte.at;
            if direction == Direction::ToArm {
                exchange.request.push(byte.sent);
            }
        }
    }
    exchanges
}

/// Polls at 200 Hz for `ARMWIRE_POLL_SECONDS`, two by default. Each is 5 ms after the one before, and the stamps of the
/// answers are their times on the line.
#[test]
fn quiet_polls_are_at_their_slots_with_stamps() {
    const RATE: u16 = 200;
    const PERIOD: u64 = 5_000_000;
    /// Maximum deviation of an interval, and of a stamp.
    const LATE: u64 = 10_000;
    const STAMP: u64 = 2_000;
    let seconds = env::var("ARMWIRE_POLL_SECONDS").map_or(2, |seconds| seconds.parse().unwrap());
    on_board(ling(Duration::from_micros(100)), |board| {
        plug_in(board, MEGABAUD);
        let mut control = Control::open(board);
        control.subscribe(board);
        let config = Config {
            poll: Poll::Hertz(RATE),
            ..Config::default()
        };
        control.order(board, control::Request::SetConfig(config));
        // Not between a poll and its answer.
        board.uart().forget_bytes();
        board.run_for(Nanos(PERIOD / 2)).unwrap();
        let (mut polls, mut last) = (0, None);
        let (mut late, mut early_stamp, mut late_stamp) = (0, u64::MAX, 0);
        for _ in 0..seconds {
            board.run_for(Nanos::from_millis(1_000)).unwrap();
            let exchanges = exchanges(&board.uart().bytes());
            board.uart().forget_bytes();
            let events = control.take_events(board);
            let stamps = events
                .iter()
                .filter(|(_, event)| matches!(event, control::Event::Frame { .. }));
            assert_eq!(exchanges.len(), stamps.clone().count(), "polls and stamps in a second");
            for (exchange, (at, _)) in exchanges.iter().zip(stamps) {
                let interval = last.map_or(PERIOD, |last| exchange.start.since(last).0);
                late = late.max(interval.abs_diff(PERIOD));
                let off = exchange.end.0.abs_diff(at.0 * 1_000);
                (early_stamp, late_stamp) = (early_stamp.min(off), late_stamp.max(off));
                last = Some(exchange.start);
            }
            polls += exchanges.len() as u64;
        }
        let off = late_stamp - early_stamp;
        println!("{polls} polls: intervals up to {late} ns off, stamps up to {off} ns");
        assert!(polls >= seconds * u64::from(RATE), "{polls} polls");
        assert!(late <= LATE, "{late} ns");
        assert!(off <= STAMP, "{off} ns");
        assert_eq!(counters(board).missed_polls, 0);
    });
}

#[test]
fn polls_start_at_their_slots_under_load() {
    /// Polls per second, and the time between two.
    const RATE: u16 = 250;
    const PERIOD: u64 = 4_000_000;
    /// Maximum delay of a poll.
    const LATE: u64 = 10_000;
    on_board(ling(Duration::from_micros(100)), |board| {
        plug_in(board, MEGABAUD);
        let has_can = facts(board.chip()).can;
        if has_can {
            board.can().attach(1_000_000);
        }
        let mut on_can = CanProgram::default();
        let mut on_usb = Program::default();
        poll(board, Poll::Hertz(RATE));
        board.run_for(Nanos::from_millis(20)).unwrap();
        board.uart().forget_bytes();
        let other = frame(Request::ReadTemperatures);
        for nth in 0..600 {
            board.run_for(Nanos((nth * 618_034) % 3_000_000)).unwrap();
            match nth % 2 {
                1 if has_can => drop(on_can.call(board, &other)),
                _ => drop(on_usb.call(board, Request::ReadTemperatures)),
            }
        }
        let exchanges = exchanges(&board.uart().bytes());
        let joints = frame(Request::ReadJoints);
        // The first undelayed poll is at its slot. All slots are whole periods apart.
        let is_poll = |exchange: &Exchange| exchange.request == joints;
        let first = exchanges.iter().find(|exchange| is_poll(exchange)).unwrap().start;
        let late = |start: Nanos| (start.0 - first.0 + PERIOD / 2) % PERIOD;
        let (mut free, mut delayed, mut spread) = (0, 0, (u64::MAX, 0));
        for pair in exchanges.windows(2) {
            let [before, exchange] = pair else { unreachable!() };
            if !is_poll(exchange) {
                continue;
            }
            // A delayed poll starts right after the exchange that it waited for.
            if !is_poll(before) && exchange.start.0 - before.end.0 < facts(chip()).delayed_poll {
                delayed += 1;
                continue;
            }
            free += 1;
            spread = (spread.0.min(late(exchange.start)), spread.1.max(late(exchange.start)));
        }
        println!(
            "{free} polls within {} ns of each other's slots, {delayed} after another's exchange",
            spread.1 - spread.0
        );
        assert!(free > 200 && delayed > 5, "{free} {delayed}");
        assert!(spread.1 - spread.0 <= LATE, "{} ns", spread.1 - spread.0);
        assert_eq!(counters(board).missed_polls, 0);
    });
}

#[test]
fn fastest_poll_saturates_the_wire() {
    for turnaround in [0_u32, 100, 500] {
        on_board(ling(Duration::from_micros(turnaround.into())), |board| {
            plug_in(board, MEGABAUD);
            poll(board, Poll::Fastest);
            board.run_for(Nanos::from_millis(10)).unwrap();
            board.uart().forget_bytes();
            board.run_for(Nanos::from_millis(1_000)).unwrap();
            let line = board.uart().bytes();
            let exchanges = exchanges(&line);
            // The limit is a line without pauses except for the arm's turnaround.
            let bytes = line.len() as f64 / exchanges.len() as f64;
            let least = bytes * 10.0 + f64::from(turnaround);
            let took = exchanges.last().unwrap().start.since(exchanges[0].start).0 as f64 / 1_000.0;
            let rate = (exchanges.len() - 1) as f64 / took;
            println!(
                "turnaround {turnaround} us: {:.0} polls per second, {:.1} % of the wire limit",
                rate * 1e6,
                100.0 * rate * least
            );
            assert!(rate * least >= facts(chip()).fastest_poll);
            assert_eq!(counters(board).unanswered_requests, 0);
        });
    }
}
