//! The host's side: one request at a time, time as an input, no I/O.

use core::fmt;
use core::num::NonZeroU32;

use crate::correlation::{Effect, InfoOf, ResponseTiming};
use crate::decoder::{Decoder, Item, Kind, Span};
use crate::exchange::{Exchange, FirstByte, Handover, Match, time_of_state};
use crate::fences::{Fences, Who};
use crate::framing::Reason;
use crate::messages::Messages;
use crate::time::{Duration, Instant};
use crate::{BufferTooShort, Cause, EncodeError, OutOfRange, ParseError};

/// Sends that may be unresolved: the one in flight, stale ones, and fences.
const SENDS: usize = 11;

/// The stale window of an arm that has answered no fence yet: a line may hold its answer back.
const STALL: Duration = Duration::from_millis(2_000);

/// A part of a void.
static ZEROS: [u8; 32] = [0; 32];

/// The timing of a [`Client`].
///
/// ```
/// use core::num::NonZeroU32;
/// use armwire::Config;
/// use armwire::time::Duration;
///
/// // Bluetooth serial: slow, with occasional delays.
/// let baud = NonZeroU32::new(115_200);
/// let config = Config { baud, latency: Duration::from_millis(150), ..Config::default() };
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Config {
    /// Baud rate of the line, for the transmission time of messages; `None` for a line without one.
    pub baud: Option<NonZeroU32>,
    /// Maximum round-trip delay between host and line, caused by USB and the operating system. May be zero.
    pub latency: Duration,
    /// Number of repeats of an unanswered read request.
    pub repeats: u8,
    /// Time after the timeout of an answer during which it may still arrive, on a line without
    /// [fences](Messages::FENCES). After a missing answer, the next request with the same key is delayed by this time,
    /// unless the protocol numbers its answers. An answer after this time can be assigned to the wrong request. The time
    /// counts from the acceptance of the request: a port that accepts bytes and transmits them later than this can cause
    /// such an answer. With fences, a request waits at most twice this time for their answers, or its own timeout.
    pub stale_window: Duration,
    /// Maximum number of bytes that are [received](Output::Receive) before a request, on a port that never runs out of
    /// them. The size of the port's receive buffer suffices. 0 counts as 1. A port that buffers more can deliver an
    /// old answer as a new one. Only one read precedes a request without an answer, or with a numbered one.
    pub backlog: u32,
}

impl Default for Config {
    fn default() -> Self {
        Self::DEFAULT
    }
}

impl Config {
    /// 1 Mbaud over USB: 10 ms of latency, two repeats, answers up to 100 ms late, a receive buffer of 64 KiB.
    pub const DEFAULT: Self = Self {
        baud: NonZeroU32::new(1_000_000),
        latency: Duration::from_millis(10),
        repeats: 2,
        stale_window: Duration::from_millis(100),
        backlog: 65_536,
    };

    /// A TCP connection in a local network: 100 ms of latency, answers up to a second late. No repeats, because TCP
    /// retransmits by itself.
    pub const TCP: Self = Self {
        baud: None,
        latency: Duration::from_millis(100),
        repeats: 0,
        stale_window: Duration::from_millis(1_000),
        ..Self::DEFAULT
    };

    /// The transmission time of `len` bytes, ten bits per byte.
    fn on_wire(&self, len: usize) -> Duration {
        // Duration of a byte at 1 baud, in µs. The computation has two parts, because 64-bit division is slow on a
        // microcontroller.
        const BYTE: u32 = 10_000_000;
        let Some(baud) = self.baud else {
            return Duration::ZERO;
        };
        let len = u32::try_from(len).unwrap_or(u32::MAX);
        let whole = u64::from(len) * u64::from(BYTE / baud);
        // Less than 1 µs per byte.
        let rest = len
            .checked_mul(BYTE % baud)
            .map_or(len, |rest| rest.div_ceil(baud.get()));
        Duration::from_micros(whole + u64::from(rest))
    }

    /// The timeout of an answer, from the handover of its request of `len` bytes.
    pub fn timeout(&self, len: usize, response: ResponseTiming) -> Duration {
        self.on_wire(len.saturating_add(response.longest.into())) + response.turnaround + self.latency
    }
}

