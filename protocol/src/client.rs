//! The host's side: one request in flight, time as an input, no I/O.

use core::fmt;
use core::num::NonZeroU32;

use crate::{Decoder, Micros, Noise, OutOfRange, Protocol};

/// What happened outside.
#[derive(Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Input<'a> {
    /// Bytes arrived. They are taken from the front; what is left was not looked at yet.
    Bytes(&'a [u8]),
    /// The UART reported an idle line. Never a gap between USB packets or TCP segments.
    Idle,
    /// Nothing but time passed.
    Tick,
}

/// How a [`Client`] treats its line.
///
/// ```
/// use core::num::NonZeroU32;
/// use armwire::{Config, Micros};
///
/// // Bluetooth serial: slow, and late at times.
/// const BAUD: NonZeroU32 = NonZeroU32::new(115_200).unwrap();
/// let config = Config { baud: BAUD, latency: Micros::from_millis(150), ..Config::default() };
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Config {
    /// Baud rate of the line, which says how long messages take on it; `NonZeroU32::MAX` where there is none.
    pub baud: NonZeroU32,
    /// The most that the way to the line and back may add to an answer: USB and operating system, or nothing.
    pub latency: Micros,
    /// How often a request that may be repeated is sent again after silence.
    pub repeats: u8,
    /// How long after it was due an answer may still arrive. So long the next request that wants an answer is held back
    /// when an answer is missing, unless answers say what they answer ([`Protocol::IDENTIFIED`]). It is the price of a
    /// damaged answer too: whether it was lost or is late cannot be told.
    pub lateness: Micros,
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
        latency: Micros::from_millis(10),
        repeats: 2,
        lateness: Micros::from_millis(100),
    };

    /// A TCP connection in a local network: an answer takes 100 ms at most besides the arm's own time, and nothing is
    /// repeated, for TCP does so.
    pub const TCP: Self = Self {
        baud: NonZeroU32::MAX,
        latency: Micros::from_millis(100),
        repeats: 0,
        lateness: Micros::from_millis(1_000),
    };

    /// The time that `len` bytes take on the line, ten bits a byte.
    fn on_wire(&self, len: usize) -> Micros {
        // What a byte takes at 1 baud, in µs. In two parts, as a division of 64 bits is long for a microcontroller.
        const BYTE: u32 = 10_000_000;
        let (len, baud) = (u32::try_from(len).unwrap_or(u32::MAX), self.baud.get());
        let whole = u64::from(len) * u64::from(BYTE / baud);
        // Less than 1 µs a byte.
        let rest = len.checked_mul(BYTE % baud).map_or(len, |rest| rest.div_ceil(baud));
        Micros(whole + u64::from(rest))
    }
}

/// What a [`Client`] has to say.
pub enum Event<P: Protocol> {
    /// The answer to the request in flight, which is done.
    Answer(P::Response),
    /// The answer to the request in flight has a value or a length that the protocol does not have, for this reason. The
    /// request is done, and is not repeated: the arm would answer the same.
    Unacceptable(P::Error),
    /// The request in flight, which the arm does not answer, is with the line: it is done.
    Sent,
    /// The request in flight got no answer and is given up.
    TimedOut {
        /// How often it was sent.
        sends: u8,
    },
    /// An answer to a request that was given up, cancelled, or answered before. Where nothing is held back
    /// ([`Protocol::IDENTIFIED`]), only to the last of them: answers to those before it are
    /// [`Unsolicited`](Self::Unsolicited).
    Late(P::Response),
    /// A response that answers nothing.
    Unsolicited(P::Response),
    /// A request: the line gave it back, or another host is on it. A [`RELIABLE`](crate::Framing::RELIABLE) line gives none
    /// back.
    Echo,
    /// A good frame that is no message of the protocol, and not the answer to the request in flight.
    Unknown(P::Error),
    /// Bytes that are not part of a frame.
    Noise(Noise),
    /// Bytes that break a [`RELIABLE`](crate::Framing::RELIABLE) line: nothing after them can be read, the request in flight
    /// if any is given up, and so is every later one. Close the connection.
    Broken(Noise),
}

impl<P: Protocol> fmt::Debug for Event<P> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Answer(response) => f.debug_tuple("Answer").field(response).finish(),
            Self::Unacceptable(error) => f.debug_tuple("Unacceptable").field(error).finish(),
            Self::Sent => f.write_str("Sent"),
            Self::TimedOut { sends } => f.debug_struct("TimedOut").field("sends", sends).finish(),
            Self::Late(response) => f.debug_tuple("Late").field(response).finish(),
            Self::Unsolicited(response) => f.debug_tuple("Unsolicited").field(response).finish(),
            Self::Echo => f.write_str("Echo"),
            Self::Unknown(error) => f.debug_tuple("Unknown").field(error).finish(),
            Self::Noise(noise) => f.debug_tuple("Noise").field(noise).finish(),
            Self::Broken(noise) => f.debug_tuple("Broken").field(noise).finish(),
        }
    }
}

#[cfg(feature = "defmt")]
impl<P: Protocol> defmt::Format for Event<P>
where
    P::Response: defmt::Format,
    P::Error: defmt::Format,
{
    fn format(&self, f: defmt::Formatter<'_>) {
        match self {
            Self::Answer(response) => defmt::write!(f, "Answer({})", response),
            Self::Unacceptable(error) => defmt::write!(f, "Unacceptable({})", error),
            Self::Sent => defmt::write!(f, "Sent"),
            Self::TimedOut { sends } => defmt::write!(f, "TimedOut {{ sends: {} }}", sends),
            Self::Late(response) => defmt::write!(f, "Late({})", response),
            Self::Unsolicited(response) => defmt::write!(f, "Unsolicited({})", response),
            Self::Echo => defmt::write!(f, "Echo"),
            Self::Unknown(error) => defmt::write!(f, "Unknown({})", error),
            Self::Noise(noise) => defmt::write!(f, "Noise({})", noise),
            Self::Broken(noise) => defmt::write!(f, "Broken({})", noise),
        }
    }
}

impl<P: Protocol> Clone for Event<P> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<P: Protocol> Copy for Event<P> {}

impl<P: Protocol> PartialEq for Event<P> {
    fn eq(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Answer(a), Self::Answer(b))
            | (Self::Late(a), Self::Late(b))
            | (Self::Unsolicited(a), Self::Unsolicited(b)) => a == b,
            (Self::Sent, Self::Sent) | (Self::Echo, Self::Echo) => true,
            (Self::TimedOut { sends: a }, Self::TimedOut { sends: b }) => a == b,
            (Self::Unknown(a), Self::Unknown(b)) | (Self::Unacceptable(a), Self::Unacceptable(b)) => a == b,
            (Self::Noise(a), Self::Noise(b)) | (Self::Broken(a), Self::Broken(b)) => a == b,
            _ => false,
        }
    }
}

/// A request came while another was in flight; here it is back.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Busy<R>(pub R);

impl<R> fmt::Display for Busy<R> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a request is already in flight")
    }
}

impl<R: fmt::Debug> core::error::Error for Busy<R> {}

/// The request in flight.
struct Flight {
    state: State,
    /// How often all of it was sent.
    sends: u8,
    /// How often it may be sent again.
    repeats: u8,
    /// How many bytes had come when it was first sent; [`u64::MAX`] before. Its answers begin after them: what began
    /// before may have been held back by a false header since.
    since: u64,
}

impl Flight {
    /// How many answers may come: one for each time it was sent, or is being sent.
    const fn answers(&self) -> u8 {
        self.sends.saturating_add(matches!(self.state, State::Writing) as u8)
    }
}

#[derive(Clone, Copy)]
enum State {
    /// Not sent yet, or to be sent again.
    Ready,
    /// Its bytes are being taken from the transmit buffer.
    Writing,
    /// All sent; an answer is expected by `due`, or a little later if it has begun.
    Waiting { due: Micros, extended: bool },
    /// All sent; no answer is expected.
    Sent,
}

