//! Any bytes at any time: each request ends once, with a fitting event. Only the request's bytes are sent. Time alone
//! ends every wait.
#![no_main]

use std::num::NonZeroU32;

use armwire::dialect::{Effect, InfoOf};
use armwire::time::{Duration, Instant};
use armwire::{Client, Config, Event, Output, SubmitError};
use armwire_fuzz::{
    AnyResponse, Arbitrary, Check, Result, Subject, Unstructured, check, request_bytes, response_bytes,
};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|input: &[u8]| check::<Talks>(input));

#[derive(Arbitrary)]
enum Step<'a> {
    Submit,
    Cancel,
    /// Up to this number of bytes is transmitted.
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
        let protocol = P::any_protocol(u)?;
        let config = Config {
            baud: *u.choose(&[115_200, 1_000_000, u32::MAX, 1].map(|baud| NonZeroU32::new(baud).expect("not 0")))?,
            latency: Duration::from_micros(u.int_in_range(0..=20_000)?),
            repeats: u.int_in_range(0..=6)?,
            stale_window: Duration::from_micros(u.int_in_range(0..=100_000)?),
        };
        let mut world = World::<P, N>::new(protocol, config);
        while !u.is_empty() {
            match u.arbitrary()? {
                Step::Submit => world.submit(&P::any_request(u)?),
                Step::Cancel => world.cancel(),
                Step::Transmit(n) => world.transmit(n.into()),
                Step::TransmitAll => world.transmit(N),
                Step::Bytes(bytes) => world.on_bytes(bytes),
                Step::Response => world.on_bytes(&response_bytes(protocol, &P::any_response(u)?)),
                Step::Echo => world.on_bytes(&request_bytes(protocol, &P::any_request(u)?)),
                Step::Idle => world.idle(),
                Step::Wait(micros) => world.wait(world.now + Duration::from_micros(u64::from(micros) * 16)),
                Step::WaitUntilDue => world.wait_until_due(),
            }
            let over = world.model.flight.is_none() && world.model.line.is_empty();
            assert_eq!(world.client.is_idle(), over);
        }
        world.end();
        Ok(())
    }
}

/// The request that is in flight, as far as it has got.
struct Flight<P: Subject> {
    bytes: Vec<u8>,
    info: InfoOf<P>,
    /// Number of complete transmissions, and the time of the last.
    sends: u8,
    sent: Instant,
}

struct World<P: Subject, const N: usize> {
    client: Client<P, N>,
    now: Instant,
    /// The number of the last request.
    number: u16,
    model: Model<P>,
}

/// The state that follows from the events so far.
struct Model<P: Subject> {
    protocol: P,
    config: Config,
    flight: Option<Flight<P>>,
    /// The bytes in transmission, the number already sent, and true if they belong to the request in flight.
    line: Vec<u8>,
    out: usize,
    of_flight: bool,
    broken: bool,
    /// The longest time that an arm may take for one of the requests so far.
    turnaround: Duration,
}

impl<P: Subject, const N: usize> World<P, N> {
    fn new(protocol: P, config: Config) -> Self {
        Self {
            client: Client::new(protocol, config),
            now: Instant::ZERO,
            number: 0,
            model: Model {
                protocol,
                config,
                flight: None,
                line: Vec::new(),
                out: 0,
                of_flight: false,
                broken: false,
                turnaround: Duration::ZERO,
            },
        }
    }

    fn submit(&mut self, request: &P::Request<'_>) {
        let submitted = self.client.submit(request);
        let model = &mut self.model;
        if model.flight.is_some() || !model.line.is_empty() {
            assert_eq!(submitted, Err(SubmitError::Busy));
            assert!(!SubmitError::Busy.to_string().is_empty() && !format!("{:?}", self.client).is_empty());
            return;
        }
        assert_eq!(submitted, Ok(()));
        let mut bytes = request_bytes(model.protocol, request);
        self.number = self.number.checked_add(1).unwrap_or(1);
        model.protocol.stamp(&mut bytes, self.number);
        let info = model.protocol.request(&bytes).expect("it is a request");
        let turnaround = info.response.map_or(Duration::ZERO, |response| response.turnaround);
        model.turnaround = model.turnaround.max(turnaround);
        model.flight = Some(Flight {
            bytes,
            info,
            sends: 0,
            sent: Instant::ZERO,
        });
        assert_eq!(self.client.expects_answer(), info.response.is_some());
    }

    fn cancel(&mut self) {
        self.client.cancel();
        self.model.over();
    }

    fn transmit(&mut self, n: usize) {
        self.take_events();
        let Output::Transmit(bytes) = self.client.poll(self.now) else {
            return;
        };
        let n = n.min(bytes.len());
        self.model.transmitted(bytes, n, self.now);
        assert!(self.client.transmitted(self.now, N + 1).is_err(), "more than there was");
        self.client.transmitted(self.now, n).expect("it was given");
    }

    fn on_bytes(&mut self, bytes: &[u8]) {
        let mut rest = bytes;
        while !rest.is_empty() {
            let later = self.client.receive(self.now, rest);
            assert!(later.len() < rest.len(), "it is not taken");
            rest = later;
            self.take_events();
        }
    }

