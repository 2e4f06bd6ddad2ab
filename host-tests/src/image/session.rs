//! A board with all hosts, and the record of its traffic.

use armwire_bridge::config::{self, Config, Poll};
use armwire_bridge::control::Request;
use armwire_bridge::{Counters, Duration};
use armwire_virtual_board::{Chip, Config as BoardConfig, Nanos, Timing, VirtualBoard};

use super::hosts::{ANSWER_TIMEOUT, POLL_PERIOD};
use super::{ArmCounts, Hosts, TicketArm, Traffic, board_config, counters, facts, on_board_with, run_until_unread};

/// A board whose arm is a [`TicketArm`], with all [`Hosts`].
#[derive(Debug)]
pub struct Session<'a> {
    /// The board.
    pub board: &'a mut VirtualBoard<TicketArm>,
    /// The hosts.
    pub hosts: Hosts,
    /// Traffic on the wires.
    pub traffic: Traffic,
    config: Config,
    before: Counters,
    /// The start of the polls, or their duration once they are off.
    polled: Nanos,
    /// Number of requests at the control interface.
    requests: u32,
}

/// A configuration with polls at `hertz`, and cyclic telemetry of each answer.
pub fn polled(hertz: u16) -> Config {
    Config {
        poll: Poll::Hertz(hertz),
        can: config::Can {
            telemetry_hz: config::MAX_POLL_HZ,
            ..config::Can::default()
        },
        ..Config::default()
    }
}

/// A configuration that the chip accepts: without CAN, the settings of the bus are the factory defaults.
pub fn for_chip(chip: Chip, config: Config) -> Config {
    match facts(chip).can {
        true => config,
        false => Config {
            can: config::Can::default(),
            ..config
        },
    }
}

/// Runs a test with all hosts and an arm with this turnaround. The durations of flash operations and of the USB
/// controller are random.
///
/// # Panics
///
/// See [`on_board_with`].
pub fn session<R>(turnaround: Duration, config: Config, test: impl FnOnce(&mut Session<'_>) -> R) -> R {
    let slow = BoardConfig {
        timing: Timing::Drawn,
        ..board_config(TicketArm::new(turnaround))
    };
    on_board_with(slow, |board| {
        let config = for_chip(board.chip(), config);
        let mut session = Session {
            hosts: Hosts::connect(board),
            before: counters(board),
            traffic: Traffic::begin(board),
            board,
            config,
            polled: Nanos(0),
            requests: 0,
        };
        session.configure(config);
        session.polled = session.board.now();
        // New bus settings restart the controller, which discards earlier frames.
        session.board.run_for(Nanos::from_millis(2)).unwrap();
        test(&mut session)
    })
}

impl Session<'_> {
    /// Sets the configuration.
    ///
    /// # Panics
    ///
    /// If the configuration is refused.
    pub fn configure(&mut self, config: Config) {
        self.requests += 1;
        let control = &mut self.hosts.subscriber.control;
        control.order(self.board, Request::SetConfig(config));
    }

    /// Opens the control interface anew and subscribes.
    ///
    /// # Panics
    ///
    /// If the device has no such interface.
    pub fn subscribe(&mut self) {
        self.requests += 1;
        self.hosts.subscriber.open(self.board);
    }

    /// Runs all hosts for `span`.
    ///
    /// # Panics
    ///
    /// If the firmware crashes.
    pub fn run_for(&mut self, span: Nanos) {
        self.run_until(span, |_| false);
    }

    /// Runs all hosts until `done`, for at most `limit`. Returns true if `done` was.
    ///
    /// # Panics
    ///
    /// If the firmware crashes.
    pub fn run_until(&mut self, limit: Nanos, done: impl Fn(&Self) -> bool) -> bool {
        let end = self.board.now() + limit;
        while self.board.now() < end {
            self.hosts.poll(self.board);
            if done(self) {
                return true;
            }
            let left = end.since(self.board.now());
            run_until_unread(self.board, POLL_PERIOD.min(left)).unwrap();
            self.traffic.count(self.board);
        }
        false
    }

    /// Ends the polls, stops new requests, and waits until each has ended.
    ///
    /// # Panics
    ///
    /// If the firmware crashes, or a host still waits after twice its time limit.
    pub fn finish(&mut self) {
        self.configure(Config {
            poll: Poll::Off,
            ..self.config
        });
        self.polled = self.board.now().since(self.polled);
        self.hosts.set_paused(true);
        let is_done = self.run_until(Nanos(2 * ANSWER_TIMEOUT.0), |session| session.hosts.is_done());
        assert!(is_done, "a host still waits");
        // Last bytes are still on their way.
        self.run_for(Nanos::from_millis(20));
    }

    /// Received and sent traffic of the arm.
    pub fn arm_counts(&mut self) -> ArmCounts {
        self.board.with_arm(|arm| arm.counts)
    }

    /// Checks that each slot of the poll had its poll, or was counted as missed.
    ///
    /// # Panics
    ///
    /// If a slot was neither.
    pub fn expect_slots(&mut self) {
        let Poll::Hertz(hertz) = self.config.poll else {
            panic!("the adapter does not poll");
        };
        let polls = u64::from(self.arm_counts().polls + counters(self.board).missed_polls);
        let slots = self.polled.0 * u64::from(hertz) / 1_000_000_000;
        assert!(polls.abs_diff(slots) <= 1, "{polls} polls made or missed of {slots}");
    }

    /// Checks the adapter's counters against the traffic on the wires and at the arm: no errors, except the changes
    /// made by `otherwise`. The number of late polls is known to the adapter only.
    ///
    /// # Panics
    ///
    /// If a counter differs.
    pub fn expect_counters(&mut self, otherwise: impl FnOnce(&mut Counters, Counters)) {
        let arm_counts = self.arm_counts();
        let counted = counters(self.board);
        let mut expected = self.before;
        expected.late_polls = counted.late_polls;
        expected.arm_to_host_bytes += self.traffic.bytes_from_arm;
        expected.host_to_arm_bytes += self.traffic.bytes_to_arm;
        expected.packets_to_host += self.traffic.packets_to_host;
        expected.empty_packets_to_host += self.traffic.empty_packets_to_host;
        expected.packets_from_host += self.traffic.packets_from_host;
        expected.frames += arm_counts.answers;
        expected.requests_usb += arm_counts.tickets_usb;
        expected.requests_can += arm_counts.tickets_can;
        expected.requests_poll += arm_counts.polls;
        expected.can_frames_received += self.traffic.frames_of_nodes;
        expected.can_frames_sent += self.traffic.frames_of_board;
        expected.control_requests += self.requests;
        otherwise(&mut expected, counted);
        if !facts(self.board.chip()).can {
            // The host on USB has the line to itself: more frames than an RP2040 reports.
            expected.dropped_events = counted.dropped_events;
        }
        assert_eq!(counted, expected, "counters (left) differ from the traffic (right)");
        assert!(counted.late_polls <= arm_counts.polls);
        let on_line = (self.traffic.bytes_from_arm, self.traffic.bytes_to_arm);
        assert_eq!(
            on_line,
            (arm_counts.bytes_sent, arm_counts.bytes_received),
            "bytes were lost on the line"
        );
    }
}
