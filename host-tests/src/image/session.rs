//! A board with everybody at it, and the books of what happened.

use armwire_bridge::can::Node;
use armwire_bridge::config::{self, Config, Poll};
use armwire_bridge::control::Request;
use armwire_bridge::{Counters, Duration};
use armwire_virtual_board::{Config as BoardConfig, Nanos, Timing, VirtualBoard};

use super::{
    ArmCounts, CanHost, Hosts, MEGABAUD, Subscriber, TicketArm, Traffic, UsbHost, counters, on_board_with, path,
    plug_in,
};

/// Bits per second on the bus.
const RATE: u32 = 1_000_000;

/// How often the wires' records are counted and forgotten.
const SPAN: Nanos = Nanos::from_millis(50);

/// A board whose arm is a [`TicketArm`], with all [`Hosts`].
#[derive(Debug)]
pub struct Session<'a> {
    /// The board.
    pub board: &'a mut VirtualBoard<TicketArm>,
    /// Those who use it.
    pub hosts: Hosts,
    /// What was on the wires.
    pub traffic: Traffic,
    config: Config,
    before: Counters,
    /// When polls were switched on; how long they were, once they are off.
    polled: Nanos,
    /// Requests at the control interface.
    requests: u32,
}

/// Cyclic telemetry of each answer to a poll, so many times a second.
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

/// Runs a test with everybody at work, with an arm that thinks for `turnaround` before each answer. Flash and USB controller take
/// times that are drawn.
///
/// # Panics
///
/// As [`on_board_with`].
pub fn session<R>(turnaround: Duration, config: Config, test: impl FnOnce(&mut Session<'_>) -> R) -> R {
    let slow = BoardConfig {
        timing: Timing::Drawn,
        ..BoardConfig::new(path(), TicketArm::new(turnaround))
    };
    on_board_with(slow, |board| {
        plug_in(board, MEGABAUD);
        board.can().attach(RATE);
        let mut session = Session {
            hosts: Hosts {
                usb: Some(UsbHost::default()),
                can: Some(CanHost::new(Node::default())),
                subscriber: Some(Subscriber::open(board)),
            },
            before: counters(board),
            traffic: Traffic::begin(board),
            board,
            config,
            polled: Nanos(0),
            requests: 0,
        };
        session.configure(config);
        session.polled = session.board.now();
        // Other settings of the bus begin with a controller that knows of nothing before.
        session.board.run_for(Nanos::from_millis(2)).unwrap();
        test(&mut session)
    })
}

impl Session<'_> {
    /// Sets the configuration.
    ///
    /// # Panics
    ///
    /// If that is refused, or there is no subscriber.
    pub fn configure(&mut self, config: Config) {
        self.requests += 1;
        let subscriber = self.hosts.subscriber.as_mut().unwrap();
        subscriber.control.order(self.board, Request::SetConfig(config));
    }

    /// Opens the control interface anew and subscribes.
    ///
    /// # Panics
    ///
    /// As [`Subscriber::open`].
    pub fn subscribe(&mut self) {
        self.requests += 1;
        self.hosts.subscriber = Some(Subscriber::open(self.board));
    }

    /// Lets everybody work for `span`.
    ///
    /// # Panics
    ///
    /// As [`Hosts::run_for`].
    pub fn run_for(&mut self, span: Nanos) {
        let end = self.board.now() + span;
        while self.board.now() < end {
            self.hosts.run_for(self.board, SPAN.min(end.since(self.board.now())));
            self.traffic.count(self.board);
        }
    }

    /// Lets those who have asked get their answers, ends the polls, and nobody asks any more.
    ///
    /// # Panics
    ///
    /// As [`Hosts::finish`], and if there is no subscriber.
    pub fn finish(&mut self) {
        self.configure(Config {
            poll: Poll::Off,
            ..self.config
        });
        self.polled = self.board.now().since(self.polled);
        self.hosts.finish(self.board);
        self.traffic.count(self.board);
    }

    /// The host at the serial port.
    ///
    /// # Panics
    ///
    /// If there is none.
    pub fn usb(&mut self) -> &mut UsbHost {
        self.hosts.usb.as_mut().unwrap()
    }

    /// The host on the bus.
    ///
    /// # Panics
    ///
    /// If there is none.
    pub fn can(&mut self) -> &mut CanHost {
        self.hosts.can.as_mut().unwrap()
    }

    /// The program at the control interface.
    ///
    /// # Panics
    ///
    /// If there is none.
    pub fn subscriber(&mut self) -> &mut Subscriber {
        self.hosts.subscriber.as_mut().unwrap()
    }

    /// What the arm has heard and said.
    pub fn arm_counts(&mut self) -> ArmCounts {
        self.board.with_arm(|arm| arm.arm_counts())
    }

    /// Expects that each slot of the poll has had its poll, or was counted as missed.
    ///
    /// # Panics
    ///
    /// If one was neither.
    pub fn expect_slots(&mut self) {
        let Poll::Hertz(hertz) = self.config.poll else {
            panic!("it is not polled");
        };
        let polls = u64::from(self.arm_counts().polls + counters(self.board).missed_polls);
        let slots = self.polled.0 * u64::from(hertz) / 1_000_000_000;
        assert!(polls.abs_diff(slots) <= 1, "{polls} polls made or missed of {slots}");
    }

    /// Expects that the adapter has counted what happened, exactly: what was on the wires and what the arm heard and said,
    /// nothing wrong, and what `otherwise` changes. How many polls had to wait for others nobody else knows.
    ///
    /// # Panics
    ///
    /// If it has not.
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
        expected.requests_usb += arm_counts.tickets_of_usb();
        expected.requests_can += arm_counts.tickets_of_can();
        expected.requests_poll += arm_counts.polls;
        expected.can_frames_received += self.traffic.frames_of_nodes;
        expected.can_frames_sent += self.traffic.frames_of_board;
        expected.control_requests += self.requests;
        otherwise(&mut expected, counted);
        assert_eq!(counted, expected, "counted (left) is not what happened (right)");
        assert!(counted.late_polls <= arm_counts.polls);
        let on_line = (self.traffic.bytes_from_arm, self.traffic.bytes_to_arm);
        assert_eq!(
            on_line,
            (arm_counts.bytes_sent, arm_counts.bytes_received),
            "bytes were lost on the line"
        );
    }
}