/// Answers that were not waited for and may still come.
struct Owed {
    answers: u8,
    until: Micros,
    /// The last of these requests is still being sent.
    sending: bool,
    /// As [`Flight::since`] has it.
    since: u64,
}

/// The request in flight, and what may still come of those before it.
struct Exchange<P: Protocol> {
    config: Config,
    /// The time, as it was told last.
    now: Micros,
    /// How many bytes came before those that the decoder looks at.
    before: u64,
    flight: Option<Flight>,
    owed: Option<Owed>,
    requests: Requests<P::Request>,
}

/// The request in flight, and the one that answers are owed to: what [`Flight`] and [`Owed`] are of, where there are any.
///
/// A request is too long to be moved from one to the other. It stays in its place, and the places change their roles.
struct Requests<R> {
    places: [Option<R>; 2],
    /// Whether the second place is that of the request in flight.
    second: bool,
}

impl<R: Copy> Requests<R> {
    const fn new() -> Self {
        Self {
            places: [None; 2],
            second: false,
        }
    }

    const fn in_flight(&self) -> Option<&R> {
        let [first, second] = &self.places;
        if self.second { second.as_ref() } else { first.as_ref() }
    }

    const fn owed(&self) -> Option<&R> {
        let [first, second] = &self.places;
        if self.second { first.as_ref() } else { second.as_ref() }
    }

    fn put_in_flight(&mut self, request: R) {
        let [first, second] = &mut self.places;
        *if self.second { second } else { first } = Some(request);
    }

    /// The request in flight is from now on the one that answers are owed to.
    const fn change_roles(&mut self) {
        self.second = !self.second;
    }
}

/// Which request a frame answers.
enum Place {
    /// The one in flight.
    Answer,
    /// One before it.
    Late,
    /// None.
    Unsolicited,
}

impl<P: Protocol> Exchange<P> {
    const fn new(config: Config) -> Self {
        Self {
            config,
            now: Micros(0),
            before: 0,
            flight: None,
            owed: None,
            requests: Requests::new(),
        }
    }

    /// Puts a request in flight.
    fn begin(&mut self, request: P::Request) {
        self.requests.put_in_flight(request);
        self.flight = Some(Flight {
            state: State::Ready,
            sends: 0,
            repeats: self.config.repeats,
            since: u64::MAX,
        });
    }

    /// What the next frame may be: the answer that is owed or, if none is, that to the request in flight. Where both
    /// could come, the request is held back, has no answer, or is named by its answer.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    fn expect(&self) -> P::Expect {
        P::expect(match (&self.owed, &self.flight) {
            (Some(_), _) => self.requests.owed(),
            (None, Some(flight)) if flight.answers() > 0 => self.requests.in_flight(),
            _ => None,
        })
    }

    /// What a frame is.
    ///
    /// A response is long: it is made where it is returned, of what is borrowed from the frame until then.
    #[inline(never)]
    fn hear(&mut self, frame: P::Frame<'_>, expect: P::Expect) -> Event<P> {
        match &parse_response::<P>(frame, expect) {
            Ok(response) => match self.place(|request| P::answers(request, response)) {
                Place::Answer => Event::Answer(P::to_response(response)),
                Place::Late => Event::Late(P::to_response(response)),
                Place::Unsolicited => Event::Unsolicited(P::to_response(response)),
            },
            Err(_) if is_echo::<P>(frame) => Event::Echo,
            Err(error) => match self.place(|request| P::is_response_to(request, frame)) {
                Place::Answer => Event::Unacceptable(*error),
                Place::Late | Place::Unsolicited => Event::Unknown(*error),
            },
        }
    }

    /// Which request a frame answers. If it is the one in flight, that is ended; if it is one that was owed, that is
    /// counted off.
    fn place(&mut self, answers: impl Fn(&P::Request) -> bool) -> Place {
        if let Some(owed) = &mut self.owed
            && self.now < owed.until
            && owed.since <= self.before
            // The one that is still being sent has no answer yet.
            && owed.answers > u8::from(owed.sending)
            && self.requests.owed().is_some_and(&answers)
        {
            owed.answers = owed.answers.saturating_sub(1);
            if owed.answers == 0 {
                self.owed = None;
            }
            return Place::Late;
        }
        // Not only while it waits: a repeat may be on its way when the first answer comes after all.
        if let Some(flight) = &self.flight
            && flight.since <= self.before
            && self.requests.in_flight().is_some_and(answers)
        {
            self.end(flight.answers().saturating_sub(1));
            return Place::Answer;
        }
        Place::Unsolicited
    }

    /// Whether the answer to the request in flight should be here by now.
    fn is_due(&self) -> bool {
        matches!(&self.flight, Some(Flight { state: State::Waiting { due, .. }, .. }) if *due <= self.now)
    }

    /// Waits longer for the answer to the request in flight, but not twice. Returns whether it does.
    fn put_off(&mut self, until: Micros) -> bool {
        match &mut self.flight {
            Some(Flight {
                state: State::Waiting { due, extended },
                ..
            }) if !*extended => {
                (*due, *extended) = (until, true);
                true
            }
            _ => false,
        }
    }

    /// Waits no longer for the answer to the request in flight: it is sent again, or has timed out.
    fn give_up(&mut self) -> Option<Event<P>> {
        let flight = self.flight.as_mut()?;
        if flight.repeats > 0 && self.requests.in_flight().is_some_and(P::repeatable) {
            flight.repeats -= 1;
            flight.state = State::Ready;
            return None;
        }
        let sends = flight.sends;
        self.end(sends);
        Some(Event::TimedOut { sends })
    }

    /// Ends the request in flight, and notes that this many answers to it may still come: none, if the arm does not answer it.
    fn end(&mut self, answers: u8) {
        if answers > 0 {
            self.owe(answers);
        }
        self.flight = None;
    }

    /// Notes that this many answers to the request in flight may still come, which is so no more after that.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    fn owe(&mut self, answers: u8) {
        let Some(flight) = &self.flight else { return };
        let due = match flight.state {
            State::Waiting { due, .. } => due.max(self.now),
            State::Ready | State::Writing | State::Sent => self.now,
        };
        self.owed = Some(Owed {
            answers,
            until: due + self.config.lateness,
            sending: matches!(flight.state, State::Writing),
            since: flight.since,
        });
        self.requests.change_roles();
    }
}