    fn idle(&mut self) {
        self.client.idle();
        self.take_events();
    }

    fn take_events(&mut self) {
        loop {
            match self.client.poll(self.now) {
                Output::Event(event) => {
                    assert!(!format!("{event:?}").is_empty());
                    self.model.place(event, self.now);
                }
                Output::Transmit(bytes) => {
                    assert!(!bytes.is_empty(), "nothing is to be transmitted");
                    return;
                }
                Output::Timeout(until) => {
                    assert!(until.is_none_or(|until| until > self.now), "it waits for what is past");
                    return;
                }
            }
        }
    }

    fn wait(&mut self, until: Instant) {
        self.now = self.now.max(until);
        self.take_events();
    }

    fn wait_until_due(&mut self) {
        self.take_events();
        if let Output::Timeout(Some(until)) = self.client.poll(self.now) {
            self.wait(until);
        }
    }

    /// No more bytes arrive: requests in flight end within the configured time.
    fn end(mut self) {
        let end = self.now + self.model.longest(N);
        // Each is sent, falls due, and may be given a little more time; noise that is waited for ends as well.
        for _ in 0..6 * (u32::from(self.model.config.repeats) + 2) {
            self.transmit(N);
            self.wait_until_due();
        }
        assert!(
            self.model.flight.is_none() && self.client.is_idle(),
            "{:?} does not end",
            self.client
        );
        assert_eq!(self.client.poll(self.now), Output::Timeout(None));
        assert!(
            self.now <= end,
            "{:?} is over at {:?}, not by {end:?}",
            self.client,
            self.now
        );
    }
}

impl<P: Subject> Model<P> {
    /// The request in flight has ended. A partly sent request is completed, also a repeat whose answer arrived
    /// meanwhile.
    fn over(&mut self) -> Option<Flight<P>> {
        if self.of_flight && self.out == 0 {
            self.line.clear();
        }
        self.of_flight = false;
        self.flight.take()
    }

    /// The line takes `n` of these bytes.
    fn transmitted(&mut self, bytes: &[u8], n: usize, now: Instant) {
        assert!(!self.broken, "something is sent on a broken line");
        if self.line.is_empty() {
            let flight = self.flight.as_ref().expect("something is sent without a request");
            self.line.clone_from(&flight.bytes);
            self.of_flight = true;
        }
        assert_eq!(bytes, &self.line[self.out..]);
        self.out += n;
        if self.out < self.line.len() {
            if self.out == 0 {
                self.line.clear();
                self.of_flight = false;
            }
            return;
        }
        self.line.clear();
        self.out = 0;
        if let Some(flight) = self.flight.as_mut().filter(|_| self.of_flight) {
            flight.sends += 1;
            flight.sent = now;
        }
        self.of_flight = false;
    }

    fn place(&mut self, event: Event<'_, P::Response<'_>>, now: Instant) {
        match event {
            Event::Answer(response) => {
                let flight = self.over().expect("no request is in flight");
                let (to, expect) = (Some(flight.info.key), flight.info.expect);
                let bytes = response_bytes(self.protocol, &AnyResponse { response, to, expect });
                assert!(self.protocol.is_response_to(flight.info.key, &bytes));
                assert!(flight.sends > 0, "answered before it was sent");
            }
            Event::Unacceptable(error) => {
                let flight = self.over().expect("no request is in flight");
                assert!(flight.info.response.is_some(), "it is not answered");
                assert!(flight.sends > 0, "answered before it was sent");
                assert!(!error.to_string().is_empty());
            }
            Event::Sent => {
                let flight = self.over().expect("no request is in flight");
                assert_eq!((flight.info.response, flight.sends), (None, 1));
            }
            Event::TimedOut { sends } => {
                let flight = self.over().expect("no request is in flight");
                let response = flight.info.response.expect("it is not answered");
                assert_eq!(sends, flight.sends);
                let most = if flight.info.effect == Effect::Read {
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
                    flight.sent + response.turnaround + self.config.latency <= now,
                    "too soon"
                );
            }
            Event::Broken { .. } => {
                assert!(P::LOSSLESS);
                (self.flight, self.broken) = (None, true);
                self.line.clear();
                (self.out, self.of_flight) = (0, false);
            }
            Event::Noise { bytes, .. } => assert!(!bytes.is_empty()),
            // They end nothing.
            Event::Late(response) | Event::Unsolicited(response) => assert!(!format!("{response:?}").is_empty()),
            Event::Unknown { frame, error } => assert!(!frame.is_empty() && !error.to_string().is_empty()),
            Event::Echo => assert!(!P::LOSSLESS),
        }
    }

    /// The time after which all is over: the answer to an earlier request is late, and then each send of this one falls due, a
    /// frame that has begun included.
    fn longest(&self, n: usize) -> Duration {
        let frame = n as u64 * 10_000_000 / u64::from(self.config.baud.get());
        let answer = self.turnaround.as_micros() + self.config.latency.as_micros() + 3 * frame;
        // Each of these times may be rounded up.
        let rounding = 300;
        let repeats = u64::from(self.config.repeats) + 2;
        Duration::from_micros(repeats * answer + 2 * self.config.stale_window.as_micros() + rounding)
    }
}
