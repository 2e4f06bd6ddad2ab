//! The host's side: one request at a time, time as an input, no I/O.

use core::fmt;
use core::num::NonZeroU32;

use thiserror::Error;

use crate::decoder::{Decoder, Item, Kind, Span};
use crate::dialect::{Effect, InfoOf, ResponseTiming};
use crate::exchange::{Exchange, FirstByte, Handover, Match};
use crate::framing::Reason;
use crate::messages::Messages;
use crate::time::{Duration, Instant};
use crate::{BufferTooShort, OutOfRange, ParseError};

/// Sends that may be unresolved: the one in flight, and stale ones.
const SENDS: usize = 4;

/// The timing of a [`Client`].
///
/// ```
/// use core::num::NonZeroU32;
/// use armwire::Config;
/// use armwire::time::Duration;
///
/// // Bluetooth serial: slow, and late at times.
/// const BAUD: NonZeroU32 = NonZeroU32::new(115_200).unwrap();
/// let config = Config { baud: BAUD, latency: Duration::from_millis(150), ..Config::default() };
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Config {
    /// Baud rate of the line, which gives the time of messages on it; `NonZeroU32::MAX` for a line without one.
    pub baud: NonZeroU32,
    /// The longest that the way to the line and back may delay an answer: USB and operating system, or nothing.
    pub latency: Duration,
    /// The number of repeats of a request that only reads and gets no answer.
    pub repeats: u8,
    /// The time after its due time in which an answer may still arrive. After a missing answer, the next request with the
    /// same answer waits for this time, unless answers are numbered. An arm that is later than this can be mixed up.
    pub stale_window: Duration,
}

impl Default for Config {
    fn default() -> Self {
        Self::DEFAULT
    }
}

impl Config {
    /// 1 Mbaud over USB: 10 ms of latency, two repeats, answers up to 100 ms late.
    pub const DEFAULT: Self = Self {
        baud: NonZeroU32::new(1_000_000).unwrap(),
        latency: Duration::from_millis(10),
        repeats: 2,
        stale_window: Duration::from_millis(100),
    };

    /// A TCP connection in a local network: 100 ms of latency, no repeats, for TCP repeats by itself, and answers up to a second
    /// late.
    pub const TCP: Self = Self {
        baud: NonZeroU32::MAX,
        latency: Duration::from_millis(100),
        repeats: 0,
        stale_window: Duration::from_millis(1_000),
    };

    /// The time that `len` bytes take on the line, ten bits a byte.
    fn on_wire(&self, len: usize) -> Duration {
        // The time of a byte at 1 baud, in µs. In two parts, as a division of 64 bits is long for a microcontroller.
        const BYTE: u32 = 10_000_000;
        let (len, baud) = (u32::try_from(len).unwrap_or(u32::MAX), self.baud);
        let whole = u64::from(len) * u64::from(BYTE / baud);
        // Less than 1 µs a byte.
        let rest = len
            .checked_mul(BYTE % baud)
            .map_or(len, |rest| rest.div_ceil(baud.get()));
        Duration::from_micros(whole + u64::from(rest))
    }

    /// The time to wait for an answer, from the handover of the last of `len` bytes of its request.
    fn patience(&self, len: usize, response: ResponseTiming) -> Duration {
        self.on_wire(len.saturating_add(response.longest.into())) + response.turnaround + self.latency
    }
}

/// The next step of a [`Client`]'s caller. `R` is the protocol's response.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Output<'a, R> {
    /// These bytes are to be transmitted. Say with [`transmitted`](Client::transmitted) how many the line took.
    Transmit(&'a [u8]),
    /// An event.
    Event(Event<'a, R>),
    /// Nothing to do before bytes arrive or this time is reached; `None` if there is nothing to wait for.
    Timeout(Option<Instant>),
}

/// An event on the line.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Event<'a, R> {
    /// The answer to the request in flight, which is done.
    Answer(R),
    /// The answer to the request in flight has a value or a length that the protocol does not have, for this reason. The
    /// request is done, and is not repeated: the arm would answer the same.
    Unacceptable(ParseError),
    /// The request in flight, which the arm does not answer, is with the line: it is done.
    Sent,
    /// The request in flight got no answer and is given up.
    TimedOut {
        /// The number of times that it was sent.
        sends: u8,
    },
    /// An answer to a request that was given up, cancelled, or answered before.
    Late(R),
    /// A response that answers nothing.
    Unsolicited(R),
    /// A request: the line gave it back, or another host is on it.
    Echo,
    /// A good frame that is no message of the protocol, and not the answer to the request in flight.
    Unknown {
        /// The frame.
        frame: &'a [u8],
        /// The reason.
        error: ParseError,
    },
    /// Bytes that are not part of a frame.
    Noise {
        /// The place of the first byte, in bytes since the client was made.
        offset: u64,
        /// The bytes. A run of noise may come in several events.
        bytes: &'a [u8],
        /// The reason.
        reason: Reason,
    },
    /// A lossless stream broke here: nothing after this can be read, the request in flight if any is given up, and so is every
    /// later one. Close the connection.
    Broken {
        /// The place of the break, in bytes since the client was made.
        offset: u64,
        /// The reason.
        reason: Reason,
    },
}

