//! An answer of a client is the arm's answer to this request, and not to an earlier one, even if answers are late within
//! the configured limits, lost or damaged.
#![no_main]

use core::num::NonZeroU32;

use armwire::dialect::Dialect;
use armwire::ling::{
    Info, JointState, Ling, MAX_FRAME, MotionStatus, PerServo, Request, Response, SerialNumber, Torque, Version,
};
use armwire::time::{Duration, Instant};
use armwire::{Client, Config, Event, Output};
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
    };
    let mut client = Client::<Ling, MAX_FRAME>::new(Ling, config);
    let mut now = Instant::ZERO;
    // The request in flight and the partly sent one, each with its tag. A partly sent request is completed.
    let mut flight: Option<(Request, u8)> = None;
    let mut going = None;
    let mut tags = 0..u8::MAX;
    let mut chunks: Vec<Chunk> = Vec::new();
    while !u.is_empty() {
        match u.int_in_range(0..=4)? {
            0 => {
                let request = *u.choose(&REQUESTS)?;
                let Some(tag) = tags.next() else { return Ok(()) };
                if client.submit(&request).is_ok() {
                    flight = Some((request, tag));
                }
            }
            1 => {
                client.cancel();
                flight = None;
            }
            2 => now += Duration::from_micros(u64::from(u.arbitrary::<u16>()?) * 4),
            3 => {
                if let Output::Timeout(Some(until)) = client.poll(now) {
                    now = until;
                }
            }
            _ => {
                let (n, fate): (u8, Fate) = u.arbitrary()?;
                let Output::Transmit(bytes) = client.poll(now) else {
                    continue;
                };
                let whole = usize::from(n) >= bytes.len();
                let len = bytes.len().min(n.into());
                client.transmitted(now, len).expect("it was given");
                going = going.or(flight.filter(|_| len > 0));
                if whole
                    && let Some((request, tag)) = going.take()
                    && let Some(response) = answer(&request, tag)
                {
                    let bytes = response_bytes(Ling, &response, None);
                    chunks.extend(arm_answer(&config, &request, bytes, now, fate));
                    chunks.sort_by_key(|(at, _)| *at);
                }
            }
        }
        // Bytes received before now are passed on before a transmission.
        while chunks.first().is_some_and(|(at, _)| *at <= now) {
            let (_, bytes) = chunks.remove(0);
            on_bytes(&mut client, now, &bytes, &mut flight);
        }
        on_bytes(&mut client, now, &[], &mut flight);
    }
    is_answered(&mut client, now);
    Ok(())
}

/// After any earlier exchange has ended, the next request is answered.
fn is_answered(client: &mut Client<Ling, MAX_FRAME>, mut now: Instant) {
    // The partly sent request is completed, and not answered.
    client.cancel();
    let mut flight = None;
    while let Output::Transmit(bytes) = client.poll(now) {
        let len = bytes.len();
        client.transmitted(now, len).expect("it was given");
    }
    client.idle();
    on_bytes(client, now, &[], &mut flight);

    let (request, tag) = (Request::ReadJoints, u8::MAX);
    client.submit(&request).expect("nothing is in flight");
    flight = Some((request, tag));
    // A missing answer may delay it.
    let len = loop {
        match client.poll(now) {
            Output::Transmit(bytes) => break bytes.len(),
            Output::Timeout(until) => now = until.expect("it is delayed for ever"),
            Output::Event(event) => panic!("{event:?} before it is sent"),
        }
    };
    client.transmitted(now, len).expect("it was given");
    let response = answer(&request, tag).expect("it has an answer");
    on_bytes(client, now, &response_bytes(Ling, &response, None), &mut flight);
    assert_eq!(flight, None, "the answer is not taken");
}

/// Receives bytes, and handles all events.
fn on_bytes(client: &mut Client<Ling, MAX_FRAME>, now: Instant, bytes: &[u8], flight: &mut Option<(Request, u8)>) {
    let mut rest = bytes;
    loop {
        rest = client.receive(now, rest);
        while let Output::Event(event) = client.poll(now) {
            match event {
                Event::Answer(response) => {
                    let (request, tag) = flight.take().expect("no request is in flight");
                    assert_eq!(Some(response), answer(&request, tag), "an answer to an earlier request");
                }
                Event::Sent | Event::TimedOut { .. } | Event::Unacceptable(_) | Event::ErrorFrame { .. } => {
                    *flight = None;
                }
                _ => {}
            }
        }
        if rest.is_empty() {
            return;
        }
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
