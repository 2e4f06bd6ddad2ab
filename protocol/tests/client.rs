//! The client on a line: transmissions, timeouts, and the assignment of answers.

use std::fmt::Debug;

use armwire::ling::{JointState, Ling, MotionStatus, Request, Response, Stroke, Torque};
use armwire::messages::Messages;
use armwire::time::{Duration, Instant};
use armwire::xarm::{self, XArm};
use armwire::{Client, Config, Event, Output, SubmitError};

const JOINTS: Response = Response::Joints(JointState {
    joints: [2048; 6],
    gripper: 500,
    status: MotionStatus::Idle,
});

const ONCE: Config = Config {
    repeats: 0,
    ..Config::DEFAULT
};

/// A client and the time.
struct Host<M: Messages> {
    client: Client<M, 260>,
    now: Instant,
}

type Lings = Host<Ling>;

fn bytes(response: Response) -> Vec<u8> {
    let mut out = [0; 70];
    let n = Ling.encode_response(&response, None, &mut out).unwrap();
    out[..n].to_vec()
}

fn micros(micros: u64) -> Duration {
    Duration::from_micros(micros)
}

/// The text of an event.
fn describe<R: Debug>(event: Event<'_, R>) -> String {
    match event {
        Event::Noise { bytes, .. } => format!("Noise({})", bytes.len()),
        Event::Broken { offset, .. } => format!("Broken({offset})"),
        other => format!("{other:?}"),
    }
}

fn answer() -> String {
    describe(Event::Answer(JOINTS))
}

fn late() -> String {
    describe(Event::Late(JOINTS))
}

impl<M: Messages + Default> Host<M> {
    fn new(config: Config) -> Self {
        Self {
            client: Client::new(M::default(), config),
            now: Instant::ZERO,
        }
    }

    /// Transmits all pending bytes and returns their number.
    fn transmit(&mut self) -> usize {
        let mut sent = 0;
        while let Output::Transmit(bytes) = self.client.poll(self.now) {
            let n = bytes.len();
            self.client.transmitted(self.now, n).unwrap();
            sent += n;
        }
        sent
    }

    /// Submits a request and transmits it.
    fn send(&mut self, request: M::Request<'_>) {
        self.client.submit(&request).unwrap();
        assert!(self.transmit() > 0);
    }

    fn events(&mut self) -> Vec<String> {
        std::iter::from_fn(|| match self.client.poll(self.now) {
            Output::Event(event) => Some(describe(event)),
            _ => None,
        })
        .collect()
    }

    fn receive(&mut self, bytes: &[u8]) -> Vec<String> {
        let (mut rest, mut events) = (bytes, Vec::new());
        loop {
            rest = self.client.receive(self.now, rest);
            events.extend(self.events());
            if rest.is_empty() {
                return events;
            }
        }
    }

    fn timeout(&mut self) -> Option<Instant> {
        match self.client.poll(self.now) {
            Output::Timeout(until) => until,
            other => panic!("{other:?}"),
        }
    }

    /// Runs the request in flight to its timeout, and returns the number of transmissions.
    fn time_out(&mut self) -> u8 {
        loop {
            self.now = self.timeout().expect("a timeout");
            if let [event] = &self.events()[..] {
                let sends = event.strip_prefix("TimedOut { sends: ").expect(event);
                return sends.trim_end_matches(" }").parse().unwrap();
            }
            assert!(self.transmit() > 0);
        }
    }
}

#[test]
fn call_transmits_its_bytes_in_any_pieces() {
    let mut host = Lings::new(Config::DEFAULT);
    host.client.submit(&Request::ReadJoints).unwrap();
    let mut sent = Vec::new();
    while let Output::Transmit(bytes) = host.client.poll(host.now) {
        sent.push(bytes[0]);
        host.client.transmitted(host.now, 1).unwrap();
    }
    assert_eq!(sent, [0xAA, 0x06, 0x00, 0x01, 0xFE, 0x9A, 0xFF]);
    assert_eq!(host.receive(&bytes(JOINTS)), [answer()]);
    assert!(host.client.is_idle());
    assert_eq!(host.timeout(), None);
}

