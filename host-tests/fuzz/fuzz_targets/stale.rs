//! An answer of a client is the arm's answer to this request, and not to an earlier one, even if answers are late by any
//! time, unread, lost or damaged, as long as they keep their order. Its state is no older than stated. On a line that loses
//! most fences time counts instead of the order. Each answer counts once. The arm executes no request after its end.
#![no_main]

use core::num::NonZeroU32;

use armwire::correlation::Correlation;
use armwire::framing::LONGEST_VOID;
use armwire::ling::{
    Info, JointState, Ling, MAX_FRAME, MotionStatus, PerServo, Request, Response, SerialNumber, Stroke, Torque, Version,
};
use armwire::messages::Messages;
use armwire::time::{Duration, Instant};
use armwire::{Client, Config, Device, DeviceEvent, Event, Output};
use armwire_fuzz::{Arbitrary, Result, Unstructured, request_bytes, response_bytes};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|input: &[u8]| {
    // A short input is skipped.
    let _ = check(&mut Unstructured::new(input));
});

const READINGS: [Request; 4] = [
    Request::ReadJoints,
    Request::ReadVelocities,
    Request::ReadTemperatures,
    Request::ReadInfo,
];

/// The tag of the last request but two.
const LAST_TAG: u8 = 252;
/// The tag of the answers to fences.
const FENCE_TAG: u8 = 255;

/// The time by which a state may be older than stated: 10 ms, and 1 µs for each earlier answer that would be stated then.
const PROMPT: Duration = Duration::from_micros(10_000 + 100);

/// Bytes of the arm, with their time.
type Chunk = (Instant, Vec<u8>);

/// The fate of an answer.
#[derive(Arbitrary)]
enum Fate {
    /// The answer arrives after this number of 65536ths of ten times its time limit, and after those before it.
    After(u16),
    /// The answer arrives in two chunks, the first this number of microseconds before the second.
    InTwo(u16, u8),
    Damaged(u16),
    Lost,
}

/// The answer that identifies its request. Halves of two answers never have a valid checksum: the tag is in one byte.
fn answer(request: &Request, tag: u8) -> Option<Response> {
    let ticks = [tag.into(), 0, 0, 0, 0, 0];
    Some(match request {
        Request::ReadJoints => Response::Joints(JointState {
            joints: ticks,
            gripper: 0,
            status: MotionStatus::Idle,
        }),
        Request::ReadVelocities => Response::Velocities(PerServo::Leader(ticks)),
        Request::ReadTemperatures => Response::Temperatures(PerServo::Leader([tag, 0, 0, 0, 0, 0])),
        Request::ReadInfo => Response::Info(Info {
            serial: SerialNumber([0; 16]),
            hardware: Version(tag.into()),
            firmware: Version(tag.into()),
        }),
        Request::ReadStroke => Response::Stroke(Stroke::Mm50),
        _ => return None,
    })
}

fn check(u: &mut Unstructured<'_>) -> Result<()> {
    let config = Config {
        baud: *u.choose(&[115_200, 1_000_000, 0].map(NonZeroU32::new))?,
        latency: Duration::from_micros(u.int_in_range(0..=20_000)?),
        repeats: u.int_in_range(0..=3)?,
        stale_window: Duration::from_micros(u.int_in_range(0..=100_000)?),
        ..Config::DEFAULT
    };
    let mut world = World::new(config);
    // The arm shows that it answers fences: until then, time counts.
    world.answer(0, true);
    let mut tags = 1..=LAST_TAG;
    while !u.is_empty() {
        match u.int_in_range(0..=6)? {
            kind @ (0 | 6) => {
                let request = match u.int_in_range(0..=READINGS.len())? {
                    0 => Request::SetTorque(Torque::Off),
                    n => READINGS[n - 1],
                };
                let Some(tag) = tags.next() else { return Ok(()) };
                world.submit(request, tag, kind == 6 && READINGS.contains(&request));
            }
            1 => world.cancel(),
            2 => world.wait(world.now + Duration::from_micros(u64::from(u.arbitrary::<u16>()?) * 4)),
            3 => world.wait_until_due(),
            4 => world.read(u.arbitrary::<u8>()?.into()),
            _ => {
                let (n, fate): (u8, Fate) = u.arbitrary()?;
                world.transmit(n.into(), fate);
            }
        }
    }
    world.answer_next();
    Ok(())
}

/// A request in flight.
struct Flight {
    request: Request,
    tag: u8,
    /// The number of sent bytes of its current transmission.
    part: usize,
    /// The port was read for it: it goes out next.
    is_next: bool,
}

/// An intact answer of the arm, with its state at this time.
struct Answer {
    response: Response,
    sampled: Instant,
}

