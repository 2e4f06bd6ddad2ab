//! Calls to the virtual sensor over a line with faults, in virtual time.

use std::collections::VecDeque;
use std::convert::Infallible;

use armwire::decoder::{Decoder, Kind};
use armwire::framing::Framing;
use armwire::messages::Messages;
use armwire::time::{Duration, Instant};
use armwire::{Cause, Client, Event, OutOfRange, Output, SubmitError};
use own_arm::call::{CONFIG, CallError, Port, SensorClient, read_angle};
use own_arm::sensor::{Angle, JOINTS, MAX_ANGLE, MAX_FRAME, Read, Sensor};
use own_arm::virtual_sensor::VirtualSensor;

/// A line with a virtual sensor at its end.
struct Line {
    sensor: VirtualSensor,
    now: Instant,
    /// The bytes for the host, and the times of their arrival.
    arriving: VecDeque<(Instant, u8)>,
    /// The number of requests that were sent.
    sends: u32,
    /// The most bytes of a read or a write.
    chunk: usize,
    /// The faults of the next answers, in order.
    faults: VecDeque<Fault>,
    echoes: bool,
    /// It reports more bytes than it was given.
    is_faulty: bool,
}

#[derive(Clone, Copy)]
enum Fault {
    Lost,
    /// The bits of this byte are inverted.
    Damaged(usize),
    Late(Duration),
}

const TENTHS: [u16; JOINTS as usize] = [0, 905, 1800, 2701, 3599, 1];

impl Line {
    fn new(faults: &[Fault]) -> Self {
        Self {
            sensor: VirtualSensor::new(TENTHS),
            now: Instant::ZERO,
            arriving: VecDeque::new(),
            sends: 0,
            chunk: 32,
            faults: faults.iter().copied().collect(),
            echoes: false,
            is_faulty: false,
        }
    }
}

impl Port for Line {
    type Error = Infallible;

    fn now(&self) -> Instant {
        self.now
    }

    fn write(&mut self, bytes: &[u8]) -> Result<usize, Infallible> {
        let bytes = &bytes[..bytes.len().min(self.chunk)];
        let Self {
            arriving, faults, now, ..
        } = self;
        if self.echoes {
            arriving.extend(bytes.iter().map(|byte| (*now, *byte)));
        }
        self.sensor.receive(bytes, |answer| {
            self.sends += 1;
            let (mut answer, mut at) = (answer.to_vec(), *now + Duration::from_millis(1));
            match faults.pop_front() {
                Some(Fault::Lost) => return,
                Some(Fault::Damaged(byte)) => answer[byte] = !answer[byte],
                Some(Fault::Late(delay)) => at += delay,
                None => {}
            }
            arriving.extend(answer.iter().map(|byte| (at, *byte)));
        });
        Ok(bytes.len() + usize::from(self.is_faulty))
    }

    fn read(&mut self, space: &mut [u8], until: Option<Instant>) -> Result<usize, Infallible> {
        let until = until.expect("a call always has a timeout");
        self.now = match self.arriving.front() {
            Some(&(at, _)) if at <= until => self.now.max(at),
            _ => self.now.max(until),
        };
        let there = self.arriving.iter().take_while(|(at, _)| *at <= self.now).count();
        let n = there.min(space.len()).min(self.chunk);
        for (to, (_, byte)) in space.iter_mut().zip(self.arriving.drain(..n)) {
            *to = byte;
        }
        Ok(n)
    }
}

fn client() -> SensorClient {
    Client::new(Sensor, CONFIG)
}

fn angle(joint: u8) -> Angle {
    let tenths = TENTHS[usize::from(joint) - 1];
    Angle { joint, tenths }
}

fn encoded(angle: Angle) -> Vec<u8> {
    let mut out = [0; MAX_FRAME];
    let n = Sensor.encode_response(&angle, None, &mut out).unwrap();
    out[..n].to_vec()
}

#[test]
fn angle_arrives_in_chunks_of_any_size() {
    for chunk in 1..=8 {
        let mut line = Line::new(&[]);
        line.chunk = chunk;
        for joint in 1..=JOINTS {
            assert_eq!(
                read_angle(&mut client(), &mut line, joint),
                Ok(angle(joint)),
                "chunks of {chunk}"
            );
        }
    }
}

#[test]
fn lost_answer_is_asked_for_again() {
    let mut line = Line::new(&[Fault::Lost]);
    assert_eq!(read_angle(&mut client(), &mut line, 2), Ok(angle(2)));
    assert_eq!(line.sends, 2);
}

#[test]
fn silent_sensor_ends_the_call() {
    let mut line = Line::new(&[Fault::Lost; 3]);
    assert_eq!(read_angle(&mut client(), &mut line, 2), Err(CallError::Silent));
    assert_eq!(line.sends, 3);
    assert!(line.now < Instant::ZERO + Duration::from_millis(20));
}