/// The next action for the caller of a [`Client`]. `R` is the protocol's response.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Output<'a, R> {
    /// Read the bytes that the port has, without waiting. Report their number with [`received`](Client::received), or
    /// pass them to [`receive`](Client::receive); 0 or none if the port is empty. They are older than the request that
    /// is transmitted next.
    Receive,
    /// Transmit these bytes: a request, or a void. Report the number that the port accepted with
    /// [`transmitted`](Client::transmitted), before it is flushed.
    Transmit(&'a [u8]),
    /// An event.
    Event(Event<'a, R>),
    /// Wait for bytes, until this time; `None` if no timeout is running.
    Timeout(Option<Instant>),
}

/// An event on the line. It is exhaustive: its cases account for every byte, and a match that leaves out the end of
/// a request waits for it without end.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Event<'a, R> {
    /// The answer to the request in flight. The request is complete.
    Answer(R),
    /// The answer to the request in flight has an invalid value or length. The request is complete and is not repeated,
    /// because the arm would send the same answer.
    Unacceptable(ParseError),
    /// The arm answered the request in flight with an error frame. The request is complete and is not repeated.
    ///
    /// An error frame does not name its request: it counts as the answer to the oldest request without one.
    ErrorFrame {
        /// The frame.
        frame: &'a [u8],
    },
    /// The request in flight was transmitted. It has no answer, or was [cancelled](Client::cancel) too late, and is
    /// complete.
    Sent,
    /// The request in flight got no answer in time.
    TimedOut {
        /// The number of transmissions of the request. 0 if the answer to an earlier request may still arrive, and the
        /// arm did not answer the fences that would show its loss.
        sends: u8,
    },
    /// An answer to a request that timed out, was cancelled, or was answered before.
    Late(R),
    /// A response without a request.
    Unsolicited(R),
    /// A frame with the [form of a request](crate::correlation::Correlation::is_request): an echo of the line, or a request
    /// of another host. On a line that is known to [echo](crate::correlation::Correlation::echoes), the request itself.
    Echo,
    /// A valid frame that is neither a message of the protocol nor the answer to the request in flight.
    Unknown {
        /// The frame.
        frame: &'a [u8],
        /// The reason.
        error: ParseError,
    },
    /// Bytes that are not part of a frame.
    Noise {
        /// The offset of the first byte, in bytes since the client was created.
        offset: u64,
        /// The bytes. A run of noise may be split into several events.
        bytes: &'a [u8],
        /// The reason.
        reason: Reason,
    },
    /// A lossless stream broke here: no later byte can be decoded, or a request was [abandoned](Reason::Abandoned). The
    /// request in flight and all later ones fail. Close the connection.
    Broken {
        /// The offset of the break, in bytes since the client was created.
        offset: u64,
        /// The reason.
        reason: Reason,
    },
}

/// The reason why [`Client::submit`] or [`Client::submit_reading`] rejected a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum SubmitError {
    /// Another request is in flight.
    Busy,
    /// The client's buffer is shorter than the request.
    TooLong(BufferTooShort),
    /// A value of the request does not fit its field. No request of the protocols in this crate has one.
    OutOfRange(OutOfRange),
    /// The request was submitted as a reading, and may change the arm.
    NotARead,
}

impl fmt::Display for SubmitError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Busy => f.write_str("a request is already in flight"),
            Self::TooLong(error) => error.fmt(f),
            Self::OutOfRange(error) => error.fmt(f),
            Self::NotARead => f.write_str("the request is not a read"),
        }
    }
}

impl core::error::Error for SubmitError {}

/// The request in flight.
struct Call {
    state: State,
    /// The time since which it waits for an earlier answer.
    blocked: Option<Instant>,
    /// The number of complete transmissions.
    sends: u8,
    /// The number of remaining repeats.
    repeats: u8,
    /// True for one of many readings, which does not wait for those before.
    is_reading: bool,
    /// It was cancelled after its first byte, and has no void.
    is_cancelled: bool,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum State {
    /// Not sent yet, or waiting for a repeat.
    Ready,
    /// The port is read, until it is empty or this number of bytes has arrived.
    Reading(u32),
    /// Its bytes are being transmitted: the next one is at this index.
    Writing(usize),
    /// Transmitted; an answer is expected.
    Waiting,
    /// Transmitted; no answer is expected.
    Sent,
}

/// Returns true if a request of this protocol is transmitted to its end, once begun.
const fn is_completed<M: Messages>() -> bool {
    M::VOID.is_none() && !M::LOSSLESS
}

/// The outgoing frame and its possible answers.
struct Outgoing<M: Messages, const N: usize> {
    exchange: Exchange<M, Who, SENDS>,
    call: Option<Call>,
    fences: Fences,
    /// The time at which bytes were last given out.
    offered: Instant,
    /// The properties of the frame in `tx` for the exchange. `None` before the first.
    info: Option<InfoOf<M>>,
    tx: [u8; N],
    /// The frame: `tx[..len]`.
    len: usize,
    /// The number of zeros left of a void, which precedes any other byte.
    void: usize,
    /// The line has not returned the frame yet.
    is_echo_due: bool,
}

impl<M: Messages, const N: usize> Outgoing<M, N> {
    /// Ends the request in flight. Answers to its transmissions are stale from now on. A partly transmitted frame is
    /// voided: the arm must not execute a request that has ended.
    fn end(&mut self) {
        let call = self.call.take();
        self.exchange.give_up(Who::Call);
        if let Some(State::Writing(1..)) = call.map(|call| call.state) {
            // A lossless line breaks.
            self.void = M::VOID.unwrap_or(1);
        }
    }

    /// Returns true if a frame is partly transmitted that cannot be voided: its end comes before anything else.
    fn must_complete(&self) -> bool {
        let state = self.call.as_ref().map(|call| call.state);
        is_completed::<M>() && matches!(state, Some(State::Writing(1..)))
    }