/// A host, its port, and an arm.
struct World {
    config: Config,
    client: Client<Ling, MAX_FRAME>,
    now: Instant,
    flight: Option<Flight>,
    /// The zeros still due after a part of a request that has ended.
    void: usize,
    /// The number of sent bytes of the present fence.
    fence: usize,
    arm: Device<Ling, MAX_FRAME>,
    /// Bytes of the arm that have not arrived.
    chunks: Vec<Chunk>,
    /// Bytes that have arrived and were not read.
    port: Vec<u8>,
    /// The answers that the client has not reported, in the order of their arrival.
    answers: Vec<Answer>,
    /// The number of requests that were answered.
    answered: usize,
}

impl World {
    fn new(config: Config) -> Self {
        Self {
            config,
            client: Client::new(Ling, config),
            now: Instant::ZERO,
            flight: None,
            void: 0,
            fence: 0,
            arm: Device::new(Ling),
            chunks: Vec::new(),
            port: Vec::new(),
            answers: Vec::new(),
            answered: 0,
        }
    }

    fn submit(&mut self, request: Request, tag: u8, is_reading: bool) {
        let submitted = match is_reading {
            true => self.client.submit_reading(&request),
            false => self.client.submit(&request),
        };
        assert_eq!(submitted.is_ok(), self.flight.is_none());
        if submitted.is_ok() {
            self.flight = Some(Flight {
                request,
                tag,
                part: 0,
                is_next: false,
            });
        }
        self.take_events();
    }

    fn cancel(&mut self) {
        self.client.cancel();
        self.end();
    }

    /// The request in flight has ended.
    fn end(&mut self) -> Option<Flight> {
        let flight = self.flight.take()?;
        if flight.part > 0 {
            self.void = LONGEST_VOID;
        }
        Some(flight)
    }

    fn wait(&mut self, until: Instant) {
        self.now = self.now.max(until);
        while self.chunks.first().is_some_and(|(at, _)| *at <= self.now) {
            self.port.extend(self.chunks.remove(0).1);
        }
        self.take_events();
    }

    fn wait_until_due(&mut self) {
        if let Output::Timeout(Some(until)) = self.client.poll(self.now) {
            self.wait(until);
        }
    }

    /// Reads at most `n` bytes, at least one if there is one. Only an empty port is reported as empty.
    fn read(&mut self, n: usize) {
        let n = n.clamp(1, MAX_FRAME).min(self.port.len());
        let rest = self.client.receive(self.now, &self.port[..n]).len();
        self.port.drain(..n - rest);
        self.take_events();
    }

    /// Reads the port if the client asks for that. Otherwise the port accepts `n` bytes, and the arm answers.
    fn transmit(&mut self, n: usize, fate: Fate) {
        let bytes = match self.client.poll(self.now) {
            Output::Receive => return self.read(n),
            Output::Transmit(bytes) => bytes,
            Output::Event(_) | Output::Timeout(_) => return,
        };
        let n = n.min(bytes.len());
        let all = bytes.to_vec();
        let mut sent = &all[..n];
        self.client.transmitted(self.now, n).expect("it was given");
        let flight = self.flight.as_mut().filter(|flight| flight.is_next);
        let mut is_fence = false;
        if self.void > 0 {
            assert!(sent.iter().all(|byte| *byte == 0), "no void: {sent:02X?}");
            self.void = self.void.checked_sub(n).expect("the void is too long");
        } else if let Some(flight) = flight {
            let frame = request_bytes(Ling, &flight.request);
            assert_eq!(sent, &frame[flight.part..][..n]);
            flight.part = (flight.part + n) % frame.len();
        } else {
            let fences = Ling::FENCES.iter();
            let mut rests = fences.map(|frame| &frame[self.fence..]);
            assert!(rests.any(|rest| rest == all), "no fence: {all:02X?}");
            self.fence = (self.fence + n) % (self.fence + all.len());
            is_fence = true;
        }
        let mut fate = Some(fate);
        while !sent.is_empty() {
            sent = self.arm.receive(sent);
            while let Some(event) = self.arm.poll() {
                let DeviceEvent::Request { request, .. } = event else {
                    continue;
                };
                let tag = match &self.flight {
                    _ if is_fence => FENCE_TAG,
                    Some(flight) if flight.request == request => flight.tag,
                    _ => panic!("a request is executed after its end"),
                };
                if let (Some(response), Some(fate)) = (answer(&request, tag), fate.take()) {
                    let bytes = response_bytes(Ling, &response, None);
                    if !matches!(fate, Fate::Damaged(_) | Fate::Lost) {
                        let sampled = self.now;
                        self.answers.push(Answer { response, sampled });
                    }
                    let chunks = arm_answer(&self.config, &request, bytes, self.now, fate);
                    // They keep their order.
                    let before = self.chunks.last().map_or(Instant::ZERO, |(at, _)| *at);
                    self.chunks
                        .extend(chunks.into_iter().map(|(at, bytes)| (at.max(before), bytes)));
                }
            }
        }
        self.wait(self.now);
    }

