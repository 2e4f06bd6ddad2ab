//! An answer that a client gives is that of the arm to this request, and to none before it, however late the arm answers
//! within what the configuration allows, and whatever of it is lost or damaged.
#![no_main]

use core::num::NonZeroU32;

use armwire::dialect::Dialect;
use armwire::ling::{
    Info, JointState, Ling, MAX_FRAME, MotionStatus, PerServo, Request, Response, SerialNumber, Torque, Version,
};
use armwire::messages::Messages;
use armwire::time::{Duration, Instant};
use armwire::{Client, Config, Event, Output};
use armwire_fuzz::{AnyResponse, Arbitrary, Result, Unstructured};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|input: &[u8]| {
    // Too short an input is none.
    let _ = check(&mut Unstructured::new(input));
});

const REQUESTS: [Request; 5] = [
    Request::ReadJoints,
    Request::ReadVelocities,
    Request::ReadTemperatures,
    Request::ReadInfo,
    Request::SetTorque(Torque::Off),
];

#[derive(Arbitrary)]
enum Step {
    Submit,
    Cancel,
    Wait(u16),
    WaitUntilDue,
    /// Up to this number of bytes is transmitted; and the arm's behaviour if the request is complete.
    Transmit(u8, Manner),
}

/// The fate of an answer.
#[derive(Arbitrary)]
enum Manner {
    /// The answer arrives after this number of 65536ths of its time limit.
    After(u16),
    /// The answer arrives in two pieces, the first this number of microseconds before the second.
    InTwo(u16, u8),
    Damaged(u16),
    Lost,
}

/// Names the request that an answer is to.
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
    // Bytes of the arm, with their times.
    let mut voice: Vec<(Instant, Vec<u8>)> = Vec::new();
    while !u.is_empty() {
        match u.arbitrary()? {
            Step::Submit => {
                let request = *u.choose(&REQUESTS)?;
                let Some(tag) = tags.next() else { return Ok(()) };
                if client.submit(&request).is_ok() {
                    flight = Some((request, tag));
                }
            }
            Step::Cancel => {
                client.cancel();
                flight = None;
            }
            Step::Wait(micros) => now += Duration::from_micros(u64::from(micros) * 4),
            Step::WaitUntilDue => {
                if let Output::Timeout(Some(until)) = client.poll(now) {
                    now = until;
                }
            }
            Step::Transmit(n, manner) => {
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
                    voice.extend(arm_answer(&config, &request, &response, now, &manner));
                    voice.sort_by_key(|(at, _)| *at);
                }
            }
        }
        // Bytes received before now are passed on before a transmission.
        while voice.first().is_some_and(|(at, _)| *at <= now) {
            let (_, bytes) = voice.remove(0);
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
    // An answer that is missing may hold it back.
    let len = loop {
        match client.poll(now) {
            Output::Transmit(bytes) => break bytes.len(),
            Output::Timeout(until) => now = until.expect("it is held back for ever"),
            Output::Event(event) => panic!("{event:?} before it is sent"),
        }
    };
    client.transmitted(now, len).expect("it was given");
    let response = answer(&request, tag).expect("it has an answer");
    on_bytes(client, now, &response_bytes(response), &mut flight);
    assert_eq!(flight, None, "the answer is not taken");
}

/// Hears bytes, and takes all that comes of them.
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
                Event::Sent | Event::TimedOut { .. } | Event::Unacceptable(_) => *flight = None,
                _ => {}
            }
        }
        if rest.is_empty() {
            return;
        }
    }
}

fn response_bytes(response: Response) -> Vec<u8> {
    let any = AnyResponse {
        response,
        to: None,
        expect: (),
    };
    armwire_fuzz::response_bytes(Ling, &any)
}

/// The pieces of an answer, and when each is there: before the client may take it for lost.
fn arm_answer(
    config: &Config,
    request: &Request,
    response: &Response,
    sent: Instant,
    manner: &Manner,
) -> Vec<(Instant, Vec<u8>)> {
    let mut bytes = response_bytes(*response);
    let mut request_bytes = [0; MAX_FRAME];
    let n = Ling.encode_request(request, &mut request_bytes).expect("there is room");
    let info = Ling.request(&request_bytes[..n]).and_then(|info| info.response);
    let turnaround = info.expect("it is answered").turnaround;
    let most = (turnaround + config.latency + config.stale_window).as_micros();
    let after = |part: u16| sent + Duration::from_micros(most * u64::from(part) / 65_536);
    match *manner {
        Manner::Lost => Vec::new(),
        Manner::After(part) => vec![(after(part), bytes)],
        Manner::InTwo(part, gap) => {
            let end = after(part);
            let rest = bytes.split_off(bytes.len() / 2);
            let start = Instant::from_micros(end.as_micros().saturating_sub(gap.into()).max(sent.as_micros()));
            vec![(start, bytes), (end, rest)]
        }
        Manner::Damaged(part) => {
            bytes[6] ^= 1;
            vec![(after(part), bytes)]
        }
    }
}