    /// Stops transmission, even inside a frame: the arm must not execute a request that has failed.
    fn stop(&mut self) -> bool {
        self.void = 0;
        self.call.take().is_some()
    }

    /// Starts transmission, if the request in flight may be sent now, or of a fence before it.
    fn start(&mut self, messages: &M, config: &Config, now: Instant) {
        let Some(call) = self.call.as_mut().filter(|call| call.state == State::Ready) else {
            return;
        };
        if !self.fences.pending::<M>().is_empty() {
            return;
        }
        if call.sends > 0 {
            // A repeat belongs to the same call. It never waits, and an answer in the port is an answer to the call.
            call.state = State::Writing(0);
            return;
        }
        let Some(info) = self.info.as_ref().filter(|info| info.response.is_some()) else {
            // One read suffices: it bounds the bytes in the port.
            call.state = State::Reading(0);
            return;
        };
        let are_fences_on = self.fences.are_on::<M>();
        // Fences have their places.
        let has_room = !are_fences_on || self.exchange.open(Who::Call) + Fences::places::<M>() < SENDS;
        let may_go = has_room
            && match (call.is_reading, are_fences_on) {
                (true, true) => self.exchange.can_follow(info, Who::Call),
                (true, false) => self.exchange.can_overtake(info, Who::Call),
                (false, _) => self.exchange.can_send(info, Who::Call),
            };
        let is_fenced = !may_go || self.exchange.missing_answers(info.key) > 0;
        if are_fences_on && (is_fenced || call.is_reading && !self.fences.are_known()) {
            self.fences.start(messages, &self.exchange, now);
        }
        if may_go && self.fences.pending::<M>().is_empty() {
            // One read suffices if no old answer can be taken for the new one.
            call.state = State::Reading(if M::HAS_TRANSACTION_ID { 0 } else { config.backlog });
        } else if !may_go && are_fences_on {
            call.blocked.get_or_insert(now);
        }
    }

    /// `n` bytes were received, or none.
    fn received(&mut self, n: usize) {
        if let Some(call) = &mut self.call
            && let State::Reading(left) = call.state
        {
            let n = u32::try_from(n).unwrap_or(u32::MAX);
            call.state = match left.saturating_sub(n) {
                left @ 1.. if n > 0 => State::Reading(left),
                _ => State::Writing(0),
            };
        }
    }

    /// The next bytes to transmit.
    fn pending(&self) -> &[u8] {
        let fence = self.fences.pending::<M>();
        match &self.call {
            _ if self.void > 0 => ZEROS.get(..self.void).unwrap_or(&ZEROS),
            _ if !fence.is_empty() => fence,
            Some(call) => match call.state {
                State::Writing(at) => self.tx.get(at..self.len).unwrap_or_default(),
                _ => &[],
            },
            None => &[],
        }
    }

    /// Returns true if these bytes are the frame, which the line returns once.
    fn take_echo(&mut self, bytes: &[u8]) -> bool {
        let is_echo = self.is_echo_due && self.tx.get(..self.len) == Some(bytes);
        self.is_echo_due &= !is_echo;
        is_echo
    }

    /// The port accepted `n` of the pending bytes.
    fn transmitted(&mut self, messages: &M, n: usize, config: &Config, received: u64, now: Instant) {
        // The program may have been interrupted in the write.
        let at = self.offered;
        let handover = |len, response| Handover {
            offset: received,
            at,
            due: now + config.timeout(len, response),
        };
        if self.void > 0 {
            self.void = self.void.saturating_sub(n);
            return;
        }
        if !self.fences.pending::<M>().is_empty() {
            let complete = self.fences.transmitted(n, now, config.latency, config.stale_window);
            if let Some(fence) = complete
                && let Some(info) = messages.request(fence.frame)
                && let Some(response) = info.response
            {
                let handover = handover(fence.frame.len(), response);
                match fence.is_new {
                    true => drop(self.exchange.begin(info, Who::Fence, handover)),
                    false => self.exchange.repeat(info, Who::Fence, handover),
                }
                // Nothing waits for its answer.
                self.exchange.give_up(Who::Fence);
            }
            return;
        }
        let Some(call) = &mut self.call else { return };
        let State::Writing(at) = &mut call.state else { return };
        *at = at.saturating_add(n);
        if *at < self.len {
            return;
        }
        if messages.echoes() {
            self.is_echo_due = true;
        }
        let response = self.info.and_then(|info| info.response);
        let (Some(info), Some(response)) = (self.info, response) else {
            call.state = State::Sent;
            return;
        };
        let handover = handover(self.len, response);
        match call.sends {
            0 if call.is_reading && !self.fences.are_on::<M>() => self.exchange.overtake(info, Who::Call, handover),
            0 => drop(self.exchange.begin(info, Who::Call, handover)),
            _ => self.exchange.repeat(info, Who::Call, handover),
        }
        call.sends = call.sends.saturating_add(1);
        call.state = State::Waiting;
        if is_completed::<M>() && call.is_cancelled {
            call.state = State::Sent;
            self.exchange.give_up(Who::Call);
        }
    }