/// The reason for which a request was not accepted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum SubmitError {
    /// Another request is in flight, or the rest of a cancelled one is still to be transmitted.
    #[error("a request is already in flight")]
    Busy,
    /// The client's buffer is shorter than the request.
    #[error(transparent)]
    TooLong(BufferTooShort),
}

/// The request in flight.
struct Call {
    state: State,
    /// The number of times that all of it was sent.
    sends: u8,
    /// The number of repeats left.
    repeats: u8,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum State {
    /// Not sent yet, or to be sent again.
    Ready,
    /// Its bytes are being transmitted.
    Writing,
    /// All sent; an answer is expected.
    Waiting,
    /// All sent; no answer is expected.
    Sent,
}

/// The outgoing frame and its possible answers.
struct Outgoing<M: Messages, const N: usize> {
    exchange: Exchange<M, (), SENDS>,
    call: Option<Call>,
    /// The part of the frame in `tx` in its exchange. `None` before the first.
    info: Option<InfoOf<M>>,
    tx: [u8; N],
    /// The frame: `tx[..len]`.
    len: usize,
    /// The number of its bytes that were transmitted, while it is being transmitted: the rest of a frame goes out even if its
    /// call has ended.
    at: Option<usize>,
}

impl<M: Messages, const N: usize> Outgoing<M, N> {
    /// Ends the request in flight. Answers to what was sent of it are stale from now on.
    fn end(&mut self) {
        self.call = None;
        self.exchange.give_up(());
        if self.at == Some(0) {
            self.at = None;
        }
    }

    /// Nothing is transmitted any more, not even the rest of a request: the arm would do what was given up.
    fn stop(&mut self) -> bool {
        self.at = None;
        self.call.take().is_some()
    }

    /// The bytes to transmit, if the request in flight may go.
    fn start(&mut self) {
        let Some(call) = self.call.as_mut().filter(|call| call.state == State::Ready) else {
            return;
        };
        // A repeat is of the same call, and waits for nothing.
        let may = match &self.info {
            Some(info) if call.sends == 0 => self.exchange.can_send(info, ()),
            _ => true,
        };
        if may && self.at.is_none() {
            call.state = State::Writing;
            self.at = Some(0);
        }
    }

    /// All of the frame was transmitted.
    fn sent(&mut self, config: &Config, handed: u64, now: Instant) {
        self.at = None;
        let call = self.call.as_mut().filter(|call| call.state == State::Writing);
        let response = self.info.and_then(|info| info.response);
        let (Some(info), Some(response)) = (self.info, response) else {
            if let Some(call) = call {
                call.state = State::Sent;
            }
            return;
        };
        let handover = Handover {
            offset: handed,
            at: now,
            due: now + config.patience(self.len, response),
        };
        self.exchange.repeat(info, (), handover);
        match call {
            Some(call) => {
                call.sends = call.sends.saturating_add(1);
                call.state = State::Waiting;
            }
            // The end of a request whose call has ended: only now can its answer come.
            None => self.exchange.give_up(()),
        }
    }

    /// When the answer to the request in flight is due.
    fn due(&self) -> Option<Instant> {
        let waiting = self.call.as_ref().is_some_and(|call| call.state == State::Waiting);
        self.exchange.due(()).filter(|_| waiting)
    }

