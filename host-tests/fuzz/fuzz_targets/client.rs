//! Whatever comes whenever: each request ends once, in a way that fits it; what goes out is the request's bytes and
//! nothing else; and time alone ends what nothing else does.
#![no_main]

use armwire::{Busy, Client, Config, Event, Input, Micros};
use armwire_fuzz::{Arbitrary, Check, Result, Subject, Unstructured, check, request_bytes, response_bytes};
use libfuzzer_sys::fuzz_target;
use std::num::NonZeroU32;

fuzz_target!(|input: &[u8]| check::<Talks>(input));

#[derive(Arbitrary)]
enum Step<'a> {
    Submit,
    Cancel,
    /// So many bytes of what there is to transmit go out; the last of them too if there are not so many.
    Transmit(u8),
    TransmitAll,
    Bytes(&'a [u8]),
    Response,
    Echo,
    Idle,
    Wait(u16),
    WaitUntilDue,
}

struct Talks;

impl Check for Talks {
    fn check<P: Subject, const N: usize>(u: &mut Unstructured<'_>) -> Result<()> {
        let config = Config {
            baud: *u.choose(&[115_200, 1_000_000, u32::MAX, 1].map(|baud| NonZeroU32::new(baud).expect("not 0")))?,
            latency: Micros(u.int_in_range(0..=20_000)?),
            repeats: u.int_in_range(0..=3)?,
            lateness: Micros(u.int_in_range(0..=100_000)?),
        };
        let mut world = World::<P, N>::new(config);
        while !u.is_empty() {
            match u.arbitrary()? {
                Step::Submit => world.submit(P::any_request(u)?),
                Step::Cancel => world.cancel(),
                Step::Transmit(n) => world.transmit(n.into()),
                Step::TransmitAll => world.transmit(N),
                Step::Bytes(bytes) => world.hear(Input::Bytes(bytes)),
                Step::Response => world.hear(Input::Bytes(&response_bytes::<P>(&P::any_response(u)?.0))),
                Step::Echo => world.hear(Input::Bytes(&request_bytes::<P>(&P::any_request(u)?))),
                Step::Idle => world.hear(Input::Idle),
                Step::Wait(micros) => world.wait(world.now + Micros(u64::from(micros) * 16)),
                Step::WaitUntilDue => world.wait(world.client.poll_timeout().unwrap_or(world.now)),
            }
            assert_eq!(world.client.is_idle(), world.flight.is_none());
        }
        world.end();
        Ok(())
    }
}

/// The request that is in flight, as far as it has got.
struct Flight<P: Subject> {
    request: P::Request,
    /// How often all of it went out, and when it last did.
    sends: u8,
    sent: Micros,
}

struct World<P: Subject, const N: usize> {
    client: Client<P, N>,
    config: Config,
    now: Micros,
    flight: Option<Flight<P>>,
    /// What is going out, how much of it has, and whether it is for the request that is in flight.
    line: Vec<u8>,
    out: usize,
    of_flight: bool,
    broken: bool,
    /// The longest time that an arm may take for one of the requests so far.
    turnaround: Micros,
}

impl<P: Subject, const N: usize> World<P, N> {
    fn new(config: Config) -> Self {
        Self {
            client: Client::new(config),
            config,
            now: Micros(0),
            flight: None,
            line: Vec::new(),
            out: 0,
            of_flight: false,
            broken: false,
            turnaround: Micros(0),
        }
    }

    fn submit(&mut self, request: P::Request) {
        let submitted = self.client.submit(request);
        if self.flight.is_some() {
            assert_eq!(submitted, Err(Busy(request)));
            assert!(!Busy(request).to_string().is_empty() && !format!("{:?}", self.client).is_empty());
            return;
        }
        assert_eq!(submitted, Ok(()));
        let turnaround = P::reply(&request).map_or(Micros(0), |reply| reply.turnaround);
        self.turnaround = self.turnaround.max(turnaround);
        self.flight = Some(Flight {
            request,
            sends: 0,
            sent: Micros(0),
        });
    }

    fn cancel(&mut self) {
        self.client.cancel(self.now);
        self.flight = None;
        // What was begun goes out whole, and so does a repeat of a request that was answered meanwhile.
        if self.of_flight && self.out == 0 {
            self.line.clear();
        }
        self.of_flight = false;
    }

