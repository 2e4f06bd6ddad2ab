//! Any bytes at any time: each request ends once, with a fitting event. The port is read before each request. Only the
//! request's bytes are sent, fences before it, and zeros after a part of one that has ended. Time alone ends every wait. A
//! reading does not wait for those before it.
#![no_main]

use std::num::NonZeroU32;

use armwire::correlation::{Effect, InfoOf};
use armwire::framing::Reason;
use armwire::time::{Duration, Instant};
use armwire::{Client, Config, ErrorFrame, Event, Output, SubmitError};
use armwire_fuzz::{Check, Result, Subject, Unstructured, check, request_bytes, response_bytes};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|input: &[u8]| check::<Requests>(input));

struct Requests;

impl Check for Requests {
    fn check<P: Subject, const N: usize>(u: &mut Unstructured<'_>) -> Result<()> {
        let protocol = P::any_protocol(u)?;
        let config = Config {
            baud: *u.choose(&[115_200, 1_000_000, 0, 1].map(NonZeroU32::new))?,
            latency: Duration::from_micros(u.int_in_range(0..=20_000)?),
            repeats: u.int_in_range(0..=6)?,
            stale_window: Duration::from_micros(u.int_in_range(0..=100_000)?),
            backlog: u.int_in_range(0..=300)?,
        };
        let mut world = World::<P, N>::new(protocol, config);
        while !u.is_empty() {
            match u.int_in_range(0..=11)? {
                kind @ (0 | 11) => world.submit(&P::any_request(u)?, kind == 11),
                1 => world.cancel(),
                2 => world.transmit(u.arbitrary::<u8>()?.into()),
                3 => world.transmit(N),
                4 => world.on_bytes(u.arbitrary()?),
                5 => {
                    let any = P::any_response(u)?;
                    world.on_bytes(&response_bytes(protocol, &any.response, any.to));
                }
                // An echo.
                6 => world.on_bytes(&request_bytes(protocol, &P::any_request(u)?)),
                7 => world.idle(),
                8 => world.on_empty(),
                9 => world.wait(world.now + Duration::from_micros(u64::from(u.arbitrary::<u16>()?) * 16)),
                _ => world.wait_until_due(),
            }
            assert_eq!(world.client.is_idle(), world.model.pending.is_none());
        }
        world.end();
        Ok(())
    }
}

/// Sends that a client tracks, and those of calls beside fences.
const SENDS: usize = 11;
const CALLS: usize = 7;

/// The request in flight.
struct Pending<P: Subject> {
    bytes: Vec<u8>,
    info: InfoOf<P>,
    is_reading: bool,
    /// Number of complete transmissions, and the time of the last.
    sends: u8,
    sent: Instant,
    /// Number of sent bytes of the current transmission.
    part: usize,
    /// The reads before the first transmission.
    reads: Reads,
}

/// The reads of the port before a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Reads {
    /// Not asked for.
    None,
    /// Asked for, until this number of bytes has arrived.
    Asked(usize),
    Done,
}

struct World<P: Subject, const N: usize> {
    client: Client<P, N>,
    now: Instant,
    /// The number of the last request.
    number: u16,
    model: Model<P, N>,
}

