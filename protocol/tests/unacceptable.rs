//! Answers that match their request but are not acceptable.

use armwire::alpha1::{self, Alpha1, Interval, MoveTime, Offset, ServoId, ServoRequest};
use armwire::ling::{self, Ling, Stroke};
use armwire::messages::Messages;
use armwire::time::{Duration, Instant};
use armwire::xarm::{self, Joint, Raw, XArm};
use armwire::{Client, Config, Event, Output};

/// A client on a line that answers at once.
struct Host<M: Messages, const N: usize> {
    client: Client<M, N>,
    now: Instant,
}

impl<M: Messages + Default, const N: usize> Host<M, N> {
    fn new() -> Self {
        Self {
            client: Client::new(M::default(), Config::DEFAULT),
            now: Instant::ZERO,
        }
    }

    /// Transmits all pending bytes, and returns their number.
    fn transmit(&mut self) -> usize {
        if matches!(self.client.poll(self.now), Output::Receive) {
            self.client.received(self.now, 0).unwrap();
        }
        let Output::Transmit(bytes) = self.client.poll(self.now) else {
            return 0;
        };
        let n = bytes.len();
        self.client.transmitted(self.now, n).unwrap();
        n
    }

    fn send(&mut self, request: M::Request<'_>) {
        self.client.submit(&request).unwrap();
        assert!(self.transmit() > 0);
    }

    /// The texts of the events for these bytes.
    fn receive(&mut self, bytes: &[u8]) -> Vec<String> {
        self.now += Duration::from_micros(1);
        assert!(self.client.receive(self.now, bytes).is_empty());
        let mut events = Vec::new();
        while let Output::Event(event) = self.client.poll(self.now) {
            events.push(match event {
                Event::Unacceptable(error) => format!("unacceptable, {error}"),
                Event::ErrorFrame { frame } => format!("error frame {frame:02X?}"),
                Event::Unknown { .. } => "unknown".to_owned(),
                other => format!("{other:?}"),
            });
        }
        events
    }
}

fn ling(command: u8, function: u8, data: &[u8]) -> Vec<u8> {
    let mut out = [0; ling::MAX_FRAME];
    let frame = ling::Frame {
        command,
        function,
        data,
    };
    let n = frame.encode(&mut out).unwrap();
    out[..n].to_vec()
}

fn xarm(transaction: u16, body: &[u8]) -> Vec<u8> {
    let numbers = [transaction, 2, body.len() as u16].map(u16::to_be_bytes);
    [numbers.as_flattened(), body].concat()
}

/// With a checksum, except for a single status.
fn alpha1(command: u8, data: &[u8]) -> Vec<u8> {
    let check: &[u8] = match data {
        [0xAA | 0xEE] => &[],
        _ => &[alpha1::checksum(data)],
    };
    [&[command, command.rotate_left(4)], data, check, &[0xED]].concat()
}

/// The answer ends the request at once, with this reason, and the next request goes out at once.
#[track_caller]
fn ends<M: Messages + Default, const N: usize>(request: M::Request<'_>, answer: &[u8], reason: &str) {
    let mut host = Host::<M, N>::new();
    host.send(request);
    assert_eq!(host.receive(answer), [format!("unacceptable, {reason}")], "{request:?}");
    assert!(host.client.is_idle());
    host.send(request);
}

/// The frame is not an answer to the request, which stays pending.
#[track_caller]
fn ends_nothing<M: Messages + Default, const N: usize>(request: M::Request<'_>, frame: &[u8]) {
    let mut host = Host::<M, N>::new();
    host.send(request);
    assert_eq!(host.receive(frame), ["unknown"], "{request:?}");
    assert!(!host.client.is_idle());
}

const LING: usize = ling::MAX_FRAME;
const XARM: usize = xarm::MAX_FRAME;
const ALPHA1: usize = alpha1::MAX_FRAME;

#[test]
fn unacceptable_ling_answer_ends_the_request() {
    use ling::Request::*;
    for (request, answer, reason) in [
        (
            ReadInfo,
            ling(1, 0, &[0; 23]),
            "command 01 function 00: 23 data bytes, expected 24",
        ),
        (
            ReadStroke,
            ling(4, 0x0E, &[3]),
            "command 04 function 0E: gripper stroke type is 3, must be 0..=2 (data byte 0)",
        ),
        (
            ReadJoints,
            ling(6, 0, &[0; 14]),
            "command 06 function 00: 14 data bytes, expected 15",
        ),
        (
            ReadTemperatures,
            ling(6, 1, &[30; 5]),
            "command 06 function 01: 5 data bytes, expected 6 or 10",
        ),
        (
            ReadVelocities,
            ling(6, 2, &[0; 11]),
            "command 06 function 02: 11 data bytes, expected 12 or 20",
        ),
        (
            SelfCheck,
            ling(0xFE, 0, &[0]),
            "command FE function 00: 1 data bytes, expected 2",
        ),
    ] {
        ends::<Ling, LING>(request, &answer, reason);
    }
}