#[test]
fn excess_transmitted_count_is_an_error() {
    let mut host = Lings::new(Config::DEFAULT);
    host.client.submit(&Request::ReadJoints).unwrap();
    assert!(host.client.transmitted(host.now, 1).is_err(), "nothing to transmit");
    assert!(matches!(host.client.poll(host.now), Output::Transmit(_)));
    let error = host.client.transmitted(host.now, 8).unwrap_err();
    assert_eq!((error.got, error.max), (8, 7));
    assert_eq!(host.transmit(), 7);
    assert!(host.client.received(host.now, 1_000).is_err());
}

#[test]
fn second_request_is_refused_while_one_is_pending() {
    let mut host = Lings::new(Config::DEFAULT);
    host.send(Request::ReadJoints);
    let busy = host.client.submit(&Request::ReadInfo).unwrap_err();
    assert_eq!(busy, SubmitError::Busy);
    assert_eq!(busy.to_string(), "a request is already in flight");
    let mut small = Client::<Ling, 6>::new(Ling, Config::DEFAULT);
    assert!(matches!(
        small.submit(&Request::ReadJoints),
        Err(SubmitError::TooLong(_))
    ));
    assert!(small.is_idle());
}

#[test]
fn request_without_answer_is_done_once_sent() {
    let mut host = Lings::new(Config::DEFAULT);
    host.client.submit(&Request::SetTorque(Torque::Off)).unwrap();
    assert!(!host.client.expects_answer());
    assert!(matches!(host.client.poll(host.now), Output::Transmit(_)));
    host.client.transmitted(host.now, 7).unwrap();
    assert_eq!(host.events(), ["Sent"]);
    assert!(host.client.is_idle());
}

#[test]
fn request_deadline_includes_line_time_turnaround_and_latency() {
    let mut host = Lings::new(Config::DEFAULT);
    host.now = Instant::from_micros(1_000);
    host.send(Request::ReadJoints);
    let expected = host.now + micros((7 + 30) * 10 + 50_000 + 10_000);
    assert_eq!(host.timeout(), Some(expected));
}

#[test]
fn only_reads_are_repeated_up_to_the_limit() {
    for repeats in [0, 1, 2, 255] {
        let mut host = Lings::new(Config {
            repeats,
            ..Config::DEFAULT
        });
        host.send(Request::ReadJoints);
        assert_eq!(host.time_out(), repeats.saturating_add(1));
        host.send(Request::ReadInfo);
        assert_eq!(host.time_out(), repeats.saturating_add(1), "the next one, too");
    }
    let mut host = Host::<XArm>::new(Config {
        repeats: 9,
        ..Config::TCP
    });
    host.send(xarm::Request::ReloadDynamics);
    assert_eq!(host.time_out(), 1);
    for _ in 0..9 {
        host.send(xarm::Request::ReadVersion);
        assert_eq!(host.time_out(), 10);
    }
}

#[test]
fn answer_to_repeat_counts_and_original_is_late() {
    let mut host = Lings::new(Config::DEFAULT);
    host.send(Request::ReadJoints);
    host.now = host.timeout().unwrap();
    assert_eq!(host.transmit(), 7, "again");
    assert_eq!(host.receive(&bytes(JOINTS)), [answer()]);
    assert_eq!(host.receive(&bytes(JOINTS)), [late()]);
    assert_eq!(host.receive(&bytes(JOINTS)), [describe(Event::Unsolicited(JOINTS))]);
}

#[test]
fn late_answer_never_satisfies_the_next_request() {
    let mut host = Lings::new(ONCE);
    host.send(Request::ReadJoints);
    assert_eq!(host.time_out(), 1);
    host.client.submit(&Request::ReadJoints).unwrap();
    assert_eq!(host.transmit(), 0, "held back");
    assert_eq!(host.receive(&bytes(JOINTS)), [late()]);
    assert_eq!(host.transmit(), 7);
    assert_eq!(host.receive(&bytes(JOINTS)), [answer()]);
}