    /// The answer is missing: the request is sent again, or has timed out after the returned number of sends.
    fn give_up(&mut self) -> Option<u8> {
        let call = self.call.as_mut()?;
        if call.repeats > 0 && self.info.is_some_and(|info| info.effect == Effect::Read) {
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
/// One request is in flight at a time. Bytes go in by [`space`](Self::space) and [`received`](Self::received), or by
/// [`receive`](Self::receive), time by [`poll`](Self::poll), which says what to do next: transmit, take an event, or wait. It
/// does no I/O and reads no clock, so it runs in an interrupt, in a task, or in a test in no time at all. 260 bytes hold every
/// message of every protocol; a frame that is longer than `N` is noise.
///
/// A late answer never satisfies the next request: when an answer to an earlier request may still come (it timed out, was
/// repeated, or was cancelled), the next request with the same key waits until it came or [`Config::stale_window`] is over.
/// Requests without an answer, such as torque off, never wait, and none does where answers are numbered; the client numbers its
/// requests. For this to hold, put in what has arrived before you transmit: bytes that waited in a port's buffer are as old as
/// they are, whenever they are read.
///
/// ```
/// use armwire::ling::{JointState, Ling, MotionStatus, Request, Response};
/// use armwire::time::Instant;
/// use armwire::{Client, Config, Event, Output};
///
/// let mut client = Client::<Ling, 70>::new(Ling, Config::default());
/// client.submit(&Request::ReadJoints).unwrap();
/// let now = Instant::ZERO;
/// let Output::Transmit(bytes) = client.poll(now) else { panic!("nothing to transmit") };
/// assert_eq!(bytes, [0xAA, 0x06, 0x00, 0x01, 0xFE, 0x9A, 0xFF]);
/// let n = bytes.len(); // what the port took
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
/// A whole call, over anything that can be read with a time-out and written:
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
///     // What has arrived belongs to what was before.
///     let n = port.read(client.space(), port.now());
///     client.received(port.now(), n).ok()?;
///     client.submit(request).ok()?;
///     loop {
///         match client.poll(port.now()) {
///             Output::Transmit(bytes) => {
///                 let n = port.write(bytes);
///                 client.transmitted(port.now(), n).ok()?;
///             }
///             Output::Event(Event::Answer(response)) => return Some(response),
///             Output::Event(Event::Sent | Event::TimedOut { .. } | Event::Unacceptable(_)) => return None,
///             Output::Event(other) => println!("{other:?}"), // noise and the like end nothing
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
    decoder: Decoder<N>,
    outgoing: Outgoing<M, N>,
    /// When bytes last arrived.
    last_rx: Instant,
    /// The number of the last request.
    number: u16,
}

impl<M: Messages, const N: usize> Client<M, N> {
    /// An idle client.
    pub const fn new(messages: M, config: Config) -> Self {
        Self {
            messages,
            config,
            decoder: Decoder::new(),
            outgoing: Outgoing {
                exchange: Exchange::new(config.stale_window),
                call: None,
                info: None,
                tx: [0; N],
                len: 0,
                at: None,
            },
            last_rx: Instant::ZERO,
            number: 0,
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
        if !self.is_idle() {
            return Err(SubmitError::Busy);
        }
        let out = &mut self.outgoing;
        out.len = self
            .messages
            .encode_request(request, &mut out.tx)
            .map_err(SubmitError::TooLong)?;
        let frame = out.tx.get_mut(..out.len).unwrap_or_default();
        self.number = self.number.checked_add(1).unwrap_or(1);
        self.messages.stamp(frame, self.number);
        out.info = self.messages.request(frame);
        out.call = Some(Call {
            state: State::Ready,
            sends: 0,
            repeats: self.config.repeats,
        });
        Ok(())
    }

    /// Gives up the request in flight, if there is one.
    ///
    /// If it was not begun it is never sent. If it was, its remaining bytes are still to be transmitted, so that the arm is not
    /// left with half a frame, and its answer will be [`Event::Late`].
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
        if self.outgoing.call.is_some() {
            self.outgoing.end();
        }
    }

    /// Whether a request may be submitted: none is in flight, and nothing is left of a cancelled one.
    pub const fn is_idle(&self) -> bool {
        self.outgoing.call.is_none() && self.outgoing.at.is_none()
    }

    /// Whether the request in flight has an answer to wait for.
    pub fn expects_answer(&self) -> bool {
        self.outgoing.call.is_some() && self.outgoing.info.is_some_and(|info| info.response.is_some())
    }

    /// The protocol.
    pub const fn messages(&self) -> &M {
        &self.messages
    }

    /// The protocol, to change what its next requests are like.
    pub const fn messages_mut(&mut self) -> &mut M {
        &mut self.messages
    }

    /// Room to read or DMA into; say with [`received`](Self::received) how many bytes arrived. Never empty once
    /// [`poll`](Self::poll) has returned anything but an event.
    pub fn space(&mut self) -> &mut [u8] {
        self.decoder.space()
    }

    /// The first `n` bytes of [`space`](Self::space) arrived.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] when that is more than there is room for. Nothing is accepted then.
    pub fn received(&mut self, now: Instant, n: usize) -> Result<(), OutOfRange<usize>> {
        if n > 0 {
            self.last_rx = now;
        }
        self.decoder.commit(n)
    }

    /// Copies in as much of the bytes that arrived as there is room for and returns the rest: poll until there is no event, then
    /// put it in.
    #[must_use = "bytes for which there is no room are returned"]
    pub fn receive<'b>(&mut self, now: Instant, bytes: &'b [u8]) -> &'b [u8] {
        if !bytes.is_empty() {
            self.last_rx = now;
        }
        self.decoder.push(bytes)
    }