/// What a frame says if only responses could come.
#[inline(never)]
fn parse_response<P: Protocol>(frame: P::Frame<'_>, expect: P::Expect) -> Result<P::ResponseRef<'_>, P::Error> {
    P::parse_response_ref(frame, expect)
}

/// Whether a frame is a request, which a reliable line does not give back.
#[inline(never)]
fn is_echo<P: Protocol>(frame: P::Frame<'_>) -> bool {
    !P::RELIABLE && P::is_request(frame)
}

/// A host-side state machine with buffers of `N` bytes, at least [`Framing::MAX_FRAME`](crate::Framing::MAX_FRAME).
///
/// One request is in flight at a time. Bytes and time go in by [`handle`](Self::handle), bytes come out by
/// [`poll_transmit`](Self::poll_transmit), and [`poll_timeout`](Self::poll_timeout) says when to call again if nothing
/// happens. It does no I/O and reads no clock, so it runs in an interrupt, in a task, or in a test in no time at all.
///
/// A late answer never satisfies the next request: when answers to an earlier one may still come (it timed out, was
/// repeated, or was cancelled), the next request that wants an answer is held back until they came or
/// [`Config::lateness`] is over. Requests without an answer, such as torque off, are never held back, and none is where
/// answers say which request they answer ([`Protocol::IDENTIFIED`]). For this to hold,
/// hand in what has arrived before you ask for bytes to transmit: bytes that waited in a port's buffer are as old as
/// they are, whenever they are read.
///
/// ```
/// use armwire::ling::{self, JointState, Ling, MotionStatus, Request, Response};
/// use armwire::{Client, Config, Event, Input, Micros};
///
/// let mut client = Client::<Ling, { ling::MAX_FRAME }>::new(Config::default());
/// client.submit(Request::ReadJoints).unwrap();
/// let bytes = client.poll_transmit(Micros(0)).unwrap();
/// assert_eq!(bytes, [0xAA, 0x06, 0x00, 0x01, 0xFE, 0x9A, 0xFF]);
/// let n = bytes.len(); // what the port took
/// client.transmitted(Micros(0), n).unwrap();
///
/// let mut input = Input::Bytes(&[
///     0xAA, 0x06, 0x00, 0x0F, 0x00, 0x08, 0x00, 0x08, 0x00, 0x08, 0x00, 0x08, 0x00, 0x08, 0x00, 0x08, 0xF4, 0x01,
///     0x00, 0xB4, 0xFF,
/// ]);
/// let event = client.handle(Micros(350), &mut input);
/// let state = JointState { joints: [2048; 6], gripper: 500, status: MotionStatus::Idle };
/// assert_eq!(event, Some(Event::Answer(Response::Joints(state))));
/// assert_eq!(client.handle(Micros(350), &mut input), None);
/// ```
///
/// A whole loop, over a line in memory: what arrived goes in first, then the next request, then bytes come out.
///
/// ```
/// use armwire::ling::{self, Ling, Request, Response};
/// use armwire::{Client, Config, Event, Input, Micros};
///
/// /// Takes three bytes at a time, and gives each of `arrivals` at its time.
/// struct Line<'a> {
///     now: Micros,
///     arrivals: &'a [(Micros, &'a [u8])],
///     sent: usize,
/// }
///
/// impl Line<'_> {
///     fn write(&mut self, bytes: &[u8]) -> usize {
///         let n = bytes.len().min(3);
///         self.sent += n;
///         n
///     }
///
///     /// Waits until this time, or for bytes.
///     fn read(&mut self, until: Micros) -> &[u8] {
///         match *self.arrivals {
///             [(at, bytes), ref later @ ..] if at <= until => {
///                 self.arrivals = later;
///                 self.now = self.now.max(at);
///                 bytes
///             }
///             _ => {
///                 self.now = self.now.max(until);
///                 &[]
///             }
///         }
///     }
/// }
///
/// /// Makes a request and returns the answer, if there is one.
/// fn call(
///     client: &mut Client<Ling, { ling::MAX_FRAME }>,
///     line: &mut Line<'_>,
///     request: Request,
/// ) -> Option<Response> {
///     let mut request = Some(request);
///     let mut answer = None;
///     loop {
///         // An idle client waits for nothing: what is there already is read.
///         let until = client.poll_timeout().unwrap_or(line.now);
///         let bytes = line.read(until).to_vec();
///         let mut input = if bytes.is_empty() { Input::Tick } else { Input::Bytes(&bytes) };
///         while let Some(event) = client.handle(line.now, &mut input) {
///             match event {
///                 Event::Answer(response) => answer = Some(response),
///                 Event::TimedOut { sends } => println!("no answer, asked {sends} times"),
///                 // Noise and the like end nothing: the request is still in flight.
///                 other => println!("{other:?}"),
///             }
///         }
///         match request.take() {
///             Some(request) => client.submit(request).unwrap(),
///             None if client.is_idle() => return answer,
///             None => {}
///         }
///         while let Some(bytes) = client.poll_transmit(line.now) {
///             let n = line.write(bytes);
///             client.transmitted(line.now, n).unwrap();
///         }
///     }
/// }
///
/// let answer = [
///     0xAA, 0x06, 0x00, 0x0F, 0x00, 0x08, 0x00, 0x08, 0x00, 0x08, 0x00, 0x08, 0x00, 0x08, 0x00, 0x08, 0xF4, 0x01,
///     0x00, 0xB4, 0xFF,
/// ];
/// let arrivals = [(Micros(200), &[0x42][..]), (Micros(350), &answer[..12]), (Micros(400), &answer[12..])];
/// let mut line = Line { now: Micros(0), arrivals: &arrivals, sent: 0 };
/// let mut client = Client::new(Config::default());
/// let joints = call(&mut client, &mut line, Request::ReadJoints);
/// assert!(matches!(joints, Some(Response::Joints(state)) if state.gripper == 500));
/// // Nothing more arrives: it is asked for three times, seven bytes each.
/// line.sent = 0;
/// assert_eq!(call(&mut client, &mut line, Request::ReadJoints), None);
/// assert_eq!(line.sent, 3 * 7);
/// ```
pub struct Client<P: Protocol, const N: usize> {
    exchange: Exchange<P>,
    decoder: Decoder<P, N>,
    /// When bytes last arrived.
    heard: Micros,
    tx: [u8; N],
    /// The bytes still to be transmitted: `tx[tx_start..tx_end]`.
    tx_start: usize,
    tx_end: usize,
}

impl<P: Protocol, const N: usize> Client<P, N> {
    /// An idle client. Does not compile when `N` is less than [`Framing::MAX_FRAME`](crate::Framing::MAX_FRAME).
    pub const fn new(config: Config) -> Self {
        Self {
            exchange: Exchange::new(config),
            decoder: Decoder::new(),
            heard: Micros(0),
            tx: [0; N],
            tx_start: 0,
            tx_end: 0,
        }
    }

    /// Starts a request.
    ///
    /// # Errors
    ///
    /// [`Busy`] gives it back while another is in flight.
    ///
    /// ```
    /// # use armwire::ling::{self, Ling, Request};
    /// use armwire::{Busy, Client, Config};
    ///
    /// let mut client = Client::<Ling, { ling::MAX_FRAME }>::new(Config::default());
    /// assert_eq!(client.submit(Request::ReadJoints), Ok(()));
    /// assert_eq!(client.submit(Request::ReadInfo), Err(Busy(Request::ReadInfo)));
    /// ```
    pub fn submit(&mut self, request: P::Request) -> Result<(), Busy<P::Request>> {
        if self.exchange.flight.is_some() {
            return Err(Busy(request));
        }
        self.exchange.begin(request);
        Ok(())
    }

    /// Gives up the request in flight, if there is one.
    ///
    /// If it was not begun it is never sent. If it was, its remaining bytes still come out of
    /// [`poll_transmit`](Self::poll_transmit), so that the arm is not left with half a frame, and its answer will be
    /// [`Event::Late`].
    ///
    /// ```
    /// # use armwire::ling::{self, Ling, Request};
    /// # use armwire::{Client, Config, Micros};
    /// # let mut client = Client::<Ling, { ling::MAX_FRAME }>::new(Config::default());
    /// client.submit(Request::ReadJoints).unwrap();
    /// client.cancel(Micros(0));
    /// assert_eq!(client.poll_transmit(Micros(0)), None);
    /// ```
    pub fn cancel(&mut self, now: Micros) {
        let Some(flight) = &mut self.exchange.flight else {
            return;
        };
        if matches!(flight.state, State::Writing) && self.tx_start == 0 {
            self.tx_end = 0;
            flight.state = State::Ready;
        }
        let reply = self.exchange.requests.in_flight().and_then(P::reply);
        let answers = reply.map_or(0, |_| flight.answers());
        self.exchange.now = now;
        self.exchange.end(answers);
    }

    /// Whether no request is in flight.
    ///
    /// ```
    /// # use armwire::ling::{self, Ling, Request};
    /// # use armwire::{Client, Config};
    /// # let mut client = Client::<Ling, { ling::MAX_FRAME }>::new(Config::default());
    /// assert!(client.is_idle());
    /// client.submit(Request::ReadJoints).unwrap();
    /// assert!(!client.is_idle());
    /// ```
    pub const fn is_idle(&self) -> bool {
        self.exchange.flight.is_none()
    }

    /// Bytes to transmit now, if there are any. Say with [`transmitted`](Self::transmitted) how many the line took.
    pub fn poll_transmit(&mut self, now: Micros) -> Option<&[u8]> {
        if self.tx_start == self.tx_end {
            let Exchange {
                flight, owed, requests, ..
            } = &mut self.exchange;
            let _ = owed.take_if(|owed| owed.until <= now);
            let (flight, request) = (flight.as_mut()?, requests.in_flight()?);
            let held = owed.is_some() && !P::IDENTIFIED && P::reply(request).is_some();
            if held || self.decoder.is_broken() || !matches!(flight.state, State::Ready) {
                return None;
            }
            // The buffer holds the longest frame, so this cannot fail.
            self.tx_end = P::encode_request(request, &mut self.tx).unwrap_or(0).min(N);
            self.tx_start = 0;
            flight.state = State::Writing;
        }
        self.tx.get(self.tx_start..self.tx_end)
    }

    /// The line took the first `n` bytes of what [`poll_transmit`](Self::poll_transmit) gave.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] when it gave fewer. Nothing changes then.
    pub fn transmitted(&mut self, now: Micros, n: usize) -> Result<(), OutOfRange<usize>> {
        let max = self.tx_end.wrapping_sub(self.tx_start);
        if n > max {
            return Err(OutOfRange {
                what: "transmitted",
                unit: "bytes",
                got: n,
                min: 0,
                max,
            });
        }
        self.tx_start = self.tx_start.wrapping_add(n);
        if n == max && n > 0 {
            self.sent(now);
        }
        Ok(())
    }

    /// The last byte of a request went out.
    fn sent(&mut self, now: Micros) {
        let came = self.decoder.received();
        let Exchange {
            config,
            flight,
            owed,
            requests,
            ..
        } = &mut self.exchange;
        match flight {
            Some(flight) if matches!(flight.state, State::Writing) => {
                if flight.sends == 0 {
                    flight.since = came;
                }
                flight.sends = flight.sends.saturating_add(1);
                flight.state = match patience::<P>(config, requests.in_flight(), self.tx_end) {
                    Some(patience) => State::Waiting {
                        due: now + patience,
                        extended: false,
                    },
                    None => State::Sent,
                };
            }
            // The end of a request that is in flight no more: only now can its answer come.
            _ => {
                if let Some(owed) = owed.as_mut().filter(|owed| owed.sending) {
                    let patience = patience::<P>(config, requests.owed(), self.tx_end).unwrap_or_default();
                    owed.sending = false;
                    owed.since = owed.since.min(came);
                    owed.until = now + patience + config.lateness;
                }
            }
        }
    }

    /// When to call [`handle`](Self::handle) and then [`poll_transmit`](Self::poll_transmit) again if nothing happens
    /// before. A time that is past, as zero is, means at once.
    ///
    /// `None` when there is nothing to wait for: the client is idle, or has bytes to transmit.
    ///
    /// ```
    /// # use armwire::ling::{self, Ling, Request};
    /// # use armwire::{Client, Config, Event, Input, Micros};
    /// # let mut client = Client::<Ling, { ling::MAX_FRAME }>::new(Config { repeats: 0, ..Config::default() });
    /// client.submit(Request::ReadJoints).unwrap();
    /// let n = client.poll_transmit(Micros(0)).unwrap().len();
    /// client.transmitted(Micros(0), n).unwrap();
    /// let due = client.poll_timeout().unwrap();
    /// let event = client.handle(due, &mut Input::Tick);
    /// assert_eq!(event, Some(Event::TimedOut { sends: 1 }));
    /// ```
    pub fn poll_timeout(&self) -> Option<Micros> {
        if self.tx_start < self.tx_end {
            return None;
        }
        match self.exchange.flight.as_ref()?.state {
            State::Waiting { due, .. } => Some(due),
            State::Ready if P::IDENTIFIED => Some(Micros(0)),
            State::Ready => Some(self.exchange.owed.as_ref().map_or(Micros(0), |owed| owed.until)),
            State::Sent => Some(Micros(0)),
            State::Writing => None,
        }
    }

    /// Takes the input and says what comes of it. Call again with the same input until it returns `None`.
    pub fn handle(&mut self, now: Micros, input: &mut Input<'_>) -> Option<Event<P>> {
        if let Some(Flight { state: State::Sent, .. }) = self.exchange.flight {
            self.exchange.flight = None;
            return Some(Event::Sent);
        }
        self.exchange.now = now;
        if let Input::Bytes([_, ..]) = input {
            self.heard = now;
        }
        let expect = self.exchange.expect();
        loop {
            let bytes = match input {
                Input::Bytes(bytes) => bytes,
                Input::Idle | Input::Tick => &mut &[][..],
            };
            if self.decoder.pending() > 0 || !bytes.is_empty() {
                self.exchange.before = self.decoder.offset();
                match &self.decoder.decode(bytes, expect) {
                    Some(Ok(frame)) => return Some(self.exchange.hear(*frame, expect)),
                    Some(Err(noise)) => return Some(self.hear_noise(noise)),
                    None => {}
                }
            }
            match input {
                Input::Idle => {}
                // A false header may be holding the answer back. After so long a silence it is not a frame. Or it is an
                // answer whose end only silence can tell.
                Input::Bytes(_) | Input::Tick if self.is_overdue() => {}
                Input::Bytes(_) | Input::Tick => break,
            }
            if let Some(noise) = &self.decoder.idle(expect) {
                return Some(self.hear_noise(noise));
            }
            if self.decoder.need(expect) > 0 {
                break;
            }
        }
        self.expire()
    }

    /// What comes of bytes that are not part of a frame.
    #[inline(never)]
    fn hear_noise(&mut self, noise: &Noise) -> Event<P> {
        if !self.decoder.is_broken() {
            return Event::Noise(*noise);
        }
        self.exchange.flight = None;
        // Not even the rest of a request: the arm would do what was given up.
        self.tx_end = self.tx_start;
        Event::Broken(*noise)
    }

    /// What comes of time, when nothing comes of bytes.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    fn expire(&mut self) -> Option<Event<P>> {
        if P::RELIABLE
            && let Some(noise) = self.decoder.broken()
        {
            return self.exchange.flight.take().map(|_| Event::Broken(noise));
        }
        if !self.exchange.is_due() {
            return None;
        }
        // An answer may have begun. Its end gets the time that one more packet takes, once.
        if self.exchange.now < self.silence() && self.decoder.pending() > 0 && self.exchange.put_off(self.silence()) {
            return None;
        }
        self.exchange.give_up()
    }

    /// Whether the answer should be here, and the line is silent.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    fn is_overdue(&self) -> bool {
        self.exchange.is_due() && self.silence() <= self.exchange.now
    }

    /// When the line has been silent for so long that no more of a frame comes.
    fn silence(&self) -> Micros {
        self.heard + self.exchange.config.latency
    }
}