#[test]
fn answer_read_after_its_stale_window_is_late() {
    let mut host = Lings::new(ONCE);
    host.send(Request::ReadJoints);
    assert_eq!(host.time_out(), 1);
    host.now += Duration::from_millis(10_000);
    assert_eq!(host.receive(&bytes(JOINTS)), [late()], "it may have arrived long ago");
    host.send(Request::ReadJoints);
    assert_eq!(host.receive(&bytes(JOINTS)), [answer()]);
}

#[test]
fn missing_answer_blocks_its_kind_for_stale_window() {
    let mut host = Lings::new(ONCE);
    host.send(Request::ReadJoints);
    assert_eq!(host.time_out(), 1);
    let due = host.now;
    host.client.submit(&Request::ReadJoints).unwrap();
    assert_eq!(host.timeout(), Some(due + ONCE.stale_window));
    host.client.cancel();
    host.client.submit(&Request::ReadStroke).unwrap();
    assert_eq!(host.transmit(), 7, "another key is not blocked");
    assert_eq!(
        host.receive(&bytes(Response::Stroke(Stroke::Mm50))),
        [describe(Event::Answer(Response::Stroke(Stroke::Mm50)))]
    );
    host.client.submit(&Request::ReadJoints).unwrap();
    assert_eq!(host.transmit(), 0);
    host.now = due + ONCE.stale_window;
    assert_eq!(host.transmit(), 7);
}

#[test]
fn torque_off_is_never_held_back() {
    let mut host = Lings::new(ONCE);
    host.send(Request::ReadJoints);
    assert_eq!(host.time_out(), 1);
    host.client.submit(&Request::SetTorque(Torque::Off)).unwrap();
    assert_eq!(host.transmit(), 7);
}

#[test]
fn unstarted_request_is_never_sent_after_cancel() {
    let mut host = Lings::new(Config::DEFAULT);
    host.client.submit(&Request::ReadJoints).unwrap();
    assert!(matches!(host.client.poll(host.now), Output::Transmit(_)));
    host.client.cancel();
    assert_eq!((host.transmit(), host.client.is_idle()), (0, true));
    host.send(Request::ReadJoints);
    assert_eq!(host.receive(&bytes(JOINTS)), [answer()]);
}

#[test]
fn cancelled_request_is_completed_before_the_next() {
    let mut host = Lings::new(Config::DEFAULT);
    host.client.submit(&Request::ReadJoints).unwrap();
    assert!(matches!(host.client.poll(host.now), Output::Transmit(_)));
    host.client.transmitted(host.now, 3).unwrap();
    host.client.cancel();
    assert_eq!(host.client.submit(&Request::ReadInfo), Err(SubmitError::Busy));
    assert_eq!(host.transmit(), 4);
    assert_eq!(
        host.receive(&bytes(JOINTS)),
        [late()],
        "its answer is possible from now on"
    );
    host.send(Request::ReadInfo);
}

#[test]
fn answer_to_a_cancelled_request_is_late() {
    let mut host = Lings::new(Config::DEFAULT);
    host.send(Request::ReadJoints);
    host.client.cancel();
    assert!(host.client.is_idle());
    assert_eq!(host.receive(&bytes(JOINTS)), [late()]);
    assert_eq!(host.receive(&bytes(JOINTS)), [describe(Event::Unsolicited(JOINTS))]);
}

#[test]
fn bytes_before_the_request_are_not_an_answer() {
    let mut host = Lings::new(Config::DEFAULT);
    let line = [&[0xAA, 0, 0, 60][..], &bytes(JOINTS)].concat();
    assert_eq!(host.receive(&line), [""; 0], "a false header holds them back");
    host.send(Request::ReadJoints);
    host.client.idle();
    let events = host.events();
    assert_eq!(events.last(), Some(&describe(Event::Unsolicited(JOINTS))));
    assert!(!host.client.is_idle());
}