#[test]
fn answer_with_a_wrong_byte_is_no_answer() {
    for byte in 0..MAX_FRAME {
        let mut line = Line::new(&[Fault::Damaged(byte)]);
        assert_eq!(read_angle(&mut client(), &mut line, 2), Ok(angle(2)), "byte {byte}");
        assert_eq!(line.sends, 2, "byte {byte}");
    }
}

#[test]
fn late_answer_is_not_that_of_the_next_call() {
    let mut line = Line::new(&[Fault::Late(Duration::from_millis(40)); 3]);
    let mut client = client();
    assert_eq!(read_angle(&mut client, &mut line, 2), Err(CallError::Silent));
    line.sensor.tenths[1] = 1234;
    assert_eq!(
        read_angle(&mut client, &mut line, 2),
        Ok(Angle { joint: 2, tenths: 1234 })
    );
}

#[test]
fn echo_is_no_answer() {
    let mut line = Line::new(&[]);
    line.echoes = true;
    assert_eq!(read_angle(&mut client(), &mut line, 3), Ok(angle(3)));
    assert_eq!(line.sends, 1);
}

#[test]
fn echo_is_reported() {
    let (mut client, now) = (client(), Instant::ZERO);
    client.submit(&Read { joint: 3 }).unwrap();
    assert_eq!(client.poll(now), Output::Receive);
    client.received(now, 0).unwrap();
    let Output::Transmit(request) = client.poll(now) else {
        panic!("nothing to transmit");
    };
    let request = request.to_vec();
    client.transmitted(now, request.len()).unwrap();
    assert!(client.receive(now, &request).is_empty());
    assert_eq!(client.poll(now), Output::Event(Event::Echo));
}

#[test]
fn faulty_port_ends_only_its_call() {
    let (mut line, mut client) = (Line::new(&[]), client());
    line.is_faulty = true;
    assert_eq!(read_angle(&mut client, &mut line, 3), Err(CallError::Overrun));
    line.is_faulty = false;
    assert_eq!(read_angle(&mut client, &mut line, 4), Ok(angle(4)));
}

#[test]
fn impossible_values_are_errors() {
    let mut line = Line::new(&[]);
    let error = OutOfRange::new("joint", "", 7, 1, 6);
    let refused = CallError::Refused(SubmitError::OutOfRange(error));
    assert_eq!(read_angle(&mut client(), &mut line, 7), Err(refused));
    assert_eq!(line.sends, 0);

    line.sensor.tenths[0] = MAX_ANGLE + 1;
    let Err(CallError::Unacceptable(error)) = read_angle(&mut client(), &mut line, 1) else {
        panic!("an angle of 360 degrees");
    };
    assert!(matches!(error.cause, Cause::Value { offset: 0, .. }));
    let text = "command 01: angle is 3600 tenths of a degree, must be 0..=3599 (data byte 0)";
    assert_eq!(error.to_string(), text);
}

/// The void of the protocol: zeros behind a cut request complete no frame, and leave nothing of it.
#[test]
fn cut_request_is_never_executed() {
    for joint in 1..=JOINTS {
        let mut request = [0; MAX_FRAME];
        let n = Sensor.encode_request(&Read { joint }, &mut request).unwrap();
        for cut in 1..n {
            let mut decoder = Decoder::<Sensor, 32>::new();
            let bytes = [&request[..cut], &[0; Sensor::VOID.unwrap()]].concat();
            assert!(decoder.push(&bytes).is_empty());
            while let Some(item) = decoder.next(&Sensor, ()) {
                assert!(matches!(item.kind, Kind::Noise(_)), "joint {joint}, cut at {cut}");
            }
            assert_eq!(decoder.window(), [], "joint {joint}, cut at {cut}");
        }
    }
}

/// Random bytes among answers: each byte comes out once, and no answer is lost.
#[test]
fn every_byte_is_accounted_for() {
    let mut random = 1_u32;
    let mut next = move || {
        random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (random >> 24) as u8
    };
    for _ in 0..1_000 {
        let noise: Vec<u8> = (0..next() % 20).map(|_| next()).collect();
        // Zeros end a false header, which could take the answer for its data.
        let line = [&noise[..], &[0; MAX_FRAME], &encoded(angle(2))].concat();
        let mut decoder = Decoder::<Sensor, 32>::new();
        let (mut out, mut last) = (Vec::<u8>::new(), None);
        for chunk in line.chunks(1 + usize::from(next() % 8)) {
            assert!(decoder.push(chunk).is_empty());
            while let Some(item) = decoder.next(&Sensor, ()) {
                assert_eq!(item.offset, out.len() as u64);
                out.extend(item.bytes);
                last = Some((item.kind, Sensor.parse_response(item.bytes, ())));
            }
        }
        assert_eq!(out, line);
        assert_eq!(last, Some((Kind::Frame, Ok(angle(2)))));
    }
}

#[test]
fn texts_have_values_with_units() {
    assert_eq!(Read { joint: 2 }.to_string(), "read joint 2");
    assert_eq!(angle(2).to_string(), "joint 2 at 90.5°");
}