#[test]
fn unacceptable_xarm_answer_ends_the_request() {
    for (command, body, reason) in [
        (
            xarm::Request::ReadTorqueSource,
            &[5, 0, 2][..],
            "register 5: torque source is 2, must be 0..=1 (data byte 0)",
        ),
        (
            xarm::Request::ReadRotationRadius(Joint::new(1).unwrap()),
            &[6, 0, 0, 0, 0],
            "register 6: 3 data bytes, expected 0 or 4",
        ),
    ] {
        ends::<XArm, XARM>(command, &xarm(1, body), reason);
    }
}

#[test]
fn unacceptable_alpha1_answer_ends_the_request() {
    let [one, two] = [1, 2].map(|id| ServoId::new(id).unwrap());
    let action = alpha1::Action {
        angles: [None; 20],
        time: MoveTime::MAX,
        interval: Interval::MAX,
    };
    let servo = alpha1::Request::Servo;
    let status = "data byte 1 is 55, must be AA or EE";
    for (request, answer, reason) in [
        (
            alpha1::Request::ReadFirmwareVersion,
            alpha1(0xF5, &[0x55; 11]),
            "command F5: data byte 0 is 55, must be AA or EE".to_owned(),
        ),
        (
            alpha1::Request::Act(action),
            alpha1(0xFB, &[1, 0x55, 0, 0, 0, 0]),
            format!("command FB: {status}"),
        ),
        (
            servo(ServoRequest::ReadAngles(one)),
            alpha1(0xFA, &[1, 0x55, 0, 0, 0, 0]),
            format!("command FA: {status}"),
        ),
        (
            servo(ServoRequest::ChangeId { from: one, to: two }),
            alpha1(0xFA, &[2, 0x55, 0, 1, 0, 0]),
            format!("command FA: {status}"),
        ),
        (
            servo(ServoRequest::ReadOffset(one)),
            alpha1(0xFA, &[1, 0x55, 0, 0, 0, 0]),
            format!("command FA: {status}"),
        ),
        (
            servo(ServoRequest::SetOffset(one, Offset::MAX)),
            alpha1(0xFA, &[1, 0x55, 0, 0, 0, 0]),
            format!("command FA: {status}"),
        ),
        (
            servo(ServoRequest::ReadVersion(one)),
            alpha1(0xFC, &[1, 0x55, 0, 0, 0, 0]),
            format!("command FC: {status}"),
        ),
    ] {
        ends::<Alpha1, ALPHA1>(request, &answer, &reason);
    }
}

#[test]
fn frame_that_answers_something_else_ends_nothing() {
    use ling::Request::*;
    ends_nothing::<Ling, LING>(ReadJoints, &ling(4, 0x0E, &[3]));
    ends_nothing::<Ling, LING>(ReadJoints, &ling(6, 1, &[30; 5]));

    let torque = xarm::Request::ReadTorqueSource;
    ends_nothing::<XArm, XARM>(torque, &xarm(8, &[5, 0, 2]));
    ends_nothing::<XArm, XARM>(torque, &xarm(1, &[6, 0, 2]));
    let raw = xarm::Request::Raw(Raw::new(13, &[]).unwrap());
    ends_nothing::<XArm, XARM>(raw, &xarm(1, &[5, 0, 2]));

    let [one, two] = [1, 2].map(|id| ServoId::new(id).unwrap());
    let other = alpha1(0xFA, &[3, 0x55, 0, 0, 0, 0]);
    for request in [
        ServoRequest::ReadAngles(one),
        ServoRequest::ChangeId { from: one, to: two },
        ServoRequest::ReadOffset(two),
    ] {
        ends_nothing::<Alpha1, ALPHA1>(alpha1::Request::Servo(request), &other);
    }
    // A frame of the Bluetooth protocol, which has the header of an action.
    let act = alpha1::Request::Act(alpha1::Action {
        angles: [None; 20],
        time: MoveTime::MAX,
        interval: Interval::MAX,
    });
    let bluetooth = [0xFB, 0xBF, 6, 1, 0, 7, 0xED];
    ends_nothing::<Alpha1, ALPHA1>(act, &bluetooth);
}