#[test]
fn answer_behind_false_header_is_found_after_silence() {
    let mut host = Lings::new(ONCE);
    host.send(Request::ReadJoints);
    let line = [&[0xAA, 0, 0, 60][..], &bytes(JOINTS)].concat();
    assert_eq!(host.receive(&line), [""; 0]);
    host.now = host.timeout().unwrap();
    assert_eq!(host.events().last(), Some(&answer()));
}

#[test]
fn idle_line_releases_the_answer_at_once() {
    let mut host = Lings::new(ONCE);
    host.send(Request::ReadJoints);
    let line = [&[0xAA, 0, 0, 60][..], &bytes(JOINTS)].concat();
    assert_eq!(host.receive(&line), [""; 0]);
    host.client.idle();
    assert_eq!(host.events().last(), Some(&answer()));
}

#[test]
fn partly_received_answer_extends_the_timeout() {
    let whole = bytes(JOINTS);
    for received in 1..whole.len() {
        let mut host = Lings::new(ONCE);
        host.send(Request::ReadJoints);
        let due = host.timeout().unwrap();
        let (first, second) = whole.split_at(received);
        host.now = Instant::from_micros(due.as_micros() - 1);
        assert_eq!(host.receive(first), [""; 0]);
        host.now = due + micros(5_000);
        assert!(host.timeout().unwrap() > host.now);
        assert_eq!(host.receive(second), [answer()]);
    }
}

#[test]
fn endless_bytes_do_not_postpone_timeout_forever() {
    for line in [&[0xAA, 0, 0, 60][..], &[0x11]] {
        let mut host = Lings::new(ONCE);
        host.send(Request::ReadJoints);
        let due = host.timeout().unwrap();
        while !host.receive(line).contains(&"TimedOut { sends: 1 }".to_owned()) {
            host.now += micros(1_000);
            assert!(host.now < due + ONCE.latency + micros(2_000));
        }
    }
}

#[test]
fn other_message_does_not_postpone_timeout() {
    let mut host = Lings::new(ONCE);
    host.send(Request::ReadJoints);
    let due = host.timeout().unwrap();
    host.now = Instant::from_micros(due.as_micros() - 1);
    let stroke = Response::Stroke(Stroke::Mm50);
    assert_eq!(host.receive(&bytes(stroke)), [describe(Event::Unsolicited(stroke))]);
    host.now = due;
    assert_eq!(host.events(), ["TimedOut { sends: 1 }"]);
}

#[test]
fn answer_read_long_after_deadline_still_counts() {
    let mut host = Lings::new(ONCE);
    host.send(Request::ReadJoints);
    host.now += micros(10_000_000);
    assert_eq!(host.receive(&bytes(JOINTS)), [answer()]);
}

#[test]
fn echo_is_neither_answer_nor_error() {
    let mut host = Lings::new(Config::DEFAULT);
    host.send(Request::ReadJoints);
    let line = [&[0xAA, 0x06, 0x00, 0x01, 0xFE, 0x9A, 0xFF][..], &bytes(JOINTS)].concat();
    assert_eq!(host.receive(&line), ["Echo".to_owned(), answer()]);
}

type Arms = Host<XArm>;

/// The answer to the request of this number.
fn reloaded(number: u16) -> Vec<u8> {
    let [high, low] = number.to_be_bytes();
    vec![high, low, 0, 2, 0, 2, 4, 0]
}

#[test]
fn request_numbers_start_at_one_and_wrap() {
    let mut host = Arms::new(Config::TCP);
    for number in (1..=u16::MAX).chain(1..3) {
        host.client.submit(&xarm::Request::ReloadDynamics).unwrap();
        let Output::Transmit(bytes) = host.client.poll(host.now) else {
            panic!("held back")
        };
        assert_eq!(bytes[..2], number.to_be_bytes());
        host.client.transmitted(host.now, 7).unwrap();
        assert!(host.receive(&reloaded(number))[0].starts_with("Answer"));
    }
}