    /// Returns true if the request in flight is being transmitted.
    fn is_writing(&self) -> bool {
        let state = self.call.as_ref().map(|call| call.state);
        matches!(state, Some(State::Writing(_)))
    }

    /// Returns true if the frame in `tx` changes nothing.
    fn is_read(&self) -> bool {
        self.info.is_some_and(|info| info.effect == Effect::Read)
    }

    /// The timeout of the answer to the request in flight.
    fn due(&self) -> Option<Instant> {
        let waiting = self.call.as_ref().is_some_and(|call| call.state == State::Waiting);
        self.exchange.due(Who::Call).filter(|_| waiting)
    }

    /// The time at which a request that waits for an earlier answer is given up.
    fn end_of_wait(&self, config: &Config) -> Option<Instant> {
        let call = self.call.as_ref();
        let call = call.filter(|call| call.state == State::Ready && self.fences.are_on::<M>())?;
        let response = self.info?.response?;
        let windows = config.stale_window + config.stale_window;
        Some(call.blocked? + windows.max(config.timeout(self.len, response)))
    }

    /// Tells the fences of a frame, before which this number of them had no answer, and sets the stale window.
    fn update_fences(&mut self, matched: Match<Who>, missing: u16, config: &Config, now: Instant) {
        if let Match::Late { who: Who::Fence, .. } = matched {
            self.fences.answered(&self.exchange, now, config.stale_window);
        } else {
            if !matches!(matched, Match::Unsolicited) {
                self.fences.heard();
            }
            let left = self.exchange.missing_answers_of(Who::Fence);
            self.fences.lost(missing.saturating_sub(left));
        }
        if self.exchange.out_of_order() > 0 {
            self.fences.out_of_order();
        }
        if !self.fences.are_on::<M>() {
            self.exchange.set_stale_window(config.stale_window);
        } else if self.fences.are_answered() {
            // Only order shows that an answer is lost.
            self.exchange.set_stale_window(Duration::MAX);
        }
    }