#[test]
fn error_frame_ends_the_request_unrepeated() {
    use ling::Request::*;
    for request in [ReadInfo, ReadJoints, SelfCheck] {
        for frame in [ling(0xEE, 0, &[]), ling(0xEE, 1, &[2]), ling(0xEE, 0, &[0xFE; 64])] {
            let mut host = Host::<Ling, LING>::new();
            host.send(request);
            assert_eq!(
                host.receive(&frame),
                [format!("error frame {frame:02X?}")],
                "{request:?}"
            );
            assert!(host.client.is_idle());
            host.send(request);
        }
    }
}

#[test]
fn error_frame_without_pending_request_ends_nothing() {
    let error = ling(0xEE, 0, &[1]);
    let mut host = Host::<Ling, LING>::new();
    assert_eq!(host.receive(&error), ["unknown"]);
    // It came before the request.
    host.client.submit(&ling::Request::ReadStroke).unwrap();
    assert_eq!(host.receive(&error), ["unknown"]);
    assert_eq!(host.transmit(), 7);
    assert_eq!(host.receive(&ling(4, 0x0E, &[1])), ["Answer(Stroke(Mm75))"]);
    // A move has no answer.
    host.send(ling::Request::SetTorque(ling::Torque::On));
    assert_eq!(host.receive(&error), ["Sent", "unknown"]);
    // It answers the oldest request, which was cancelled.
    host.send(ling::Request::ReadStroke);
    host.client.cancel();
    host.send(ling::Request::ReadJoints);
    assert_eq!(host.receive(&error), ["unknown"]);
    assert!(!host.client.is_idle());
}

#[test]
fn echo_is_not_an_unacceptable_answer() {
    let mut host = Host::<Ling, LING>::new();
    host.send(ling::Request::ReadStroke);
    assert_eq!(host.receive(&ling(4, 0x0E, &[0xFE])), ["Echo"]);
    assert!(!host.client.is_idle());
}

#[test]
fn unacceptable_answer_spares_requests_without_answer() {
    let mut host = Host::<Ling, LING>::new();
    host.client.submit(&ling::Request::SetStroke(Stroke::Mm100)).unwrap();
    assert_eq!(host.client.poll(host.now), Output::Receive);
    host.client.received(host.now, 0).unwrap();
    assert!(matches!(host.client.poll(host.now), Output::Transmit(_)));
    host.client.transmitted(host.now, 3).unwrap();
    assert_eq!(host.receive(&ling(4, 2, &[3])), ["unknown"]);
    assert_eq!(host.transmit(), 4);
    assert_eq!(host.receive(&[]), ["Sent"]);
}

#[test]
fn unacceptable_answer_before_transmission_ends_nothing() {
    let mut host = Host::<Ling, LING>::new();
    host.client.submit(&ling::Request::ReadStroke).unwrap();
    assert_eq!(host.receive(&ling(4, 0x0E, &[3])), ["unknown"]);
    assert_eq!(host.transmit(), 7);
}

#[test]
fn late_unacceptable_answer_spares_the_next_request() {
    let mut host = Host::<Ling, LING>::new();
    host.send(ling::Request::ReadStroke);
    host.client.cancel();
    host.client.submit(&ling::Request::ReadStroke).unwrap();
    assert_eq!(host.transmit(), 7, "a fence");
    assert_eq!(host.receive(&ling(4, 0x0E, &[3])), ["unknown"]);
    assert_eq!(host.transmit(), 7, "nothing else can be late");
    assert_eq!(host.receive(&ling(4, 0x0E, &[1])), ["Answer(Stroke(Mm75))"]);
}

#[test]
fn acceptable_answer_is_still_an_answer() {
    let mut host = Host::<Ling, LING>::new();
    host.send(ling::Request::SelfCheck);
    assert_eq!(
        host.receive(&ling(0xFE, 0, &[0xFF, 0x03])),
        ["Answer(SelfCheck(SelfCheck(1023)))"]
    );
    let mut host = Host::<Alpha1, ALPHA1>::new();
    host.send(alpha1::Request::Stop);
    assert_eq!(host.receive(&alpha1(0xF2, &[0xAA])), ["Answer(Stopped(Success))"]);
}

#[test]
fn version_of_any_length_is_an_answer() {
    for len in [1, 30, 40, 41, 252] {
        let mut host = Host::<XArm, XARM>::new();
        host.send(xarm::Request::ReadVersion);
        let body = [&[1, 0][..], &vec![b'6'; len]].concat();
        assert!(host.receive(&xarm(1, &body))[0].starts_with("Answer("), "{len}");
    }
}