/// The state that follows from the events so far.
struct Model<P: Subject, const N: usize> {
    protocol: P,
    config: Config,
    pending: Option<Pending<P>>,
    /// The unsent zeros after a part of a request that has ended.
    void: usize,
    /// The number of sent bytes of the present fence.
    fence: usize,
    /// A request has ended in the middle, on a lossless line.
    abandoned: bool,
    broken: bool,
    /// The longest time that an arm may take for one of the requests so far.
    turnaround: Duration,
    /// The requests that were sent and have ended, and the time from which on no answer is possible.
    ended: Vec<(InfoOf<P>, Instant)>,
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
                pending: None,
                void: 0,
                fence: 0,
                abandoned: false,
                broken: false,
                turnaround: Duration::ZERO,
                ended: Vec::new(),
            },
        }
    }

    fn submit(&mut self, request: &P::Request<'_>, is_reading: bool) {
        let submitted = match is_reading {
            true => self.client.submit_reading(request),
            false => self.client.submit(request),
        };
        let model = &mut self.model;
        if model.pending.is_some() {
            assert_eq!(submitted, Err(SubmitError::Busy));
            assert!(!SubmitError::Busy.to_string().is_empty() && !format!("{:?}", self.client).is_empty());
            return;
        }
        let mut bytes = request_bytes(model.protocol, request);
        let number = self.number.checked_add(1).unwrap_or(1);
        model.protocol.stamp(&mut bytes, number);
        let info = model.protocol.request(&bytes).expect("it is a request");
        if is_reading && info.effect != Effect::Read {
            assert_eq!(submitted, Err(SubmitError::NotARead));
            return;
        }
        assert_eq!(submitted, Ok(()));
        self.number = number;
        let turnaround = info.response.map_or(Duration::ZERO, |response| response.turnaround);
        model.turnaround = model.turnaround.max(turnaround);
        model.pending = Some(Pending {
            bytes,
            info,
            is_reading,
            sends: 0,
            sent: Instant::ZERO,
            part: 0,
            reads: Reads::None,
        });
        assert_eq!(self.client.expects_answer(), info.response.is_some());
    }

    fn cancel(&mut self) {
        self.client.cancel();
        self.model.end(self.now);
    }

    fn transmit(&mut self, n: usize) {
        self.take_events();
        if matches!(self.client.poll(self.now), Output::Receive) {
            assert!(
                self.client.transmitted(self.now, 1).is_err(),
                "sent before the port was read"
            );
        }
        let Output::Transmit(bytes) = self.client.poll(self.now) else {
            return;
        };
        let n = n.min(bytes.len());
        self.model.transmitted(bytes, n, self.now);
        assert!(
            self.client.transmitted(self.now, N + 1).is_err(),
            "more bytes than there were"
        );
        self.client.transmitted(self.now, n).expect("it was given");
    }

    /// The first half of these bytes is copied in, the second is read into the client's space.
    fn on_bytes(&mut self, bytes: &[u8]) {
        let (mut copied, mut read) = bytes.split_at(bytes.len() / 2);
        while !copied.is_empty() {
            let later = self.client.receive(self.now, copied);
            assert!(later.len() < copied.len(), "it is not taken");
            self.model.on_read(copied.len() - later.len());
            copied = later;
            self.take_events();
        }
        while !read.is_empty() {
            let space = self.client.space();
            let n = space.len().min(read.len());
            assert!(n > 0, "no space");
            space[..n].copy_from_slice(&read[..n]);
            self.client.received(self.now, n).expect("there is space");
            self.model.on_read(n);
            read = &read[n..];
            self.take_events();
        }
    }

    /// The port is empty.
    fn on_empty(&mut self) {
        assert!(
            self.client.received(self.now, N + 1).is_err(),
            "more bytes than there is space"
        );
        self.client.received(self.now, 0).expect("none fit");
        self.model.on_read(0);
        self.take_events();
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
                    let has_frame = self.model.on_event(event, self.now);
                    assert_eq!(!self.client.frame().is_empty(), has_frame);
                }
                Output::Receive => {
                    self.model.on_receive();
                    return;
                }
                Output::Transmit(bytes) => {
                    assert!(!bytes.is_empty(), "a transmission without bytes");
                    return;
                }
                Output::Timeout(until) => {
                    assert!(until.is_none_or(|until| until > self.now), "a timeout in the past");
                    self.model.on_wait(self.now);
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
        let end = self.now + self.model.longest();
        // Waits for noise end as well.
        loop {
            self.take_events();
            if self.now > end || self.client.poll(self.now) == Output::Timeout(None) {
                break;
            }
            while self.model.void > 0 && !P::LOSSLESS {
                self.transmit(N);
            }
            self.on_empty();
            self.transmit(N);
            self.wait_until_due();
        }
        assert!(
            self.model.pending.is_none() && self.client.is_idle(),
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

impl<P: Subject, const N: usize> Model<P, N> {
    /// The line takes `n` of these bytes: of a void, or of a request.
    fn transmitted(&mut self, bytes: &[u8], n: usize, now: Instant) {
        assert!(!self.broken && !self.abandoned, "something is sent on a broken line");
        if self.void > 0 {
            assert!(
                bytes.len() <= self.void && bytes.iter().all(|byte| *byte == 0),
                "no void"
            );
            self.void -= n;
            return;
        }
        let Some(pending) = self.pending.as_mut().filter(|pending| pending.reads == Reads::Done) else {
            let is_fence = |fence: &&[u8]| &fence[self.fence..] == bytes;
            assert!(P::FENCES.iter().any(is_fence), "{bytes:02X?} before the port was read");
            self.fence = (self.fence + n) % (self.fence + bytes.len());
            return;
        };
        assert_eq!(bytes, &pending.bytes[pending.part..]);
        pending.part += n;
        if pending.part == pending.bytes.len() {
            pending.part = 0;
            pending.sends += 1;
            pending.sent = now;
        }
    }

    /// The client asks for the bytes that the port has.
    fn on_receive(&mut self) {
        assert_eq!(self.void, 0, "a void comes first");
        let pending = self.pending.as_mut().expect("a read without a request");
        assert_eq!((pending.sends, pending.part), (0, 0), "a read before a repeat");
        if pending.reads == Reads::None {
            let bound = match pending.info.response {
                Some(_) if !P::HAS_TRANSACTION_ID => self.config.backlog as usize,
                _ => 1,
            };
            pending.reads = Reads::Asked(bound);
        }
        assert!(matches!(pending.reads, Reads::Asked(_)), "a read too many");
    }

    /// The client waits.
    fn on_wait(&self, now: Instant) {
        let Some(pending) = self.pending.as_ref().filter(|pending| pending.reads == Reads::None) else {
            return;
        };
        // It is delayed.
        assert!(!P::HAS_TRANSACTION_ID && pending.info.response.is_some() && !self.broken);
        if pending.is_reading {
            let open = self
                .ended
                .iter()
                .filter(|(_, until)| now < *until || !P::FENCES.is_empty());
            let open: Vec<_> = open.map(|(info, _)| info).collect();
            let has_room = open.len() < if P::FENCES.is_empty() { SENDS } else { CALLS };
            let is_alone = open.iter().all(|info| info.expect == pending.info.expect);
            // The answer to a fence with its key comes first.
            let key_of = |fence: &&[u8]| self.protocol.request(fence).map(|info| info.key);
            let is_fence = P::FENCES.iter().any(|fence| key_of(fence) == Some(pending.info.key));
            assert!(
                !(has_room && is_alone) || is_fence || self.fence > 0,
                "a reading is delayed"
            );
        }
    }

    /// The port had `n` bytes.
    fn on_read(&mut self, n: usize) {
        if let Some(pending) = &mut self.pending
            && let Reads::Asked(bound) = pending.reads
        {
            pending.reads = match bound.saturating_sub(n) {
                0 => Reads::Done,
                _ if n == 0 => Reads::Done,
                left => Reads::Asked(left),
            };
        }
    }

    /// The request in flight ends. If a part of it is sent, that is voided.
    fn end(&mut self, now: Instant) -> Option<Pending<P>> {
        let pending = self.pending.take()?;
        if pending.sends > 0 && pending.info.response.is_some() {
            let until = now + self.answer() + self.config.stale_window;
            self.ended.push((pending.info, until));
        }
        if pending.part > 0 {
            match P::LOSSLESS {
                true => self.abandoned = true,
                false => self.void = P::VOID.expect("a lossy line has a void"),
            }
        }
        Some(pending)
    }

    /// Returns true if the event has a frame.
    fn on_event(&mut self, event: Event<'_, P::Response<'_>>, now: Instant) -> bool {
        let has_frame = match event {
            Event::Noise { .. } | Event::Sent | Event::TimedOut { .. } | Event::Broken { .. } => false,
            Event::Answer(_) | Event::ErrorFrame { .. } | Event::Unacceptable(_) => true,
            Event::Late(_) | Event::Unsolicited(_) | Event::Unknown { .. } | Event::Echo => true,
        };
        match event {
            Event::Answer(response) => {
                let pending = self.end(now).expect("no request is in flight");
                let bytes = response_bytes(self.protocol, &response, Some(pending.info.key));
                assert!(self.protocol.is_response_to(pending.info.key, &bytes));
                assert!(pending.sends > 0, "answered before it was sent");
            }
            Event::ErrorFrame { frame } => {
                let pending = self.end(now).expect("no request is in flight");
                assert!(self.protocol.is_response_to(pending.info.key, frame));
                assert!(pending.sends > 0, "answered before it was sent");
                let error = ErrorFrame::new(frame);
                assert!(frame.starts_with(error.bytes()) && !error.to_string().is_empty());
            }
            Event::Unacceptable(error) => {
                let pending = self.end(now).expect("no request is in flight");
                assert!(pending.info.response.is_some(), "it is not answered");
                assert!(pending.sends > 0, "answered before it was sent");
                assert!(!error.to_string().is_empty());
            }
            Event::Sent => {
                let pending = self.end(now).expect("no request is in flight");
                assert_eq!((pending.info.response, pending.sends), (None, 1));
            }
            Event::TimedOut { sends } => {
                let pending = self.end(now).expect("no request is in flight");
                let response = pending.info.response.expect("it is not answered");
                assert_eq!(sends, pending.sends);
                if sends == 0 {
                    assert!(!P::FENCES.is_empty(), "given up before it was sent");
                    return false;
                }
                let most = match pending.info.effect {
                    Effect::Read if !pending.is_reading => self.config.repeats,
                    _ => 0,
                };
                assert_eq!(
                    sends,
                    most + 1,
                    "given up before it was repeated, or repeated too often"
                );
                assert!(
                    pending.sent + response.turnaround + self.config.latency <= now,
                    "too soon"
                );
            }
            Event::Broken { reason, .. } => {
                assert!(P::LOSSLESS);
                assert!(reason != Reason::Abandoned || self.abandoned);
                (self.pending, self.broken) = (None, true);
            }
            Event::Noise { bytes, .. } => assert!(!bytes.is_empty()),
            // No request ends.
            Event::Late(response) | Event::Unsolicited(response) => assert!(!format!("{response:?}").is_empty()),
            Event::Unknown { frame, error } => assert!(!frame.is_empty() && !error.to_string().is_empty()),
            Event::Echo => assert!(!P::LOSSLESS),
        }
        has_frame
    }

    /// The maximum time until all requests have ended: the answer to an earlier request is late, and then each send of
    /// this one times out, within a frame that has begun.
    fn longest(&self) -> Duration {
        let repeats = u64::from(self.config.repeats) + 2;
        Duration::from_micros(repeats * self.answer().as_micros() + 2 * self.config.stale_window.as_micros())
    }

    /// The maximum time from a request until its answer has timed out, within a frame that has begun.
    fn answer(&self) -> Duration {
        let frame = self
            .config
            .baud
            .map_or(0, |baud| N as u64 * 10_000_000 / u64::from(baud.get()));
        // Each of these times may be rounded up.
        let rounding = 300;
        Duration::from_micros(self.turnaround.as_micros() + self.config.latency.as_micros() + 3 * frame + rounding)
    }
}