    /// Handles a missing answer: schedules a repeat, or ends the call and returns its number of transmissions.
    fn give_up(&mut self) -> Option<u8> {
        let is_read = self.is_read();
        let call = self.call.as_mut()?;
        if call.repeats > 0 && is_read {
            call.repeats -= 1;
            call.state = State::Ready;
            return None;
        }
        let sends = call.sends;
        self.end();
        Some(sends)
    }
}

/// A host-side state machine with buffers of `N` bytes.
///
/// One request is in flight at a time, and one answer ends it: any further answer to the same request is
/// [unsolicited](Event::Unsolicited). Bytes go in by [`space`](Self::space) and [`received`](Self::received), or by
/// [`receive`](Self::receive). Time goes in by [`poll`](Self::poll), which returns the next step: transmit, handle an
/// event, or wait. The client does no I/O and reads no clock: it runs in an interrupt handler, in a task, or in a test
/// without real time. 260 bytes hold every message of every protocol; a frame that is longer than `N` is noise.
///
/// A late answer never satisfies the next request. While an answer to an earlier request is possible (the request timed
/// out, was repeated, or was cancelled), the next request with the same key waits until the answer arrives or is lost.
/// Requests without an answer, such as torque off, never wait. No request waits on a protocol with numbered answers, whose
/// requests the client numbers.
///
/// The order of answers shows that an earlier one is lost, and time does not: a line may hold its bytes back. A request
/// that waits is preceded by a [fence](Messages::FENCES), a read with another key. An unanswered fence is followed by the
/// next one after [`Config::latency`], and after twice that time again. An arm that answers no fence, or out of order, and
/// a line that loses most of them, are recognised: there an answer counts as lost at the end of [`Config::stale_window`].
/// Until a fence is answered, it counts as lost after 2 s, or after that window if it is longer.
///
/// # A call
///
/// ```text
/// submit --> ready --> reading --> writing --> waiting --> Answer, Unacceptable, ErrorFrame, TimedOut
///                                  |    ^         |
///                                  |    +---------+  no answer, and repeats are left
///                                  +--> Sent, if the request has no answer
/// ```
///
/// | State | Output | Ends |
/// |---|---|---|
/// | ready | [`Timeout`](Output::Timeout) | when no answer to an earlier request is possible: mostly at once |
/// | reading | [`Receive`](Output::Receive) | when the port is empty, or after [`Config::backlog`] bytes |
/// | writing | [`Transmit`](Output::Transmit) | when the port has accepted the last byte |
/// | waiting | [`Timeout`](Output::Timeout) | by an answer, or by its timeout |
///
/// [`cancel`](Self::cancel) ends a call in each state. Bytes that a port has before a request is transmitted belong to
/// earlier requests, and the client cannot know their age: hence *reading*.
///
/// A request that ended in *writing*, by `cancel` or by an answer before the end of its repeat, is never executed: if
/// the port has accepted some of its bytes, the client transmits a [*void*](crate::framing::Framing::VOID) before anything
/// else. These zeros make the arm discard the partial frame. A [lossless](crate::framing::Framing::LOSSLESS) line breaks
/// instead, with [`Reason::Abandoned`]. The rule does not cover an arm that executes a request before its last byte, and
/// no request of a protocol without a void: once begun, it is transmitted to its end.
///
/// ```
/// use armwire::ling::{JointState, Ling, MotionStatus, Request, Response};
/// use armwire::time::Instant;
/// use armwire::{Client, Config, Event, Output};
///
/// let mut client = Client::<Ling, 70>::new(Ling, Config::default());
/// client.submit(&Request::ReadJoints).unwrap();
/// let now = Instant::ZERO;
/// assert_eq!(client.poll(now), Output::Receive);
/// client.received(now, 0).unwrap(); // the port is empty
/// let Output::Transmit(bytes) = client.poll(now) else { panic!("nothing to transmit") };
/// assert_eq!(bytes, [0xAA, 0x06, 0x00, 0x01, 0xFE, 0x9A, 0xFF]);
/// let n = bytes.len(); // number of bytes that the port accepted
/// client.transmitted(now, n).unwrap();
///
/// let now = Instant::from_micros(350);
/// let rest = client.receive(now, &[
///     0xAA, 0x06, 0x00, 0x0F, 0x00, 0x08, 0x00, 0x08, 0x00, 0x08, 0x00, 0x08, 0x00, 0x08, 0x00, 0x08, 0xF4, 0x01,
///     0x00, 0xB4, 0xFF,
/// ]);
/// assert!(rest.is_empty());
/// let state = JointState { joints: [2048; 6], gripper: 500, status: MotionStatus::Idle };
/// assert_eq!(client.poll(now), Output::Event(Event::Answer(Response::Joints(state))));
/// assert_eq!(client.poll(now), Output::Timeout(None));
/// ```
///
/// A complete call, over any port that can be written and read with a timeout:
///
/// ```
/// use armwire::ling::{Ling, Request, Response};
/// use armwire::time::Instant;
/// use armwire::{Client, Event, Output};
///
/// trait Port {
///     fn now(&self) -> Instant;
///     fn write(&mut self, bytes: &[u8]) -> usize;
///     /// Waits for bytes until this time; 0 if none came.
///     fn read(&mut self, room: &mut [u8], until: Instant) -> usize;
/// }
///
/// /// Makes a request and returns the answer, if there is one.
/// fn call(client: &mut Client<Ling, 70>, port: &mut impl Port, request: &Request) -> Option<Response> {
///     client.cancel(); // a call that has failed
///     client.submit(request).ok()?;
///     loop {
///         match client.poll(port.now()) {
///             Output::Receive => {
///                 let n = port.read(client.space(), port.now());
///                 client.received(port.now(), n).ok()?;
///             }
///             Output::Transmit(bytes) => {
///                 let n = port.write(bytes);
///                 client.transmitted(port.now(), n).ok()?;
///             }
///             Output::Event(Event::Answer(response)) => return Some(response),
///             Output::Event(Event::Sent | Event::TimedOut { .. } | Event::Unacceptable(_)) => return None,
///             Output::Event(other) => println!("{other:?}"), // noise, for example, does not end the call
///             Output::Timeout(until) => {
///                 let n = port.read(client.space(), until?);
///                 client.received(port.now(), n).ok()?;
///             }
///         }
///     }
/// }
/// ```
pub struct Client<M: Messages, const N: usize> {
    messages: M,
    config: Config,
    decoder: Decoder<M, N>,
    outgoing: Outgoing<M, N>,
    /// Time of the last received byte.
    last_rx: Instant,
    /// The number of the last request.
    number: u16,
    /// The length of the last event's frame, while the decoder has its bytes; 0 for none.
    frame_len: usize,
    /// The time of the state in the last event's answer.
    time_of_state: Option<Instant>,
    /// The newest of these times.
    newest: Option<Instant>,
}

impl<M: Messages, const N: usize> Client<M, N> {
    /// An idle client.
    pub const fn new(messages: M, config: Config) -> Self {
        const { assert!(Fences::places::<M>() < SENDS, "too many fences") };
        Self {
            messages,
            config,
            decoder: Decoder::new(),
            outgoing: Outgoing {
                exchange: Exchange::new(match M::FENCES.is_empty() {
                    true => config.stale_window,
                    false if config.stale_window.as_micros() > STALL.as_micros() => config.stale_window,
                    false => STALL,
                }),
                call: None,
                fences: Fences::new(),
                offered: Instant::ZERO,
                info: None,
                tx: [0; N],
                len: 0,
                void: 0,
                is_echo_due: false,
            },
            last_rx: Instant::ZERO,
            number: 0,
            frame_len: 0,
            time_of_state: None,
            newest: None,
        }
    }

    /// Starts a request.
    ///
    /// # Errors
    ///
    /// [`SubmitError`] while another is in flight, or if the buffer is shorter than the request.
    ///
    /// ```
    /// # use armwire::ling::{Ling, Request};
    /// use armwire::{Client, Config, SubmitError};
    ///
    /// let mut client = Client::<Ling, 70>::new(Ling, Config::default());
    /// assert_eq!(client.submit(&Request::ReadJoints), Ok(()));
    /// assert_eq!(client.submit(&Request::ReadInfo), Err(SubmitError::Busy));
    /// ```
    pub fn submit(&mut self, request: &M::Request<'_>) -> Result<(), SubmitError> {
        self.start(request, false)
    }