#[test]
fn numbered_requests_are_never_held_back() {
    let mut host = Arms::new(Config::TCP);
    for number in 1..20 {
        host.send(xarm::Request::ReloadDynamics);
        if number % 2 == 0 {
            host.client.cancel();
        } else {
            assert!(host.receive(&reloaded(number))[0].starts_with("Answer"), "{number}");
        }
    }
    assert!(host.receive(&reloaded(18))[0].starts_with("Late"));
    assert!(host.receive(&reloaded(18))[0].starts_with("Unsolicited"));
}

#[test]
fn only_the_answer_with_its_own_number_counts() {
    let mut host = Arms::new(Config::TCP);
    host.send(xarm::Request::ReloadDynamics);
    assert_eq!(host.time_out(), 1);
    host.send(xarm::Request::ReloadDynamics);
    assert!(host.receive(&reloaded(1))[0].starts_with("Late"));
    assert!(host.receive(&reloaded(2))[0].starts_with("Answer"));
}

#[test]
fn broken_connection_ends_current_and_later_requests() {
    let mut host = Arms::new(Config::TCP);
    host.send(xarm::Request::ReloadDynamics);
    assert_eq!(host.receive(&[0, 1, 0, 9, 0, 2]), ["Broken(0)"]);
    assert!(host.client.is_idle());
    for number in 2..5 {
        assert_eq!(host.receive(&reloaded(number)), [""; 0], "nothing is read");
        host.client.submit(&xarm::Request::ReloadDynamics).unwrap();
        assert_eq!(host.events(), ["Broken(0)"], "nothing is sent");
        assert!(host.client.is_idle() && !host.client.space().is_empty());
    }
}

#[test]
fn nothing_is_sent_after_the_connection_broke() {
    for sent in 0..7 {
        let mut host = Arms::new(Config::TCP);
        host.client.submit(&xarm::Request::ReloadDynamics).unwrap();
        assert!(matches!(host.client.poll(host.now), Output::Transmit(_)));
        host.client.transmitted(host.now, sent).unwrap();
        assert_eq!(host.receive(&[0, 1, 0, 9]), ["Broken(0)"]);
        assert_eq!(host.transmit(), 0, "after {sent} bytes");
    }
}

#[test]
fn answer_before_break_in_same_bytes_counts() {
    let mut host = Arms::new(Config::TCP);
    host.send(xarm::Request::ReloadDynamics);
    let events = host.receive(&[&reloaded(1)[..], &[0, 0, 1]].concat());
    assert!(
        events[0].starts_with("Answer") && events[1] == "Broken(8)",
        "{events:?}"
    );
}

#[test]
fn non_message_is_skipped_before_the_answer() {
    let mut long = vec![0, 1, 0, 2, 1, 44];
    long.resize(6 + 300, 0);
    let heartbeat = [0, 7, 0, 1, 0, 2, 0, 0];
    let line = [&heartbeat[..], &long, &reloaded(1)].concat();
    for chunk in [1, 7, 260, 1_000] {
        let mut host = Arms::new(Config::TCP);
        host.send(xarm::Request::ReloadDynamics);
        let events: Vec<_> = line.chunks(chunk).flat_map(|bytes| host.receive(bytes)).collect();
        assert!(events.last().unwrap().starts_with("Answer"), "by {chunk}: {events:?}");
    }
}

#[test]
fn every_request_completes() {
    for request in [Request::SetTorque(Torque::Off), Request::ReadJoints, Request::SelfCheck] {
        let mut host = Lings::new(Config::DEFAULT);
        host.client.submit(&request).unwrap();
        for _ in 0..100 {
            match host.client.poll(host.now) {
                Output::Transmit(_) => host.client.transmitted(host.now, 1).unwrap(),
                Output::Event(event) => assert!(matches!(event, Event::Sent | Event::TimedOut { sends: 3 })),
                Output::Timeout(Some(until)) => host.now = until,
                Output::Timeout(None) => break,
            }
        }
        assert!(host.client.is_idle(), "{request:?}");
    }
}