/// How long to wait for the answer from when the last byte of the request was handed over.
fn patience<P: Protocol>(config: &Config, request: Option<&P::Request>, len: usize) -> Option<Micros> {
    let reply = request.and_then(P::reply)?;
    Some(config.on_wire(len + reply.len) + reply.turnaround + config.latency)
}

impl<P: Protocol, const N: usize> fmt::Debug for Client<P, N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Client")
            .field("config", &self.exchange.config)
            .field("decoder", &self.decoder)
            .field(
                "in_flight",
                &self.exchange.flight.as_ref().and(self.exchange.requests.in_flight()),
            )
            .finish_non_exhaustive()
    }
}

#[cfg(all(test, feature = "ling"))]
mod tests {
    extern crate std;

    use std::vec::Vec;

    use super::*;
    use crate::ling::{self, JointState, Ling, MotionStatus, Request, Response, Stroke, Torque};

    type Lings = Client<Ling, { ling::MAX_FRAME }>;

    const JOINTS: Response = Response::Joints(JointState {
        joints: [2048; 6],
        gripper: 500,
        status: MotionStatus::Idle,
    });

    fn bytes(response: Response) -> Vec<u8> {
        let mut out = [0; ling::MAX_FRAME];
        let n = Ling::encode_response(&response, &mut out).unwrap();
        out[..n].to_vec()
    }