    /// Starts a reading, as one of many at a steady rate. It is not repeated, and does not wait for the answer to an
    /// earlier one that was cancelled or has timed out: a lost answer does not delay the next reading. Up to seven readings
    /// may be without an answer, for a line whose round trip is longer than the time between two.
    ///
    /// Each answer is that of the oldest reading without one: [`Event::Late`] if that was cancelled. After a lost answer, a
    /// fence goes out before the next reading, and shows the loss. Until then [`time_of_state`](Self::time_of_state) is
    /// that of the earlier reading, if it took more than 10 ms.
    ///
    /// # Errors
    ///
    /// As of [`submit`](Self::submit), and [`SubmitError::NotARead`] for a request with another
    /// [effect](crate::correlation::Effect), or with an undocumented one: an earlier confirmation must not stand for its
    /// own.
    ///
    /// ```
    /// # use armwire::ling::{Ling, Request};
    /// # use armwire::time::Instant;
    /// # use armwire::{Client, Config, Output};
    /// # /// Returns the number of bytes that go out.
    /// # fn transmit(client: &mut Client<Ling, 70>) -> usize {
    /// #     let (mut sent, now) = (0, Instant::ZERO);
    /// #     loop {
    /// #         match client.poll(now) {
    /// #             Output::Receive => client.received(now, 0).unwrap(),
    /// #             Output::Transmit(bytes) => {
    /// #                 let n = bytes.len();
    /// #                 sent += n;
    /// #                 client.transmitted(now, n).unwrap();
    /// #             }
    /// #             Output::Event(_) | Output::Timeout(_) => return sent,
    /// #         }
    /// #     }
    /// # }
    /// let mut client = Client::<Ling, 70>::new(Ling, Config::default());
    /// client.submit_reading(&Request::ReadJoints).unwrap();
    /// assert_eq!(transmit(&mut client), 14, "a fence, and the reading");
    /// // Its answer is lost, and the next reading is due.
    /// client.cancel();
    /// client.submit_reading(&Request::ReadJoints).unwrap();
    /// assert_eq!(transmit(&mut client), 7);
    /// ```
    pub fn submit_reading(&mut self, request: &M::Request<'_>) -> Result<(), SubmitError> {
        self.start(request, true)
    }

    /// Starts a request, or leaves the client idle.
    fn start(&mut self, request: &M::Request<'_>, is_reading: bool) -> Result<(), SubmitError> {
        if !self.is_idle() {
            return Err(SubmitError::Busy);
        }
        let out = &mut self.outgoing;
        out.len = self
            .messages
            .encode_request(request, &mut out.tx)
            .map_err(|error| match error.into() {
                EncodeError::BufferTooShort(error) => SubmitError::TooLong(error),
                EncodeError::OutOfRange(error) => SubmitError::OutOfRange(error),
            })?;
        let frame = out.tx.get_mut(..out.len).unwrap_or_default();
        let number = self.number.checked_add(1).unwrap_or(1);
        self.messages.stamp(frame, number);
        out.info = self.messages.request(frame);
        if is_reading && !out.is_read() {
            return Err(SubmitError::NotARead);
        }
        self.number = number;
        out.call = Some(Call {
            state: State::Ready,
            blocked: None,
            sends: 0,
            repeats: if is_reading { 0 } else { self.config.repeats },
            is_reading,
            is_cancelled: false,
        });
        Ok(())
    }

    /// Cancels the request in flight, if there is one.
    ///
    /// An unstarted request is never sent, a partly transmitted one is never executed (see [`Client`]), and the answer
    /// to a transmitted one becomes [`Event::Late`]. Another request may be submitted at once.
    ///
    /// A partly transmitted request that cannot be [voided](crate::framing::Framing::VOID) stays in flight until all of it
    /// is transmitted. The arm executes it, and [`Event::Sent`] reports that.
    ///
    /// ```
    /// # use armwire::ling::{Ling, Request};
    /// # use armwire::time::Instant;
    /// # use armwire::{Client, Config, Output};
    /// # let mut client = Client::<Ling, 70>::new(Ling, Config::default());
    /// client.submit(&Request::ReadJoints).unwrap();
    /// client.cancel();
    /// assert_eq!(client.poll(Instant::ZERO), Output::Timeout(None));
    /// ```
    pub fn cancel(&mut self) {
        let is_late = self.outgoing.must_complete();
        match &mut self.outgoing.call {
            Some(call) if is_late => call.is_cancelled = true,
            Some(_) => self.outgoing.end(),
            None => {}
        }
    }

    /// Returns true if a request may be submitted: none is in flight.
    pub const fn is_idle(&self) -> bool {
        self.outgoing.call.is_none()
    }