    fn transmit(&mut self, n: usize) {
        let Some(bytes) = self.client.poll_transmit(self.now) else {
            return;
        };
        assert!(!self.broken, "something is sent on a broken line");
        if self.line.is_empty() {
            let flight = self.flight.as_ref().expect("something is sent that nobody asked for");
            self.line = request_bytes::<P>(&flight.request);
            self.of_flight = true;
        }
        assert_eq!(bytes, &self.line[self.out..]);
        let n = n.min(bytes.len());
        self.client.transmitted(self.now, n).expect("no more than there is");
        self.out += n;
        if self.out < self.line.len() {
            return;
        }
        self.line.clear();
        self.out = 0;
        if let Some(flight) = self.flight.as_mut().filter(|_| self.of_flight) {
            flight.sends += 1;
            flight.sent = self.now;
        }
        self.of_flight = false;
    }

    fn hear(&mut self, mut input: Input<'_>) {
        while let Some(event) = self.client.handle(self.now, &mut input) {
            assert!(!format!("{event:?}").is_empty());
            self.place(event);
        }
        assert!(
            !matches!(input, Input::Bytes([_, ..])) || self.broken,
            "it is not taken"
        );
    }

    fn place(&mut self, event: Event<P>) {
        match event {
            Event::Answer(response) => {
                let flight = self.flight.take().expect("nothing was asked");
                assert!(P::answers(&flight.request, &P::response_ref(&response)));
                assert!(flight.sends > 0, "answered before it was sent");
                // If it was being sent again, the rest of it still goes out.
                self.of_flight = false;
            }
            Event::Unacceptable(error) => {
                let flight = self.flight.take().expect("nothing was asked");
                assert!(P::reply(&flight.request).is_some(), "it is not answered");
                assert!(flight.sends > 0, "answered before it was sent");
                assert!(!error.to_string().is_empty());
                self.of_flight = false;
            }
            Event::Sent => {
                let flight = self.flight.take().expect("nothing was asked");
                assert_eq!((P::reply(&flight.request), flight.sends), (None, 1));
            }
            Event::TimedOut { sends } => {
                let flight = self.flight.take().expect("nothing was asked");
                let reply = P::reply(&flight.request).expect("it is not answered");
                assert_eq!(sends, flight.sends);
                let most = if P::repeatable(&flight.request) {
                    self.config.repeats
                } else {
                    0
                };
                assert_eq!(
                    sends,
                    most + 1,
                    "given up before it was repeated, or repeated too often"
                );
                assert!(
                    flight.sent + reply.turnaround + self.config.latency <= self.now,
                    "too soon"
                );
            }
            Event::Broken(_) => {
                assert!(P::RELIABLE);
                (self.flight, self.broken) = (None, true);
                self.line.clear();
                (self.out, self.of_flight) = (0, false);
            }
            Event::Noise(noise) => assert!(noise.len > 0),
            // They end nothing.
            Event::Late(response) | Event::Unsolicited(response) => assert!(!format!("{response:?}").is_empty()),
            Event::Echo | Event::Unknown(_) => {}
        }
    }

    fn wait(&mut self, until: Micros) {
        self.now = self.now.max(until);
        self.hear(Input::Tick);
    }

    /// Nothing comes any more: what is in flight ends, within the time that the configuration gives it.
    fn end(mut self) {
        let end = self.now + self.longest();
        // Each is sent, falls due, and may be given a little more time; noise that is waited for ends as well.
        for _ in 0..6 * (u32::from(self.config.repeats) + 2) {
            self.transmit(N);
            match self.client.poll_timeout() {
                Some(due) => self.wait(due),
                None => self.hear(Input::Tick),
            }
        }
        assert!(
            self.flight.is_none() && self.client.is_idle(),
            "{:?} does not end",
            self.client
        );
        assert_eq!(self.client.poll_transmit(self.now), None);
        assert_eq!(self.client.poll_timeout(), None);
        assert!(
            self.now <= end,
            "{:?} is over at {:?}, not by {end:?}",
            self.client,
            self.now
        );
    }

    /// The time after which all is over: the answer to an earlier request is late, and then each send of this one falls due, a
    /// frame that has begun included.
    fn longest(&self) -> Micros {
        let frame = N as u64 * 10_000_000 / u64::from(self.config.baud.get());
        let answer = self.turnaround.0 + self.config.latency.0 + 3 * frame;
        // Each of these times may be rounded up.
        let rounding = 100;
        Micros((u64::from(self.config.repeats) + 2) * answer + 2 * self.config.lateness.0 + rounding)
    }
}
