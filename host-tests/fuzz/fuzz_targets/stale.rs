//! An answer of a client is the arm's answer to this request, and not to an earlier one, even if answers are late within
//! the configured limits, unread, lost or damaged. The arm executes no request after its end.
#![no_main]

use core::num::NonZeroU32;

use armwire::correlation::Correlation;
use armwire::framing::Framing;
use armwire::ling::{
    Info, JointState, Ling, MAX_FRAME, MotionStatus, PerServo, Request, Response, SerialNumber, Torque, Version,
};
use armwire::time::{Duration, Instant};
use armwire::{Client, Config, Device, DeviceEvent, Event, Output};
use armwire_fuzz::{Arbitrary, Result, Unstructured, request_bytes, response_bytes};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|input: &[u8]| {
    // A short input is skipped.
    let _ = check(&mut Unstructured::new(input));
});

const REQUESTS: [Request; 5] = [
    Request::ReadJoints,
    Request::ReadVelocities,
    Request::ReadTemperatures,
    Request::ReadInfo,
    Request::SetTorque(Torque::Off),
];

/// Bytes of the arm, with their time.
type Chunk = (Instant, Vec<u8>);

/// The fate of an answer.
#[derive(Arbitrary)]
enum Fate {
    /// The answer arrives after this number of 65536ths of its time limit.
    After(u16),
    /// The answer arrives in two chunks, the first this number of microseconds before the second.
    InTwo(u16, u8),
    Damaged(u16),
    Lost,
}

/// The answer that identifies its request.
fn answer(request: &Request, tag: u8) -> Option<Response> {
    Some(match request {
        Request::ReadJoints => Response::Joints(JointState {
            joints: [tag.into(); 6],
            gripper: 0,
            status: MotionStatus::Idle,
        }),
        Request::ReadVelocities => Response::Velocities(PerServo::Leader([tag.into(); 6])),
        Request::ReadTemperatures => Response::Temperatures(PerServo::Leader([tag; 6])),
        Request::ReadInfo => Response::Info(Info {
            serial: SerialNumber([0; 16]),
            hardware: Version(tag.into()),
            firmware: Version(tag.into()),
        }),
        _ => return None,
    })
}

fn check(u: &mut Unstructured<'_>) -> Result<()> {
    let config = Config {
        baud: *u.choose(&[115_200, 1_000_000, u32::MAX].map(|baud| NonZeroU32::new(baud).expect("not 0")))?,
        latency: Duration::from_micros(u.int_in_range(0..=20_000)?),
        repeats: u.int_in_range(0..=3)?,
        stale_window: Duration::from_micros(u.int_in_range(0..=100_000)?),
        ..Config::DEFAULT
    };
    let mut world = World::new(config);
    let mut tags = 0..u8::MAX;
    while !u.is_empty() {
        match u.int_in_range(0..=5)? {
            0 => {
                let request = *u.choose(&REQUESTS)?;
                let Some(tag) = tags.next() else { return Ok(()) };
                world.submit(request, tag);
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

/// A host, its port, and an arm.
struct World {
    config: Config,
    client: Client<Ling, MAX_FRAME>,
    now: Instant,
    /// The request in flight, its tag, and the number of sent bytes of its current transmission.
    flight: Option<(Request, u8, usize)>,
    /// The zeros still due after a part of a request that has ended.
    void: usize,
    arm: Device<Ling, MAX_FRAME>,
    /// Bytes of the arm that have not arrived.
    chunks: Vec<Chunk>,
    /// Bytes that have arrived and were not read.
    port: Vec<u8>,
}

impl World {
    fn new(config: Config) -> Self {
        Self {
            config,
            client: Client::new(Ling, config),
            now: Instant::ZERO,
            flight: None,
            void: 0,
            arm: Device::new(Ling),
            chunks: Vec::new(),
            port: Vec::new(),
        }
    }

    fn submit(&mut self, request: Request, tag: u8) {
        let submitted = self.client.submit(&request);
        assert_eq!(submitted.is_ok(), self.flight.is_none());
        if submitted.is_ok() {
            self.flight = Some((request, tag, 0));
        }
        self.take_events();
    }

    fn cancel(&mut self) {
        self.client.cancel();
        self.end();
    }

    /// The request in flight has ended.
    fn end(&mut self) -> Option<(Request, u8)> {
        let (request, tag, part) = self.flight.take()?;
        if part > 0 {
            self.void = Ling::LONGEST;
        }
        Some((request, tag))
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
        let mut sent = &bytes.to_vec()[..n];
        self.client.transmitted(self.now, n).expect("it was given");
        if self.void > 0 {
            assert!(sent.iter().all(|byte| *byte == 0), "no void: {sent:02X?}");
            self.void = self.void.checked_sub(n).expect("the void is too long");
        } else {
            let (request, _, part) = self.flight.as_mut().expect("no request is in flight");
            let frame = request_bytes(Ling, request);
            assert_eq!(sent, &frame[*part..][..n]);
            *part = (*part + n) % frame.len();
        }
        let mut fate = Some(fate);
        while !sent.is_empty() {
            sent = self.arm.receive(sent);
            while let Some(event) = self.arm.poll() {
                let DeviceEvent::Request { request, .. } = event else {
                    continue;
                };
                let (current, tag, _) = self.flight.expect("a request is executed after its end");
                assert_eq!(request, current, "a request is executed after its end");
                if let (Some(response), Some(fate)) = (answer(&request, tag), fate.take()) {
                    let bytes = response_bytes(Ling, &response, None);
                    self.chunks
                        .extend(arm_answer(&self.config, &request, bytes, self.now, fate));
                    self.chunks.sort_by_key(|(at, _)| *at);
                }
            }
        }
        self.wait(self.now);
    }

    fn take_events(&mut self) {
        while let Output::Event(event) = self.client.poll(self.now) {
            match event {
                Event::Answer(response) => {
                    let (request, tag) = self.end().expect("no request is in flight");
                    assert_eq!(Some(response), answer(&request, tag), "an answer to an earlier request");
                }
                Event::Sent | Event::TimedOut { .. } | Event::Unacceptable(_) | Event::ErrorFrame { .. } => {
                    self.end().expect("no request is in flight");
                }
                _ => {}
            }
        }
    }

    /// After any earlier exchange has ended, the next request is answered.
    fn answer_next(mut self) {
        self.cancel();
        // Nothing of the past arrives any more.
        self.chunks.clear();
        self.client.idle();
        self.take_events();
        self.submit(Request::ReadJoints, u8::MAX);
        // Zeros, and missing answers, may delay it.
        for _ in 0..10_000 {
            match self.client.poll(self.now) {
                Output::Receive | Output::Transmit(_) => self.transmit(usize::MAX, Fate::After(0)),
                Output::Timeout(until) if self.port.is_empty() => self.wait(until.expect("it is delayed for ever")),
                Output::Timeout(_) => self.read(usize::MAX),
                Output::Event(event) => panic!("{event:?} was not taken"),
            }
            if self.flight.is_none() {
                return;
            }
        }
        panic!("it does not end");
    }
}

/// Chunks of an answer, with their times: before the client may take the answer for lost.
fn arm_answer(config: &Config, request: &Request, mut bytes: Vec<u8>, sent: Instant, fate: Fate) -> Vec<Chunk> {
    let info = Ling.request(&request_bytes(Ling, request)).expect("it is a request");
    let turnaround = info.response.expect("it is answered").turnaround;
    let most = (turnaround + config.latency + config.stale_window).as_micros();
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