    /// Transmits all there is and returns how many bytes that was.
    fn transmit(client: &mut Lings, now: Micros) -> usize {
        let n = client.poll_transmit(now).map_or(0, <[u8]>::len);
        client.transmitted(now, n).unwrap();
        n
    }

    fn hear(client: &mut Lings, now: Micros, bytes: &[u8]) -> Vec<Event<Ling>> {
        let mut input = Input::Bytes(bytes);
        core::iter::from_fn(|| client.handle(now, &mut input)).collect()
    }

    /// Runs a request to its time-out and returns when that was.
    fn time_out(client: &mut Lings, mut now: Micros) -> (Micros, u8) {
        client.submit(Request::ReadJoints).unwrap();
        loop {
            transmit(client, now);
            now = client.poll_timeout().unwrap();
            if let Some(Event::TimedOut { sends }) = client.handle(now, &mut Input::Tick) {
                return (now, sends);
            }
        }
    }

    #[test]
    fn more_than_was_given_is_not_transmitted() {
        let mut client = Lings::new(Config::default());
        let refused = |max| {
            Err(OutOfRange {
                what: "transmitted",
                unit: "bytes",
                got: max + 1,
                min: 0,
                max,
            })
        };
        assert_eq!(client.transmitted(Micros(0), 1), refused(0));
        client.submit(Request::ReadJoints).unwrap();
        let given = client.poll_transmit(Micros(0)).unwrap().to_vec();
        assert_eq!(client.transmitted(Micros(0), given.len() + 1), refused(given.len()));
        assert_eq!(client.transmitted(Micros(0), 2), Ok(()));
        assert_eq!(client.transmitted(Micros(0), given.len() - 1), refused(given.len() - 2));
        assert_eq!(client.poll_transmit(Micros(0)), Some(&given[2..]));
    }

    #[test]
    fn the_time_on_the_line_is_rounded_up_to_a_microsecond() {
        for baud in [
            1,
            7,
            9_600,
            115_200,
            921_600,
            1_000_000,
            3_000_000,
            12_000_000,
            u32::MAX,
        ] {
            let config = Config {
                baud: NonZeroU32::new(baud).unwrap(),
                ..Config::DEFAULT
            };
            for len in 0..400_usize {
                let exact = (len as u64 * 10_000_000).div_ceil(u64::from(baud));
                assert_eq!(config.on_wire(len), Micros(exact), "{len} bytes at {baud} baud");
            }
        }
    }

    #[test]
    fn an_answer_in_any_pieces_completes_the_request() {
        let answer = bytes(JOINTS);
        for split in 0..=answer.len() {
            let mut client = Lings::new(Config::DEFAULT);
            client.submit(Request::ReadJoints).unwrap();
            assert_eq!(transmit(&mut client, Micros(0)), 7);
            let (first, second) = answer.split_at(split);
            let mut events = hear(&mut client, Micros(300), first);
            events.extend(hear(&mut client, Micros(310), second));
            assert_eq!(events, [Event::Answer(JOINTS)]);
            assert!(client.is_idle() && client.poll_timeout().is_none());
        }
    }

    #[test]
    fn a_second_request_is_given_back() {
        let mut client = Lings::new(Config::DEFAULT);
        client.submit(Request::ReadJoints).unwrap();
        assert_eq!(client.submit(Request::ReadInfo), Err(Busy(Request::ReadInfo)));
    }

    #[test]
    fn requests_without_an_answer_complete_when_sent() {
        let mut client = Lings::new(Config::DEFAULT);
        for request in [
            Request::SetZero,
            Request::SetTorque(Torque::Off),
            Request::SetStroke(Stroke::Mm50),
        ] {
            client.submit(request).unwrap();
            assert_eq!(client.handle(Micros(0), &mut Input::Tick), None);
            assert_eq!(transmit(&mut client, Micros(0)), 7);
            assert_eq!(client.handle(Micros(0), &mut Input::Tick), Some(Event::Sent));
            assert!(client.is_idle());
        }
    }

    #[test]
    fn an_echo_is_neither_an_answer_nor_an_error() {
        let mut client = Lings::new(Config::DEFAULT);
        client.submit(Request::ReadJoints).unwrap();
        let echo = client.poll_transmit(Micros(0)).unwrap().to_vec();
        client.transmitted(Micros(0), echo.len()).unwrap();
        let line = [echo, bytes(JOINTS)].concat();
        let events = hear(&mut client, Micros(300), &line);
        assert_eq!(events, [Event::Echo, Event::Answer(JOINTS)]);
    }

    #[test]
    fn silence_repeats_a_read_and_then_gives_up() {
        for repeats in 0..4 {
            let mut client = Lings::new(Config {
                repeats,
                ..Config::DEFAULT
            });
            let (at, sends) = time_out(&mut client, Micros(0));
            assert_eq!(sends, repeats + 1);
            // (7 + 30) bytes at 10 µs, 50 ms of turnaround, 10 ms of latency; each time.
            assert_eq!(at, Micros(60_370 * u64::from(sends)));
        }
    }

    #[test]
    fn a_late_answer_does_not_satisfy_the_next_request() {
        let mut client = Lings::new(Config {
            repeats: 0,
            ..Config::DEFAULT
        });
        let (now, _) = time_out(&mut client, Micros(0));

        client.submit(Request::ReadJoints).unwrap();
        assert_eq!(transmit(&mut client, now), 0, "held back");
        assert_eq!(
            hear(&mut client, now + Micros(1), &bytes(JOINTS)),
            [Event::Late(JOINTS)]
        );
        assert_eq!(transmit(&mut client, now + Micros(1)), 7, "nothing else can be late");
        assert_eq!(
            hear(&mut client, now + Micros(400), &bytes(JOINTS)),
            [Event::Answer(JOINTS)]
        );
    }

    #[test]
    fn a_request_held_back_goes_out_when_lateness_is_over() {
        let mut client = Lings::new(Config {
            repeats: 0,
            ..Config::DEFAULT
        });
        let (now, _) = time_out(&mut client, Micros(0));
        client.submit(Request::ReadInfo).unwrap();
        assert_eq!(transmit(&mut client, now), 0);
        let due = client.poll_timeout().unwrap();
        assert_eq!(due, now + Config::DEFAULT.lateness);
        assert_eq!(client.handle(due, &mut Input::Tick), None);
        assert_eq!(transmit(&mut client, due), 7);
    }

    #[test]
    fn lateness_counts_from_when_the_time_out_was_told() {
        let mut client = Lings::new(Config {
            repeats: 0,
            ..Config::DEFAULT
        });
        client.submit(Request::ReadJoints).unwrap();
        transmit(&mut client, Micros(0));
        let told = client.poll_timeout().unwrap() + Micros(70_000);
        let event = client.handle(told, &mut Input::Tick);
        assert_eq!(event, Some(Event::TimedOut { sends: 1 }));
        client.submit(Request::ReadInfo).unwrap();
        assert_eq!(client.poll_timeout(), Some(told + Config::DEFAULT.lateness));
    }

    #[test]
    fn lateness_of_a_cancelled_request_counts_from_when_its_answer_is_due() {
        let mut client = Lings::new(Config::DEFAULT);
        client.submit(Request::ReadJoints).unwrap();
        client.poll_transmit(Micros(0)).unwrap();
        client.transmitted(Micros(0), 2).unwrap();
        client.cancel(Micros(0));
        let sent = Micros(500_000);
        assert_eq!(transmit(&mut client, sent), 5);
        client.submit(Request::ReadInfo).unwrap();
        // As in `silence_repeats_a_read_and_then_gives_up`.
        let due = sent + Micros(60_370);
        assert_eq!(client.poll_timeout(), Some(due + Config::DEFAULT.lateness));
    }

