//! The client on a line: transmissions, timeouts, and the assignment of answers.

use std::fmt::Debug;

use armwire::alpha1::{self, Alpha1, Text};
use armwire::correlation::{Correlation, Effect};
use armwire::framing::{LONGEST_VOID, Reason};
use armwire::ling::{
    self, GripperSpeed, JointState, Ling, MotionStatus, Move, Opening, Position, Request, Response, Speed, Stroke,
    Torque,
};
use armwire::messages::Messages;
use armwire::time::{Duration, Instant};
use armwire::xarm::{self, XArm};
use armwire::{Client, Config, Device, DeviceEvent, Event, Output, SubmitError};

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

    /// The next output, with an empty port.
    fn poll(&mut self) -> Output<'_, M::Response<'_>> {
        if matches!(self.client.poll(self.now), Output::Receive) {
            self.client.received(self.now, 0).unwrap();
        }
        self.client.poll(self.now)
    }

    /// Transmits all pending bytes and returns them.
    fn transmit_bytes(&mut self) -> Vec<u8> {
        let mut sent = Vec::new();
        loop {
            match self.client.poll(self.now) {
                Output::Receive => self.client.received(self.now, 0).unwrap(),
                Output::Transmit(bytes) => {
                    sent.extend(bytes);
                    let n = bytes.len();
                    self.client.transmitted(self.now, n).unwrap();
                }
                Output::Event(_) | Output::Timeout(_) => return sent,
            }
        }
    }

    /// Transmits all pending bytes and returns their number.
    fn transmit(&mut self) -> usize {
        self.transmit_bytes().len()
    }

    /// Submits a request and transmits its first bytes.
    fn send_part(&mut self, request: M::Request<'_>, part: usize) {
        self.client.submit(&request).unwrap();
        assert!(matches!(self.poll(), Output::Transmit(_)));
        self.client.transmitted(self.now, part).unwrap();
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
    while let Output::Transmit(bytes) = host.poll() {
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
    assert!(matches!(host.poll(), Output::Transmit(_)));
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
    assert!(matches!(host.poll(), Output::Transmit(_)));
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

/// Transmits a fence, which goes out before the request in flight.
fn transmit_fence(host: &mut Lings) -> Vec<u8> {
    let sent = host.transmit_bytes();
    assert!(Ling::FENCES.contains(&&sent[..]), "{sent:02X?}");
    sent
}

/// The next request is delayed until the late answer has arrived, and gets its own.
fn expect_late_answer_first(host: &mut Lings) {
    host.client.submit(&Request::ReadJoints).unwrap();
    transmit_fence(host);
    assert_eq!(host.receive(&bytes(JOINTS)), [late()]);
    assert_eq!(host.transmit(), 7);
    assert_eq!(host.receive(&bytes(JOINTS)), [answer()]);
}

#[test]
fn late_answer_never_satisfies_the_next_request() {
    let mut host = Lings::new(ONCE);
    host.send(Request::ReadJoints);
    assert_eq!(host.time_out(), 1);
    expect_late_answer_first(&mut host);
}

#[test]
fn fences_are_reads_with_different_keys() {
    let keys = Ling::FENCES.iter().map(|frame| {
        let request = Ling.parse_request(frame).unwrap();
        let mut out = [0; 70];
        let n = Ling.encode_request(&request, &mut out).unwrap();
        assert_eq!(&out[..n], *frame);
        let info = Ling.request(frame).unwrap();
        assert_eq!((info.effect, info.response.is_some()), (Effect::Read, true));
        info.key
    });
    let keys: Vec<_> = keys.collect();
    assert!(
        keys.iter()
            .all(|key| keys.iter().filter(|other| *other == key).count() == 1)
    );
}

#[test]
fn answered_fence_ends_the_wait_for_a_lost_answer() {
    let mut host = Lings::new(ONCE);
    host.send(Request::ReadJoints);
    assert_eq!(host.time_out(), 1);
    host.client.submit(&Request::ReadJoints).unwrap();
    transmit_fence(&mut host);
    assert_eq!(
        host.receive(&bytes(Response::Stroke(Stroke::Mm50))),
        [""; 0],
        "nobody's"
    );
    assert_eq!(host.transmit_bytes(), request_bytes::<Ling>(Request::ReadJoints));
    assert_eq!(host.receive(&bytes(JOINTS)), [answer()]);
}

#[test]
fn unanswered_fence_is_followed_by_the_next() {
    let mut host = Lings::new(ONCE);
    host.send(Request::ReadJoints);
    assert_eq!(host.time_out(), 1);
    let begin = host.now;
    host.client.submit(&Request::ReadJoints).unwrap();
    let mut times = Vec::new();
    for fence in Ling::FENCES.iter().cycle() {
        assert_eq!(transmit_fence(&mut host), *fence);
        times.push(host.now.since(begin).as_micros() / 1_000);
        host.now = host.timeout().unwrap();
        if host.now.since(begin) >= ONCE.stale_window + ONCE.stale_window {
            break;
        }
    }
    assert_eq!(times, [0, 10, 30, 70, 150]);
    assert_eq!(host.events(), ["TimedOut { sends: 0 }"], "nothing is known");
    assert_eq!(host.transmit(), 0);
}

#[test]
fn request_is_executed_after_no_part_of_a_fence() {
    let mut host = Lings::new(ONCE);
    host.send(Request::ReadJoints);
    assert_eq!(host.time_out(), 1);
    host.client.submit(&Request::ReadJoints).unwrap();
    assert!(matches!(host.poll(), Output::Transmit(_)));
    host.client.transmitted(host.now, 3).unwrap();
    host.client.cancel();
    host.client.submit(&Request::SetTorque(Torque::Off)).unwrap();
    let sent = host.transmit_bytes();
    assert_eq!(sent[..4], Ling::FENCES[0][3..]);
    assert_eq!(sent[4..], request_bytes::<Ling>(Request::SetTorque(Torque::Off)));
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
    let mut host = Host::<Alpha1>::new(ONCE);
    host.send(alpha1::Request::ReadHardwareVersion);
    assert_eq!(host.time_out(), 1);
    let due = host.now;
    host.client.submit(&alpha1::Request::ReadHardwareVersion).unwrap();
    assert_eq!(host.timeout(), Some(due + ONCE.stale_window));
    host.client.cancel();
    host.send(alpha1::Request::ReadFirmwareVersion);
    host.client.cancel();
    host.client.submit(&alpha1::Request::ReadHardwareVersion).unwrap();
    assert_eq!(host.transmit(), 0);
    host.now = due + ONCE.stale_window;
    assert!(host.transmit() > 0);
}

#[test]
fn reading_never_waits_for_a_lost_answer() {
    let mut host = Lings::new(Config::DEFAULT);
    for _ in 0..7 {
        read(&mut host);
        host.client.cancel();
    }
    host.client.submit_reading(&Request::ReadJoints).unwrap();
    assert_eq!(host.transmit(), 0, "no more without an answer");
    for _ in 0..7 {
        assert_eq!(host.receive(&bytes(JOINTS)), [late()]);
    }
    assert_eq!(host.transmit(), 7);
    assert_eq!(host.time_out(), 1, "it is not repeated");
}

#[test]
fn reading_that_changes_the_arm_is_refused() {
    let mut host = Lings::new(ONCE);
    for request in [
        motion(2048),
        Request::SetTorque(Torque::On),
        Request::SetStroke(Stroke::Mm50),
    ] {
        let refused = host.client.submit_reading(&request).unwrap_err();
        assert_eq!(refused.to_string(), "the request is not a read");
        assert!(host.client.is_idle());
        assert_eq!(host.transmit(), 0);
    }
    read(&mut host);
    assert_eq!(host.client.submit_reading(&motion(2048)), Err(SubmitError::Busy));
}

/// Starts a reading and transmits it, behind a fence if one is due.
fn read(host: &mut Lings) {
    host.client.submit_reading(&Request::ReadJoints).unwrap();
    let sent = host.transmit_bytes();
    let fence = &sent[..sent.len() - 7];
    assert!(fence.is_empty() || Ling::FENCES.contains(&fence), "{sent:02X?}");
    assert_eq!(sent[fence.len()..], request_bytes::<Ling>(Request::ReadJoints));
}

#[test]
fn each_reading_has_its_answer() {
    let mut host = Lings::new(ONCE);
    let mut sent = Vec::new();
    for _ in 0..3 {
        host.client.cancel();
        host.now += Duration::from_millis(20);
        sent.push(host.now);
        read(&mut host);
    }
    let received = host.now + Duration::from_millis(1);
    host.now = received;
    let state = bytes(JOINTS);
    for (event, stated) in [(late(), sent[0]), (late(), sent[1]), (answer(), received)] {
        assert!(host.client.receive(host.now, &state).is_empty());
        let Output::Event(got) = host.client.poll(host.now) else {
            panic!("no event");
        };
        assert_eq!(describe(got), event);
        assert_eq!(host.client.time_of_state(), Some(stated));
    }
    assert_eq!(host.timeout(), None);
    assert_eq!(host.client.time_of_state(), None);
}

#[test]
fn state_is_as_old_as_the_write_that_the_program_was_interrupted_in() {
    let mut host = Lings::new(ONCE);
    host.client.submit(&Request::ReadJoints).unwrap();
    assert!(matches!(host.poll(), Output::Transmit(_)));
    let begin = host.now;
    host.now += Duration::from_millis(500);
    host.client.transmitted(host.now, 7).unwrap();
    assert!(host.client.receive(host.now, &bytes(JOINTS)).is_empty());
    assert!(matches!(host.client.poll(host.now), Output::Event(Event::Answer(_))));
    assert_eq!(host.client.time_of_state(), Some(begin));
}

#[test]
fn late_reading_never_satisfies_a_command() {
    let mut host = Lings::new(ONCE);
    read(&mut host);
    host.client.cancel();
    read(&mut host);
    assert_eq!(host.receive(&bytes(JOINTS)), [late()]);
    host.client.cancel();
    host.now += ONCE.stale_window;
    expect_late_answer_first(&mut host);
}

#[test]
fn reading_leaves_other_late_answers_alone() {
    let mut host = Lings::new(ONCE);
    host.send(Request::ReadInfo);
    assert_eq!(host.time_out(), 1);
    read(&mut host);
    host.client.cancel();
    host.client.submit(&Request::ReadInfo).unwrap();
    assert_eq!(host.transmit(), 0, "delayed");
    host.client.cancel();
    read(&mut host);
    assert_eq!(host.receive(&bytes(JOINTS)), [late()]);
    assert_eq!(host.receive(&bytes(JOINTS)), [answer()]);
}

#[test]
fn torque_off_is_never_delayed() {
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
    assert!(matches!(host.poll(), Output::Transmit(_)));
    host.client.cancel();
    assert_eq!((host.transmit(), host.client.is_idle()), (0, true));
    host.send(Request::ReadJoints);
    assert_eq!(host.receive(&bytes(JOINTS)), [answer()]);
}

/// The bytes of a request.
fn request_bytes<M: Messages + Default>(request: M::Request<'_>) -> Vec<u8> {
    let mut out = [0; 260];
    let n = M::default().encode_request(&request, &mut out).unwrap();
    out[..n].to_vec()
}

/// A motion with this value in all fields, as far as it is in their ranges.
fn motion(value: u16) -> Request {
    Request::Move(Move {
        joints: [(Position::new(value).unwrap(), Speed::new(value.max(1)).unwrap()); ling::JOINTS],
        gripper: (Opening::new(value % 1_001).unwrap(), GripperSpeed(value)),
    })
}

/// The requests that an arm executes, which searches every byte for a frame.
fn executed<M: Messages + Default>(line: &[u8]) -> Vec<String> {
    let (mut arm, mut requests) = (Device::<M, 300>::new(M::default()), Vec::new());
    // A false header delays what follows, if all bytes arrive at once.
    for byte in line {
        assert!(arm.receive(&[*byte]).is_empty());
        while let Some(event) = arm.poll() {
            if let DeviceEvent::Request { request, .. } = event {
                requests.push(format!("{request:?}"));
            }
        }
    }
    requests
}

/// Cancels a request after each number of bytes and submits the next.
fn assert_voided<M: Messages + Default>(request: M::Request<'_>, next: M::Request<'_>) {
    let (whole, next_bytes) = (request_bytes::<M>(request), request_bytes::<M>(next));
    for part in 1..whole.len() {
        let mut host = Host::<M>::new(Config::DEFAULT);
        host.send_part(request, part);
        host.client.cancel();
        host.client.submit(&next).expect("at once");
        let sent = host.transmit_bytes();
        assert_eq!(
            sent,
            [&vec![0; LONGEST_VOID][..], &next_bytes].concat(),
            "after {part} bytes"
        );
        let line = [&whole[..part], &sent].concat();
        assert_eq!(executed::<M>(&line), [format!("{next:?}")], "{line:02x?}");
    }
}

#[test]
fn partly_transmitted_request_is_never_executed() {
    for value in (0..4_096).step_by(7).chain([0x0AA, 0xAA0, 0xAAA]) {
        assert_voided::<Ling>(motion(value), Request::SetTorque(Torque::Off));
    }
    assert_voided::<Ling>(Request::SetTorque(Torque::Off), Request::ReadJoints);
    assert_voided::<Ling>(Request::SelfCheck, Request::SelfCheck);
    let text = Text::new(b"\xFB\xBF\xC8\xF3\x3F\xFF").unwrap();
    assert_voided::<Alpha1>(alpha1::Request::Play(text), alpha1::Request::Stop);
}

#[test]
fn partly_transmitted_request_is_never_answered() {
    let mut host = Lings::new(Config::DEFAULT);
    host.send_part(Request::ReadJoints, 6);
    host.client.cancel();
    host.send(Request::ReadJoints);
    assert_eq!(host.receive(&bytes(JOINTS)), [answer()], "to the second");
    assert_eq!(host.receive(&bytes(JOINTS)), [describe(Event::Unsolicited(JOINTS))]);
}

#[test]
fn void_is_completed_before_any_other_byte() {
    let mut host = Lings::new(Config::DEFAULT);
    host.send_part(motion(2_048), 5);
    host.client.cancel();
    let mut zeros = 0;
    while zeros < LONGEST_VOID {
        // Calls that end in the meantime do not change it.
        host.client.submit(&Request::SetTorque(Torque::On)).unwrap();
        host.client.received(host.now, 0).unwrap();
        let Output::Transmit(bytes) = host.client.poll(host.now) else {
            panic!("{zeros} zeros")
        };
        assert!(bytes.iter().all(|byte| *byte == 0));
        host.client.transmitted(host.now, 1).unwrap();
        zeros += 1;
        host.client.cancel();
    }
    assert_eq!(host.timeout(), None);
    host.client.submit(&Request::SetTorque(Torque::Off)).unwrap();
    assert_eq!(host.client.poll(host.now), Output::Receive);
    assert_eq!(
        host.transmit_bytes(),
        request_bytes::<Ling>(Request::SetTorque(Torque::Off))
    );
}

#[test]
fn repeat_is_voided_by_an_answer() {
    let mut host = Lings::new(Config::DEFAULT);
    host.send(Request::ReadJoints);
    host.now = host.timeout().unwrap();
    assert!(
        matches!(host.client.poll(host.now), Output::Transmit(_)),
        "without a read"
    );
    host.client.transmitted(host.now, 3).unwrap();
    assert_eq!(host.receive(&bytes(JOINTS)), [answer()]);
    assert_eq!(host.transmit_bytes(), [0; LONGEST_VOID]);
    host.send(Request::ReadJoints);
    assert_eq!(host.receive(&bytes(JOINTS)), [answer()]);
}

#[test]
fn partly_transmitted_request_breaks_lossless_line() {
    let request = xarm::Request::ReloadDynamics;
    for part in 1..request_bytes::<XArm>(request).len() {
        let mut host = Arms::new(Config::TCP);
        host.send_part(request, part);
        host.client.cancel();
        for _ in 0..3 {
            host.client.submit(&request).unwrap();
            let Output::Event(Event::Broken { offset: 0, reason }) = host.client.poll(host.now) else {
                panic!("not broken after {part} bytes")
            };
            assert_eq!(reason, Reason::Abandoned);
            assert_eq!(reason.to_string(), "a request ended while it was partly transmitted");
            assert_eq!((host.transmit(), host.client.is_idle()), (0, true));
        }
        assert_eq!(host.receive(&reloaded(1)), [""; 0], "nothing is read");
    }
}

#[test]
fn port_is_read_before_each_request() {
    let mut host = Lings::new(ONCE);
    for _ in 0..3 {
        host.client.submit(&Request::ReadJoints).unwrap();
        for old in [&bytes(JOINTS)[..10], &bytes(JOINTS)[10..], &[0x11]] {
            assert_eq!(host.client.poll(host.now), Output::Receive);
            assert!(host.client.transmitted(host.now, 1).is_err(), "nothing to transmit yet");
            assert!(!host.receive(old).contains(&answer()));
        }
        assert_eq!(host.transmit(), 7);
        assert_eq!(host.receive(&bytes(JOINTS)), [answer()]);
    }
}

#[test]
fn endless_bytes_delay_a_request_by_the_backlog() {
    for (backlog, reads) in [(0, 1), (1, 1), (21, 1), (22, 2), (65_536, 3_121)] {
        let mut host = Lings::new(Config { backlog, ..ONCE });
        host.client.submit(&Request::ReadJoints).unwrap();
        for _ in 0..reads {
            assert_eq!(host.client.poll(host.now), Output::Receive);
            assert_eq!(host.receive(&bytes(JOINTS)), [describe(Event::Unsolicited(JOINTS))]);
        }
        assert!(
            matches!(host.client.poll(host.now), Output::Transmit(_)),
            "backlog {backlog}"
        );
    }
}

#[test]
fn one_read_precedes_requests_without_confusable_answer() {
    let mut host = Lings::new(ONCE);
    host.client.submit(&Request::SetTorque(Torque::Off)).unwrap();
    assert_eq!(host.client.poll(host.now), Output::Receive);
    assert_eq!(host.receive(&[0x11]), ["Noise(1)"]);
    assert!(matches!(host.client.poll(host.now), Output::Transmit(_)));

    let mut host = Arms::new(Config::TCP);
    host.client.submit(&xarm::Request::ReloadDynamics).unwrap();
    assert_eq!(host.client.poll(host.now), Output::Receive);
    assert_eq!(host.receive(&[0, 1]), [""; 0]);
    assert!(matches!(host.client.poll(host.now), Output::Transmit(_)));
}

#[test]
fn early_report_of_empty_port_does_not_count() {
    let mut host = Lings::new(ONCE);
    host.client.received(host.now, 0).unwrap();
    host.client.submit(&Request::ReadJoints).unwrap();
    assert!(host.client.receive(host.now, &[]).is_empty());
    assert_eq!(host.client.poll(host.now), Output::Receive);
}

#[test]
fn bytes_that_do_not_fit_are_no_empty_port() {
    let mut host = Lings::new(ONCE);
    host.client.submit(&Request::ReadJoints).unwrap();
    assert_eq!(host.client.poll(host.now), Output::Receive);
    let flood = [0xAA; 300];
    let rest = host.client.receive(host.now, &flood);
    assert_eq!(rest.len(), 40, "the buffer is full");
    assert_eq!(host.client.receive(host.now, rest), rest);
    host.events();
    assert_eq!(host.client.poll(host.now), Output::Receive);
}

/// A port with a receive buffer, and an arm whose answers are given.
struct Port<'a> {
    now: Instant,
    unread: Vec<u8>,
    /// The answer to each request.
    answer: &'a dyn Fn(usize) -> Option<Response>,
    requests: usize,
}

/// A program that knows nothing but the outputs of the client.
fn call(client: &mut Client<Ling, 260>, port: &mut Port<'_>, request: Request) -> Option<Response> {
    client.submit(&request).unwrap();
    loop {
        match client.poll(port.now) {
            Output::Receive => {
                let n = port.unread.len();
                client.space()[..n].copy_from_slice(&port.unread);
                port.unread.clear();
                client.received(port.now, n).unwrap();
            }
            Output::Transmit(frame) => {
                let n = frame.len();
                port.requests += 1;
                port.unread
                    .extend((port.answer)(port.requests).into_iter().flat_map(bytes));
                client.transmitted(port.now, n).unwrap();
            }
            Output::Timeout(until) if port.unread.is_empty() => port.now = until.unwrap(),
            Output::Timeout(_) => {
                assert!(client.receive(port.now, &port.unread).is_empty());
                port.unread.clear();
            }
            Output::Event(Event::Answer(response)) => return Some(response),
            Output::Event(Event::TimedOut { .. }) => return None,
            Output::Event(_) => {}
        }
    }
}

#[test]
fn answer_in_the_port_is_never_new() {
    let pose = |ticks| {
        Response::Joints(JointState {
            joints: [ticks; 6],
            gripper: 500,
            status: MotionStatus::Idle,
        })
    };
    let mut client = Client::new(Ling, ONCE);
    let mut port = Port {
        now: Instant::ZERO,
        unread: Vec::new(),
        answer: &|request| (request > 1).then_some(pose(222)),
        requests: 0,
    };
    assert_eq!(call(&mut client, &mut port, Request::ReadJoints), None);
    port.now += micros(50_000);
    port.unread = bytes(pose(111));
    port.now += micros(500_000);
    assert_eq!(call(&mut client, &mut port, Request::ReadJoints), Some(pose(222)));
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
    assert_eq!(host.receive(&line), [""; 0], "a false header delays them");
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
        let Output::Transmit(bytes) = host.poll() else {
            panic!("delayed")
        };
        assert_eq!(bytes[..2], number.to_be_bytes());
        host.client.transmitted(host.now, 7).unwrap();
        assert!(host.receive(&reloaded(number))[0].starts_with("Answer"));
    }
}

#[test]
fn numbered_requests_are_never_delayed() {
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
        assert!(matches!(host.poll(), Output::Transmit(_)));
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
                Output::Receive => host.client.received(host.now, 0).unwrap(),
                Output::Transmit(_) => host.client.transmitted(host.now, 1).unwrap(),
                Output::Event(event) => assert!(matches!(event, Event::Sent | Event::TimedOut { sends: 3 })),
                Output::Timeout(Some(until)) => host.now = until,
                Output::Timeout(None) => break,
            }
        }
        assert!(host.client.is_idle(), "{request:?}");
    }
}
