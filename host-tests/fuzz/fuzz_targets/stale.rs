//! An answer that a client gives is that of the arm to this request, and to none before it, however late the arm answers
//! within what the configuration allows, and whatever of it is lost or damaged.
#![no_main]

use armwire::ling::{
    Info, JointState, Ling, MAX_FRAME, MotionStatus, PerServo, Request, Response, SerialNumber, Torque, Version,
};
use armwire::{Client, Config, Event, Input, Micros, Protocol};
use armwire_fuzz::{Arbitrary, Result, Unstructured, response_bytes};
use libfuzzer_sys::fuzz_target;
use std::num::NonZeroU32;

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
    /// So many bytes of what there is to transmit go out, and what the arm then makes of the request, if it is whole.
    Transmit(u8, Manner),
}

/// What becomes of an answer.
#[derive(Arbitrary)]
enum Manner {
    /// It comes after so many 65536ths of the time that it may take at most.
    After(u16),
    /// In two pieces, the first so many microseconds before the second.
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
        latency: Micros(u.int_in_range(0..=20_000)?),
        repeats: u.int_in_range(0..=3)?,
        lateness: Micros(u.int_in_range(0..=100_000)?),
    };
    let mut client = Client::<Ling, MAX_FRAME>::new(config);
    let mut now = Micros(0);
    // The request in flight and the one that is going out, each with its tag, and whether some of the latter is out.
    let mut flight: Option<(Request, u8)> = None;
    let mut going = None;
    let mut begun = false;
    let mut tags = 0..u8::MAX;
    // What the arm says, and when.
    let mut voice: Vec<(Micros, Vec<u8>)> = Vec::new();
    while !u.is_empty() {
        match u.arbitrary()? {
            Step::Submit => {
                let request = *u.choose(&REQUESTS)?;
                let Some(tag) = tags.next() else { return Ok(()) };
                if client.submit(request).is_ok() {
                    flight = Some((request, tag));
                }
            }
            Step::Cancel => {
                client.cancel(now);
                // What was begun goes out whole, and so does a repeat of a request that was answered meanwhile.
                going = going.filter(|_| begun || going != flight);
                flight = None;
            }
            Step::Wait(micros) => now = now + Micros(u64::from(micros) * 4),
            Step::WaitUntilDue => now = now.max(client.poll_timeout().unwrap_or(now)),
            Step::Transmit(n, manner) => {
                let Some(bytes) = client.poll_transmit(now) else {
                    continue;
                };
                let whole = usize::from(n) >= bytes.len();
                let len = bytes.len().min(n.into());
                client.transmitted(now, len).expect("no more than there is");
                going = going.or(flight);
                begun = !whole && (begun || len > 0);
                if whole
                    && let Some((request, tag)) = going.take()
                    && let Some(response) = answer(&request, tag)
                {
                    voice.extend(says(&config, &request, &response, now, &manner));
                    voice.sort_by_key(|(at, _)| *at);
                }
            }
        }
        // What came before now is handed in before anything goes out.
        while voice.first().is_some_and(|(at, _)| *at <= now) {
            let (_, bytes) = voice.remove(0);
            hear(&mut client, now, Input::Bytes(&bytes), &mut flight);
        }
        hear(&mut client, now, Input::Tick, &mut flight);
    }
    is_answered(&mut client, now);
    Ok(())
}

/// Whatever was before: once it is over, the next request is answered.
fn is_answered(client: &mut Client<Ling, MAX_FRAME>, mut now: Micros) {
    // The request that was begun goes out, and nobody answers any more.
    client.cancel(now);
    let mut flight = None;
    loop {
        if let Some(bytes) = client.poll_transmit(now) {
            let len = bytes.len();
            client.transmitted(now, len).expect("no more than there is");
        } else if let Some(due) = client.poll_timeout() {
            now = now.max(due);
            hear(client, now, Input::Tick, &mut flight);
        } else {
            break;
        }
    }
    hear(client, now, Input::Idle, &mut flight);

    let (request, tag) = (Request::ReadJoints, u8::MAX);
    client.submit(request).expect("nothing is in flight");
    flight = Some((request, tag));
    // An answer that is missing may hold it back.
    while client.poll_transmit(now).is_none() {
        let due = client.poll_timeout().expect("it is held back for ever");
        now = now.max(due);
        hear(client, now, Input::Tick, &mut flight);
        assert!(flight.is_some(), "it ends before it is sent");
    }
    let len = client.poll_transmit(now).expect("it is there").len();
    client.transmitted(now, len).expect("no more than there is");
    let response = answer(&request, tag).expect("it has an answer");
    hear(
        client,
        now,
        Input::Bytes(&response_bytes::<Ling>(&response)),
        &mut flight,
    );
    assert_eq!(flight, None, "the answer is not taken");
}

/// Gives an input until nothing comes of it any more.
fn hear(client: &mut Client<Ling, MAX_FRAME>, now: Micros, mut input: Input<'_>, flight: &mut Option<(Request, u8)>) {
    while let Some(event) = client.handle(now, &mut input) {
        match event {
            Event::Answer(response) => {
                let (request, tag) = flight.take().expect("nothing was asked");
                assert_eq!(Some(response), answer(&request, tag), "an answer to an earlier request");
            }
            Event::Sent | Event::TimedOut { .. } | Event::Unacceptable(_) => *flight = None,
            _ => {}
        }
    }
}

/// The pieces of an answer, and when each is there: before the client may take it for lost.
fn says(
    config: &Config,
    request: &Request,
    response: &Response,
    sent: Micros,
    manner: &Manner,
) -> Vec<(Micros, Vec<u8>)> {
    let mut bytes = response_bytes::<Ling>(response);
    let reply = Ling::reply(request).expect("it is answered");
    let most = (reply.turnaround + config.latency + config.lateness).0;
    let after = |part: u16| sent + Micros(most * u64::from(part) / 65_536);
    match *manner {
        Manner::Lost => Vec::new(),
        Manner::After(part) => vec![(after(part), bytes)],
        Manner::InTwo(part, gap) => {
            let end = after(part);
            let rest = bytes.split_off(bytes.len() / 2);
            let start = Micros(end.0.saturating_sub(gap.into()).max(sent.0));
            vec![(start, bytes), (end, rest)]
        }
        Manner::Damaged(part) => {
            bytes[6] ^= 1;
            vec![(after(part), bytes)]
        }
    }
}