    #[test]
    fn an_answer_after_its_lateness_is_unsolicited() {
        let mut client = Lings::new(Config {
            repeats: 0,
            ..Config::DEFAULT
        });
        let (now, _) = time_out(&mut client, Micros(0));
        let over = now + Config::DEFAULT.lateness;
        assert_eq!(hear(&mut client, over, &bytes(JOINTS)), [Event::Unsolicited(JOINTS)]);
    }

    #[test]
    fn torque_off_is_never_held_back() {
        let mut client = Lings::new(Config::DEFAULT);
        let (now, _) = time_out(&mut client, Micros(0));
        client.submit(Request::SetTorque(Torque::Off)).unwrap();
        assert_eq!(transmit(&mut client, now), 7);
    }

    #[test]
    fn the_second_answer_to_a_repeated_request_is_late() {
        let mut client = Lings::new(Config::DEFAULT);
        client.submit(Request::ReadJoints).unwrap();
        transmit(&mut client, Micros(0));
        let due = client.poll_timeout().unwrap();
        assert_eq!(client.handle(due, &mut Input::Tick), None);
        assert_eq!(transmit(&mut client, due), 7, "repeated");
        assert_eq!(
            hear(&mut client, due + Micros(10), &bytes(JOINTS)),
            [Event::Answer(JOINTS)]
        );

        client.submit(Request::ReadJoints).unwrap();
        assert_eq!(transmit(&mut client, due + Micros(20)), 0);
        assert_eq!(
            hear(&mut client, due + Micros(300), &bytes(JOINTS)),
            [Event::Late(JOINTS)]
        );
        assert_eq!(transmit(&mut client, due + Micros(301)), 7);
    }

    #[test]
    fn the_first_answer_counts_even_while_the_repeat_is_half_sent() {
        let mut client = Lings::new(Config::DEFAULT);
        client.submit(Request::ReadJoints).unwrap();
        transmit(&mut client, Micros(0));
        let due = client.poll_timeout().unwrap();
        client.handle(due, &mut Input::Tick);
        assert_eq!(client.poll_transmit(due).unwrap().len(), 7);
        client.transmitted(due, 3).unwrap();
        assert_eq!(hear(&mut client, due, &bytes(JOINTS)), [Event::Answer(JOINTS)]);
        assert_eq!(transmit(&mut client, due), 4, "the frame is finished");
        assert_eq!(
            hear(&mut client, due + Micros(300), &bytes(JOINTS)),
            [Event::Late(JOINTS)]
        );
    }

    #[test]
    fn a_cancelled_request_is_finished_on_the_line_and_answers_nothing() {
        let mut client = Lings::new(Config::DEFAULT);
        client.submit(Request::ReadJoints).unwrap();
        let frame = client.poll_transmit(Micros(0)).unwrap().to_vec();
        client.transmitted(Micros(0), 2).unwrap();
        client.cancel(Micros(0));

        client.submit(Request::ReadJoints).unwrap();
        assert_eq!(client.poll_transmit(Micros(5)).unwrap(), &frame[2..]);
        assert_eq!(transmit(&mut client, Micros(5)), 5);
        assert_eq!(transmit(&mut client, Micros(6)), 0, "held back");
        assert_eq!(hear(&mut client, Micros(400), &bytes(JOINTS)), [Event::Late(JOINTS)]);
        assert_eq!(transmit(&mut client, Micros(401)), 7);
        assert_eq!(hear(&mut client, Micros(800), &bytes(JOINTS)), [Event::Answer(JOINTS)]);
    }

    #[test]
    fn a_cancelled_request_without_an_answer_holds_nothing_back() {
        let mut client = Lings::new(Config::DEFAULT);
        client.submit(Request::SetZero).unwrap();
        let len = client.poll_transmit(Micros(0)).unwrap().len();
        client.transmitted(Micros(0), len - 1).unwrap();
        client.cancel(Micros(0));
        client.submit(Request::ReadJoints).unwrap();
        assert_eq!(transmit(&mut client, Micros(0)), 1);
        assert_eq!(transmit(&mut client, Micros(0)), 7);
    }

    #[test]
    fn lateness_of_a_request_that_is_cancelled_before_it_is_repeated_counts_from_then() {
        let mut client = Lings::new(Config::DEFAULT);
        client.submit(Request::ReadJoints).unwrap();
        transmit(&mut client, Micros(0));
        let due = client.poll_timeout().unwrap();
        assert_eq!(client.handle(due, &mut Input::Tick), None);
        let cancelled = due + Micros::from_millis(70);
        client.cancel(cancelled);
        client.submit(Request::ReadInfo).unwrap();
        assert_eq!(client.poll_timeout(), Some(cancelled + Config::DEFAULT.lateness));
    }

    #[test]
    fn one_request_after_the_other_gets_its_own_late_answer() {
        let mut client = Lings::new(Config {
            repeats: 0,
            ..Config::DEFAULT
        });
        let stroke = Response::Stroke(Stroke::Mm50);
        let mut now = Micros(0);
        for (request, response) in [
            (Request::ReadJoints, JOINTS),
            (Request::ReadStroke, stroke),
            (Request::ReadJoints, JOINTS),
            (Request::ReadStroke, stroke),
        ] {
            client.submit(request).unwrap();
            assert_eq!(transmit(&mut client, now), 7);
            now = client.poll_timeout().unwrap();
            assert_eq!(client.handle(now, &mut Input::Tick), Some(Event::TimedOut { sends: 1 }));
            assert_eq!(hear(&mut client, now, &bytes(response)), [Event::Late(response)]);
        }
    }

    #[test]
    fn what_comes_before_a_cancelled_request_is_sent_is_not_its_answer() {
        let mut client = Lings::new(Config::DEFAULT);
        client.submit(Request::ReadJoints).unwrap();
        client.poll_transmit(Micros(0)).unwrap();
        client.transmitted(Micros(0), 2).unwrap();
        client.cancel(Micros(0));
        assert_eq!(
            hear(&mut client, Micros(1), &bytes(JOINTS)),
            [Event::Unsolicited(JOINTS)]
        );
        assert_eq!(transmit(&mut client, Micros(5)), 5);

        client.submit(Request::ReadJoints).unwrap();
        assert_eq!(transmit(&mut client, Micros(6)), 0, "held back");
        assert_eq!(hear(&mut client, Micros(400), &bytes(JOINTS)), [Event::Late(JOINTS)]);
    }

    /// What is not noise of all that silence frees.
    fn fall_silent(client: &mut Lings, now: Micros) -> Vec<Event<Ling>> {
        let mut input = Input::Idle;
        let events = core::iter::from_fn(|| client.handle(now, &mut input));
        events.filter(|event| !matches!(event, Event::Noise(_))).collect()
    }

    #[test]
    fn an_answer_that_a_false_header_held_back_satisfies_no_later_request() {
        let mut client = Lings::new(Config {
            repeats: 0,
            ..Config::DEFAULT
        });
        let (now, _) = time_out(&mut client, Micros(0));
        let line = [&[0xAA, 0x00, 0x00, 60][..], &bytes(JOINTS)].concat();
        assert_eq!(hear(&mut client, now, &line), []);

        client.submit(Request::ReadJoints).unwrap();
        let now = client.poll_timeout().unwrap();
        assert_eq!(transmit(&mut client, now), 7);
        assert_eq!(fall_silent(&mut client, now), [Event::Unsolicited(JOINTS)]);
        let events = hear(&mut client, now + Micros(300), &bytes(JOINTS));
        assert_eq!(events, [Event::Answer(JOINTS)]);
    }