    /// Returns true if an answer to the request in flight is expected.
    pub fn expects_answer(&self) -> bool {
        self.outgoing.call.is_some() && self.outgoing.info.is_some_and(|info| info.response.is_some())
    }

    /// The protocol.
    pub const fn messages(&self) -> &M {
        &self.messages
    }

    /// The protocol, for changes that apply to later requests.
    pub const fn messages_mut(&mut self) -> &mut M {
        &mut self.messages
    }

    /// Free space for a read or DMA. Report the number of bytes with [`received`](Self::received). Never empty once
    /// [`poll`](Self::poll) has returned anything but an event.
    pub fn space(&mut self) -> &mut [u8] {
        self.frame_len = 0;
        self.decoder.space()
    }

    /// The first `n` bytes of [`space`](Self::space) arrived. 0 after [`Output::Receive`]: the port is empty.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] if `n` exceeds the free space. Nothing is accepted then.
    pub fn received(&mut self, now: Instant, n: usize) -> Result<(), OutOfRange<usize>> {
        self.decoder.commit(n)?;
        self.on_received(now, n);
        Ok(())
    }

    /// Copies in as many of the received bytes as fit and returns the rest: poll until there is no event, then pass in
    /// the rest. No bytes after [`Output::Receive`]: the port is empty.
    #[must_use = "the bytes that did not fit are returned"]
    pub fn receive<'b>(&mut self, now: Instant, bytes: &'b [u8]) -> &'b [u8] {
        self.frame_len = 0;
        let rest = self.decoder.push(bytes);
        let n = bytes.len().saturating_sub(rest.len());
        if n > 0 || bytes.is_empty() {
            self.on_received(now, n);
        }
        rest
    }

    fn on_received(&mut self, now: Instant, n: usize) {
        if n > 0 {
            self.last_rx = now;
        }
        self.outgoing.received(n);
    }

    /// The UART reported an idle line. Never call this for a gap between USB packets or TCP segments.
    pub const fn idle(&mut self) {
        self.decoder.idle();
    }

    /// The frame of the last event, if it has one. Empty after any other output of [`poll`](Self::poll), and from the
    /// next [`space`](Self::space) or [`receive`](Self::receive) on.
    ///
    /// It has all bytes of an answer, including those that the response does not contain.
    pub fn frame(&self) -> &[u8] {
        self.decoder.taken(self.frame_len)
    }

    /// The time of the state in the answer of the last event, also of a late one: that of its receipt if it took at most
    /// 10 ms, else that of its request, for the line may have held it back. Always after that of an earlier answer. `None`
    /// after any other output of [`poll`](Self::poll).
    pub const fn time_of_state(&self) -> Option<Instant> {
        self.time_of_state
    }

    /// Returns true if the order of answers shows which are lost: the arm answers [fences](Messages::FENCES), or it is not
    /// known yet. False for a protocol without them.
    pub const fn has_fences(&self) -> bool {
        self.outgoing.fences.are_on::<M>()
    }

    /// The number of answers that came out of order. After the first, only time shows which are lost.
    pub const fn out_of_order(&self) -> u16 {
        self.outgoing.exchange.out_of_order()
    }

    /// The port accepted the first `n` bytes of [`Output::Transmit`]. Call it before a flush, which may fail or be
    /// dropped: accepted bytes count.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] if `n` exceeds the remaining bytes. Nothing counts as transmitted then.
    pub fn transmitted(&mut self, now: Instant, n: usize) -> Result<(), OutOfRange<usize>> {
        let out = &mut self.outgoing;
        let left = out.pending().len();
        if n > left {
            return Err(OutOfRange::new("transmitted", "bytes", n, 0, left));
        }
        out.transmitted(&self.messages, n, &self.config, self.decoder.received(), now);
        Ok(())
    }

    /// Returns the next action. Call it again after an event, after bytes were received or transmitted, and at the
    /// returned time.
    pub fn poll(&mut self, now: Instant) -> Output<'_, M::Response<'_>> {
        (self.frame_len, self.time_of_state) = (0, None);
        let out = &mut self.outgoing;
        if out.call.as_ref().is_some_and(|call| call.state == State::Sent) {
            out.call = None;
            return Output::Event(Event::Sent);
        }
        if out.must_complete() {
            out.offered = now;
            return Output::Transmit(self.outgoing.pending());
        }
        let out = &self.outgoing;
        // Silence rejects a false header that delays the answer, and completes an answer that only silence ends.
        let due = out.due();
        if due.is_some_and(|due| due <= now) && self.last_rx + self.config.latency <= now {
            self.decoder.idle();
        }
        loop {
            let expect = self.outgoing.exchange.expect(&self.messages);
            let Some(span) = self.decoder.advance_to_event(&self.messages, expect) else {
                break;
            };
            if self.messages.echoes() && self.outgoing.take_echo(self.decoder.item(span).bytes) {
                self.frame_len = span.len();
                return Output::Event(Event::Echo);
            }
            let matched = self.assign(span, now);
            if !matches!(matched, Some(Match::Late { who: Who::Fence, .. })) {
                return Output::Event(self.event(span, expect, matched));
            }
        }
        // After decoding, because bytes may have arrived long before they were passed in; and not between the read of
        // the port and the end of the request, because an answer may have arrived there since.
        if !self.outgoing.is_writing() {
            self.outgoing.exchange.expire(now);
        }
        if M::LOSSLESS && self.outgoing.void > 0 {
            // Every byte arrives: nothing makes the arm discard a part of a frame.
            self.decoder.break_off(Reason::Abandoned);
        }
        if let Some((offset, reason)) = self.decoder.broken() {
            return match self.outgoing.stop() {
                true => Output::Event(Event::Broken { offset, reason }),
                false => Output::Timeout(None),
            };
        }
        if let Some(until) = self.overdue_at() {
            if now < until {
                return Output::Timeout(Some(until));
            }
            if let Some(sends) = self.outgoing.give_up() {
                return Output::Event(Event::TimedOut { sends });
            }
        }
        let out = &mut self.outgoing;
        if out.void == 0 {
            out.start(&self.messages, &self.config, now);
        }
        let end = out.end_of_wait(&self.config);
        if end.is_some_and(|end| end <= now) && out.pending().is_empty() {
            out.end();
            return Output::Event(Event::TimedOut { sends: 0 });
        }
        out.offered = now;
        let bytes = out.pending();
        match out.call.as_ref().map(|call| call.state) {
            _ if !bytes.is_empty() => Output::Transmit(bytes),
            Some(State::Reading(_)) => Output::Receive,
            Some(_) => {
                let fence = end.map(|_| out.fences.due());
                Output::Timeout(out.exchange.timeout().into_iter().chain(end).chain(fence).min())
            }
            None => Output::Timeout(None),
        }
    }

    /// The time at which the answer to the request in flight is overdue. A partly received answer has one more
    /// [`Config::latency`], for its next packet.
    fn overdue_at(&self) -> Option<Instant> {
        let due = self.outgoing.due()?;
        match self.decoder.pending() {
            0 => Some(due),
            _ => Some(due.max(self.last_rx.min(due) + self.config.latency)),
        }
    }

    /// Assigns a frame to the request that it answers. `None` if the item is no frame.
    fn assign(&mut self, span: Span, now: Instant) -> Option<Match<Who>> {
        let Item { offset, kind, bytes } = self.decoder.item(span);
        if !matches!(kind, Kind::Frame | Kind::Padding) {
            return None;
        }
        let out = &mut self.outgoing;
        let has_fences = !M::FENCES.is_empty();
        let fences = if has_fences {
            out.exchange.missing_answers_of(Who::Fence)
        } else {
            0
        };
        let first = FirstByte { offset, at: None };
        let matched = out.exchange.on_frame(&self.messages, bytes, first, now);
        match matched {
            Match::Answer { sent, .. } | Match::Late { who: Who::Call, sent } => {
                // The state is newer than that of the answer before.
                let least = self
                    .newest
                    .map_or(Instant::ZERO, |newest| newest + Duration::from_micros(1));
                self.newest = Some(time_of_state(sent, self.last_rx).max(least));
                self.time_of_state = self.newest;
            }
            Match::Late { who: Who::Fence, .. } | Match::Unsolicited => {}
        }
        if let Match::Answer { .. } = matched {
            out.end();
        }
        if has_fences {
            out.update_fences(matched, fences, &self.config, now);
        }
        Some(matched)
    }

    /// The event of an item, which answers this request if it is a frame.
    fn event(&mut self, span: Span, expect: M::Expect, matched: Option<Match<Who>>) -> Event<'_, M::Response<'_>> {
        let Item { offset, kind, bytes } = self.decoder.item(span);
        let matched = match (kind, matched) {
            (Kind::Noise(reason), _) => return Event::Noise { offset, bytes, reason },
            (Kind::Broken(reason), _) => {
                self.outgoing.stop();
                return Event::Broken { offset, reason };
            }
            (Kind::Frame | Kind::Padding, matched) => matched.unwrap_or(Match::Unsolicited),
        };
        self.frame_len = bytes.len();
        match (matched, self.messages.parse_response(bytes, expect)) {
            (Match::Answer { .. }, Ok(response)) => Event::Answer(response),
            (Match::Answer { .. }, Err(error)) => match error.cause {
                Cause::ErrorFrame => Event::ErrorFrame { frame: bytes },
                _ => Event::Unacceptable(error),
            },
            (Match::Late { .. }, Ok(response)) => Event::Late(response),
            (Match::Unsolicited, Ok(response)) => Event::Unsolicited(response),
            (Match::Unsolicited, Err(_)) if self.messages.is_request(bytes) => Event::Echo,
            (Match::Late { .. } | Match::Unsolicited, Err(error)) => Event::Unknown { frame: bytes, error },
        }
    }
}

impl<M: Messages, const N: usize> fmt::Debug for Client<M, N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Client")
            .field("config", &self.config)
            .field("decoder", &self.decoder)
            .field("idle", &self.is_idle())
            .finish_non_exhaustive()
    }
}