    /// The UART reported an idle line. Never call it for a gap between USB packets or TCP segments.
    pub const fn idle(&mut self) {
        self.decoder.idle();
    }

    /// The line took the first `n` bytes of what was to be transmitted.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] when `n` is more than what is left. Nothing is taken for transmitted then.
    pub fn transmitted(&mut self, now: Instant, n: usize) -> Result<(), OutOfRange<usize>> {
        let out = &mut self.outgoing;
        let left = out.at.map_or(0, |at| out.len.saturating_sub(at));
        if n > left {
            return Err(OutOfRange::new("transmitted", "bytes", n, 0, left));
        }
        if n < left {
            out.at = out.at.map(|at| at.saturating_add(n));
        } else if left > 0 {
            out.sent(&self.config, self.decoder.received(), now);
        }
        Ok(())
    }

    /// The next step. Call it again after an event, once bytes arrived or were transmitted, and at the time it gives.
    pub fn poll(&mut self, now: Instant) -> Output<'_, M::Response<'_>> {
        let out = &mut self.outgoing;
        if out.call.as_ref().is_some_and(|call| call.state == State::Sent) {
            out.call = None;
            return Output::Event(Event::Sent);
        }
        // A false header may be holding the answer back. After this silence it is no frame. Or it is an answer whose end only
        // silence can tell.
        let due = out.due();
        if due.is_some_and(|due| due <= now) && self.last_rx + self.config.latency <= now {
            self.decoder.idle();
        }
        let expect = self.outgoing.exchange.expect(&self.messages);
        if let Some(span) = self.decoder.advance_to_event(&self.messages, expect) {
            return Output::Event(self.event(span, expect, now));
        }
        // Only now, for bytes may have arrived long before they were put in.
        self.outgoing.exchange.expire(now);
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
        out.start();
        match (out.at, &out.call) {
            (Some(at), _) => Output::Transmit(out.tx.get(at..out.len).unwrap_or_default()),
            (None, Some(_)) => Output::Timeout(out.exchange.timeout()),
            (None, None) => Output::Timeout(None),
        }
    }

    /// When the answer to the request in flight is given up. If one has begun, its end gets the time that one more packet takes.
    fn overdue_at(&self) -> Option<Instant> {
        let due = self.outgoing.due()?;
        match self.decoder.pending() {
            0 => Some(due),
            _ => Some(due.max(self.last_rx.min(due) + self.config.latency)),
        }
    }

    /// The event of an item.
    fn event(&mut self, span: Span, expect: M::Expect, now: Instant) -> Event<'_, M::Response<'_>> {
        let Item { offset, kind, bytes } = self.decoder.item(span);
        match kind {
            Kind::Noise(reason) => return Event::Noise { offset, bytes, reason },
            Kind::Broken(reason) => {
                self.outgoing.stop();
                return Event::Broken { offset, reason };
            }
            Kind::Frame | Kind::Padding => {}
        }
        let first = FirstByte { offset, at: None };
        let matched = self.outgoing.exchange.on_frame(&self.messages, bytes, first, now);
        if let Match::Answer { .. } = matched {
            self.outgoing.end();
        }
        match (matched, self.messages.parse_response(bytes, expect)) {
            (Match::Answer { .. }, Ok(response)) => Event::Answer(response),
            (Match::Answer { .. }, Err(error)) => Event::Unacceptable(error),
            (Match::Late(()), Ok(response)) => Event::Late(response),
            (Match::Unsolicited, Ok(response)) => Event::Unsolicited(response),
            (Match::Unsolicited, Err(_)) if !M::LOSSLESS && self.messages.parse_request(bytes).is_ok() => Event::Echo,
            (Match::Late(()) | Match::Unsolicited, Err(error)) => Event::Unknown { frame: bytes, error },
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