    fn take_events(&mut self) {
        loop {
            let event = match self.client.poll(self.now) {
                Output::Event(event) => event,
                Output::Receive => {
                    self.flight.as_mut().expect("no request is in flight").is_next = true;
                    return;
                }
                Output::Transmit(_) | Output::Timeout(_) => return,
            };
            match event {
                Event::Answer(response) => {
                    let stated = self.client.time_of_state().expect("it is an answer");
                    let flight = self.end().expect("no request is in flight");
                    self.answered += 1;
                    let sampled = self.report(response);
                    if self.client.has_fences() {
                        assert_eq!(
                            Some(response),
                            answer(&flight.request, flight.tag),
                            "an answer to an earlier request"
                        );
                        assert!(
                            stated.since(sampled) <= PROMPT,
                            "sampled at {sampled:?}, stated {stated:?}"
                        );
                    }
                }
                Event::Late(response) => {
                    let stated = self.client.time_of_state().expect("it is an answer");
                    let sampled = self.report(response);
                    assert!(
                        stated.since(sampled) <= PROMPT || !self.client.has_fences(),
                        "sampled at {sampled:?}, stated {stated:?}"
                    );
                }
                Event::Unsolicited(response) => {
                    self.report(response);
                }
                Event::Sent | Event::TimedOut { .. } | Event::Unacceptable(_) | Event::ErrorFrame { .. } => {
                    self.end().expect("no request is in flight");
                }
                _ => {}
            }
        }
    }

    /// The client reports an answer. Returns the time of its state. Repeats have equal answers: it is that of the last then,
    /// and the first counts as reported.
    fn report(&mut self, response: Response) -> Instant {
        let equal = |answer: &&Answer| answer.response == response;
        let last = self.answers.iter().rfind(equal).map(|answer| answer.sampled);
        if let Some(first) = self.answers.iter().position(|answer| equal(&answer)) {
            self.answers.remove(first);
        }
        last.expect("an answer that the arm has not sent, or a second time")
    }

    /// After any earlier exchange has ended, the next reading and the next request are answered.
    fn answer_next(mut self) {
        self.cancel();
        // Nothing of the past arrives any more.
        self.chunks.clear();
        self.client.idle();
        self.take_events();
        self.answer(LAST_TAG + 1, true);
        self.answer(LAST_TAG + 2, false);
    }

    /// A reading, or another request, is answered.
    fn answer(&mut self, tag: u8, is_reading: bool) {
        let answered = self.answered;
        // Zeros, fences, and missing answers, may delay it. It is given up while earlier answers may arrive.
        for _ in 0..10_000 {
            if self.answered > answered {
                break;
            }
            if self.flight.is_none() {
                self.submit(Request::ReadJoints, tag, is_reading);
            }
            match self.client.poll(self.now) {
                Output::Receive | Output::Transmit(_) => self.transmit(usize::MAX, Fate::After(0)),
                Output::Timeout(until) if self.port.is_empty() => self.wait(until.expect("it is delayed for ever")),
                Output::Timeout(_) => self.read(usize::MAX),
                Output::Event(event) => panic!("{event:?} was not taken"),
            }
        }
        assert_eq!(self.answered, answered + 1, "it is not answered");
    }
}

/// Chunks of an answer, with their times: before the client may take the answer for lost.
fn arm_answer(config: &Config, request: &Request, mut bytes: Vec<u8>, sent: Instant, fate: Fate) -> Vec<Chunk> {
    let info = Ling.request(&request_bytes(Ling, request)).expect("it is a request");
    let turnaround = info.response.expect("it is answered").turnaround;
    let most = 10 * (turnaround + config.latency + config.stale_window).as_micros();
    let after = |part: u16| sent + Duration::from_micros(most * u64::from(part) / 65_536);
    match fate {
        Fate::Lost => Vec::new(),
        Fate::After(part) => vec![(after(part), bytes)],
        Fate::InTwo(part, gap) => {
            let end = after(part);
            let rest = bytes.split_off(bytes.len() / 2);
            let start = Instant::from_micros(end.as_micros().saturating_sub(gap.into()).max(sent.as_micros()));
            vec![(start, bytes), (end, rest)]
        }
        Fate::Damaged(part) => {
            bytes[6] ^= 1;
            vec![(after(part), bytes)]
        }
    }
}