    #[test]
    fn an_answer_that_a_false_header_held_back_is_not_that_of_a_later_cancelled_request() {
        let line = [&[0xAA, 0x00, 0x00, 60][..], &bytes(JOINTS)].concat();
        for sent in [2, 7] {
            let mut client = Lings::new(Config::DEFAULT);
            assert_eq!(hear(&mut client, Micros(0), &line), []);
            client.submit(Request::ReadJoints).unwrap();
            client.poll_transmit(Micros(0)).unwrap();
            client.transmitted(Micros(0), sent).unwrap();
            client.cancel(Micros(0));
            assert_eq!(transmit(&mut client, Micros(1)), 7 - sent);

            assert_eq!(fall_silent(&mut client, Micros(2)), [Event::Unsolicited(JOINTS)]);
            client.submit(Request::ReadJoints).unwrap();
            assert_eq!(transmit(&mut client, Micros(3)), 0, "held back");
            assert_eq!(hear(&mut client, Micros(400), &bytes(JOINTS)), [Event::Late(JOINTS)]);
        }
    }

    #[test]
    fn another_kind_of_response_is_unsolicited() {
        let mut client = Lings::new(Config::DEFAULT);
        client.submit(Request::ReadJoints).unwrap();
        transmit(&mut client, Micros(0));
        let stroke = Response::Stroke(Stroke::Mm50);
        assert_eq!(
            hear(&mut client, Micros(300), &bytes(stroke)),
            [Event::Unsolicited(stroke)]
        );
        assert_eq!(hear(&mut client, Micros(600), &bytes(JOINTS)), [Event::Answer(JOINTS)]);
    }

    #[test]
    fn an_answer_behind_a_false_header_is_found_when_the_line_stays_silent() {
        // Nor is it a sign of life that there are no bytes.
        for mut input in [Input::Tick, Input::Bytes(&[])] {
            let mut client = Lings::new(Config {
                repeats: 0,
                ..Config::DEFAULT
            });
            client.submit(Request::ReadJoints).unwrap();
            transmit(&mut client, Micros(0));
            let line = [&[0xAA, 0x00, 0x00, 60][..], &bytes(JOINTS)].concat();
            assert_eq!(hear(&mut client, Micros(300), &line), []);

            let due = client.poll_timeout().unwrap();
            let events: Vec<_> = core::iter::from_fn(|| client.handle(due, &mut input)).collect();
            assert_eq!(events.last(), Some(&Event::Answer(JOINTS)));
            assert!(
                events[..events.len() - 1]
                    .iter()
                    .all(|event| matches!(event, Event::Noise(_)))
            );
        }
    }

    #[test]
    fn what_has_not_been_sent_whole_has_no_answer_yet() {
        let mut client = Lings::new(Config::DEFAULT);
        client.submit(Request::ReadJoints).unwrap();
        transmit(&mut client, Micros(0));
        let due = client.poll_timeout().unwrap();
        assert_eq!(client.handle(due, &mut Input::Tick), None);
        assert!(client.poll_transmit(due).is_some(), "again");
        client.transmitted(due, 2).unwrap();
        client.cancel(due);
        assert_eq!(hear(&mut client, due, &bytes(JOINTS)), [Event::Late(JOINTS)]);
        assert_eq!(hear(&mut client, due, &bytes(JOINTS)), [Event::Unsolicited(JOINTS)]);
        assert_eq!(transmit(&mut client, due), 5);
        assert_eq!(hear(&mut client, due, &bytes(JOINTS)), [Event::Late(JOINTS)]);
    }

    #[test]
    fn an_idle_line_frees_the_answer_at_once() {
        let mut client = Lings::new(Config::DEFAULT);
        client.submit(Request::ReadJoints).unwrap();
        transmit(&mut client, Micros(0));
        let line = [&[0xAA, 0x00, 0x00, 60][..], &bytes(JOINTS)].concat();
        assert_eq!(hear(&mut client, Micros(300), &line), []);
        let mut input = Input::Idle;
        let events: Vec<_> = core::iter::from_fn(|| client.handle(Micros(310), &mut input)).collect();
        assert_eq!(events.last(), Some(&Event::Answer(JOINTS)));
    }

    #[test]
    fn whoever_follows_poll_timeout_completes_every_request() {
        for request in [Request::SetTorque(Torque::Off), Request::ReadJoints] {
            let mut client = Lings::new(Config::DEFAULT);
            assert_eq!(client.poll_timeout(), None, "idle");
            client.submit(request).unwrap();
            let mut now = Micros(7);
            let done = loop {
                now = now.max(client.poll_timeout().expect("something to wait for"));
                if let Some(event) = client.handle(now, &mut Input::Tick) {
                    break event;
                }
                transmit(&mut client, now);
            };
            assert!(matches!(done, Event::Sent | Event::TimedOut { sends: 3 }), "{done:?}");
        }
    }

    #[test]
    fn transmitting_nothing_changes_nothing() {
        let mut client = Lings::new(Config {
            repeats: 0,
            ..Config::DEFAULT
        });
        let (now, _) = time_out(&mut client, Micros(0));
        client.submit(Request::ReadJoints).unwrap();
        let due = client.poll_timeout();
        client.transmitted(now + Micros(50), 0).unwrap();
        assert_eq!(client.poll_timeout(), due);
    }

    #[test]
    fn an_answer_that_has_begun_gets_the_time_to_end() {
        let answer = bytes(JOINTS);
        for received in 1..answer.len() {
            let mut client = Lings::new(Config::DEFAULT);
            client.submit(Request::ReadJoints).unwrap();
            transmit(&mut client, Micros(0));
            let due = client.poll_timeout().unwrap();
            let (first, second) = answer.split_at(received);
            assert_eq!(hear(&mut client, Micros(due.0 - 1), first), []);
            assert_eq!(hear(&mut client, due, second), [Event::Answer(JOINTS)]);
        }
    }

    #[test]
    fn a_whole_message_before_the_time_out_does_not_put_it_off() {
        let mut client = Lings::new(Config {
            repeats: 0,
            ..Config::DEFAULT
        });
        client.submit(Request::ReadJoints).unwrap();
        transmit(&mut client, Micros(0));
        let due = client.poll_timeout().unwrap();
        let other = Response::Stroke(Stroke::Mm50);
        assert_eq!(
            hear(&mut client, Micros(due.0 - 1), &bytes(other)),
            [Event::Unsolicited(other)]
        );
        assert_eq!(client.handle(due, &mut Input::Tick), Some(Event::TimedOut { sends: 1 }));
    }

    #[test]
    fn bytes_without_end_do_not_put_off_the_time_out_for_ever() {
        let mut client = Lings::new(Config {
            repeats: 0,
            ..Config::DEFAULT
        });
        client.submit(Request::ReadJoints).unwrap();
        transmit(&mut client, Micros(0));
        let due = client.poll_timeout().unwrap();
        let mut now = Micros(0);
        while !hear(&mut client, now, &[0xAA, 0, 0, 60]).contains(&Event::TimedOut { sends: 1 }) {
            now = now + Micros(1_000);
            assert!(now < due + Config::DEFAULT.latency + Micros(1_000));
        }
    }

    #[test]
    fn as_many_repeats_as_can_be_asked_for_end() {
        let mut client = Lings::new(Config {
            repeats: u8::MAX,
            ..Config::DEFAULT
        });
        assert_eq!(time_out(&mut client, Micros(0)).1, u8::MAX);
    }
}

#[cfg(all(test, feature = "xarm"))]
mod identified_tests {
    extern crate std;

    use std::vec::Vec;

    use super::*;
    use crate::xarm::{self, Command, Header, ProtocolId, Register, Request, Response, State, XArm};
    use crate::{Protocol, Reason};

    type Arms = Client<XArm, { xarm::MAX_FRAME }>;

    const fn header(transaction: u16) -> Header {
        Header {
            transaction,
            protocol: ProtocolId::Private,
        }
    }

    const fn request(transaction: u16) -> Request {
        Request::Call {
            header: header(transaction),
            command: Command::ReloadDynamics,
        }
    }

    const fn answer(transaction: u16) -> Response {
        Response::Reply {
            header: header(transaction),
            state: State::OK,
            reply: xarm::Reply::Empty(Register::ReloadDynamics),
        }
    }

    fn transmit(client: &mut Arms, now: Micros) -> usize {
        let n = client.poll_transmit(now).map_or(0, <[u8]>::len);
        client.transmitted(now, n).unwrap();
        n
    }

    fn hear(client: &mut Arms, now: Micros, bytes: &[u8]) -> Vec<Event<XArm>> {
        let mut input = Input::Bytes(bytes);
        core::iter::from_fn(|| client.handle(now, &mut input)).collect()
    }

    fn hear_answer(client: &mut Arms, now: Micros, transaction: u16) -> Vec<Event<XArm>> {
        let mut out = [0; xarm::MAX_FRAME];
        let n = XArm::encode_response(&answer(transaction), &mut out).unwrap();
        hear(client, now, &out[..n])
    }

    /// Runs a request to its time-out and returns when that was.
    fn time_out(client: &mut Arms, now: Micros, transaction: u16) -> Micros {
        client.submit(request(transaction)).unwrap();
        assert_eq!(transmit(client, now), 7);
        let due = client.poll_timeout().unwrap();
        let event = client.handle(due, &mut Input::Tick);
        assert_eq!(event, Some(Event::TimedOut { sends: 1 }));
        due
    }

    #[test]
    fn after_a_missing_answer_the_next_request_goes_out_at_once_and_only_its_own_answer_counts() {
        let mut client = Arms::new(Config::TCP);
        let now = time_out(&mut client, Micros(0), 1);
        client.submit(request(2)).unwrap();
        assert_eq!(client.poll_timeout(), Some(Micros(0)));
        assert_eq!(transmit(&mut client, now), 7);
        let late = hear_answer(&mut client, now + Micros(1), 1);
        assert_eq!(late, [Event::Late(answer(1))]);
        let events = hear_answer(&mut client, now + Micros(2), 2);
        assert_eq!(events, [Event::Answer(answer(2))]);
    }

    #[test]
    fn an_answer_later_than_late_still_satisfies_nothing() {
        let mut client = Arms::new(Config::TCP);
        let now = time_out(&mut client, Micros(0), 1) + Config::TCP.lateness;
        client.submit(request(2)).unwrap();
        transmit(&mut client, now);
        let events = hear_answer(&mut client, now, 1);
        assert_eq!(events, [Event::Unsolicited(answer(1))]);
        assert!(!client.is_idle());
    }

    #[test]
    fn the_answer_to_a_cancelled_request_is_late_and_holds_nothing_back() {
        let mut client = Arms::new(Config::TCP);
        client.submit(request(1)).unwrap();
        transmit(&mut client, Micros(0));
        client.cancel(Micros(1));
        client.submit(request(2)).unwrap();
        assert_eq!(transmit(&mut client, Micros(2)), 7);
        assert_eq!(hear_answer(&mut client, Micros(3), 2), [Event::Answer(answer(2))]);
        assert_eq!(hear_answer(&mut client, Micros(4), 1), [Event::Late(answer(1))]);
    }

    #[test]
    fn the_end_of_an_answer_that_comes_after_the_time_out_is_late() {
        let mut client = Arms::new(Config::TCP);
        client.submit(request(1)).unwrap();
        transmit(&mut client, Micros(0));
        let due = client.poll_timeout().unwrap();
        assert_eq!(hear(&mut client, Micros(9), &[0, 1, 0, 2]), []);
        let timed_out = client.handle(due, &mut Input::Tick);
        assert_eq!(timed_out, Some(Event::TimedOut { sends: 1 }));
        assert_eq!(hear(&mut client, due, &[0, 2, 4, 0]), [Event::Late(answer(1))]);
    }

    #[test]
    fn a_broken_connection_ends_the_request_in_flight_and_every_later_one() {
        let mut client = Arms::new(Config::TCP);
        client.submit(request(1)).unwrap();
        transmit(&mut client, Micros(0));
        let broken = Event::Broken(Noise {
            offset: 0,
            len: 4,
            reason: Reason::Byte {
                offset: 3,
                expected: &[0, 1, 2, 3],
                got: 9,
            },
        });
        assert_eq!(hear(&mut client, Micros(1), &[0, 1, 0, 9, 0, 2]), [broken]);
        assert!(client.is_idle());
        for transaction in 2..5 {
            assert_eq!(hear_answer(&mut client, Micros(2), transaction), [], "nothing is read");
            client.submit(request(transaction)).unwrap();
            assert_eq!(transmit(&mut client, Micros(2)), 0, "nothing is sent");
            assert_eq!(client.poll_timeout(), Some(Micros(0)));
            assert_eq!(client.handle(Micros(2), &mut Input::Tick), Some(broken));
            assert!(client.is_idle());
        }
        assert_eq!(client.handle(Micros(3), &mut Input::Idle), None);
    }

    #[test]
    fn nothing_of_a_request_is_sent_once_the_connection_is_broken() {
        for sent in 0..7 {
            let mut client = Arms::new(Config::TCP);
            client.submit(request(1)).unwrap();
            assert_eq!(client.poll_transmit(Micros(0)).map(<[u8]>::len), Some(7));
            client.transmitted(Micros(0), sent).unwrap();
            let events = hear(&mut client, Micros(1), &[0, 1, 0, 9]);
            assert!(matches!(events[..], [Event::Broken(_)]), "{events:?}");
            assert_eq!(client.poll_transmit(Micros(2)), None, "after {sent} bytes");
            client.submit(request(2)).unwrap();
            assert_eq!(client.poll_transmit(Micros(3)), None, "after {sent} bytes");
            assert_eq!(client.poll_timeout(), Some(Micros(0)));
        }
    }

    #[test]
    fn an_answer_before_the_break_in_the_same_bytes_still_counts() {
        let mut client = Arms::new(Config::TCP);
        client.submit(request(1)).unwrap();
        transmit(&mut client, Micros(0));
        let events = hear(&mut client, Micros(1), &[0, 1, 0, 2, 0, 2, 4, 0, 0, 0, 1]);
        assert!(matches!(events[..], [Event::Answer(_), Event::Broken(_)]), "{events:?}");
    }
}

#[cfg(all(test, feature = "alpha1"))]
mod expected_tests {
    extern crate std;

    use std::vec::Vec;

    use super::*;
    use crate::alpha1::{self, Address, Alpha1, Request, Response, ServoId, ServoRequest, ServoResponse};

    type Servos = Client<Alpha1, { alpha1::MAX_FRAME }>;

    fn hear(client: &mut Servos, now: Micros, bytes: &[u8]) -> Vec<Event<Alpha1>> {
        let mut input = Input::Bytes(bytes);
        core::iter::from_fn(|| client.handle(now, &mut input)).collect()
    }

    #[test]
    fn a_late_byte_is_known_while_a_request_without_an_answer_is_being_sent() {
        let servo = ServoId::new(1).unwrap();
        let release = |who| Request::Servo(ServoRequest::Release(who));
        let mut client = Servos::new(Config::DEFAULT);
        client.submit(release(Address::One(servo))).unwrap();
        let n = client.poll_transmit(Micros(0)).unwrap().len();
        client.transmitted(Micros(0), n).unwrap();
        let due = client.poll_timeout().unwrap();
        let timed_out = client.handle(due, &mut Input::Tick);
        assert_eq!(timed_out, Some(Event::TimedOut { sends: 1 }));

        client.submit(release(Address::All)).unwrap();
        assert!(client.poll_transmit(due).is_some());
        client.transmitted(due, 1).unwrap();
        let late = Event::Late(Response::Servo(ServoResponse::Acknowledged(servo)));
        assert_eq!(hear(&mut client, due, &[0xAB]), [late]);
    }
}
