//! A [`Client`] over `embedded-io-async`.

use core::fmt;
use core::future::{Future, poll_fn};
use core::pin::pin;
use core::task::Poll;

use embedded_io_async::{ErrorKind, Read, Write};

use crate::framing::Reason;
use crate::messages::Messages;
use crate::time::{Duration, Instant};
use crate::{Client, Config, ErrorFrame, Event, OutOfRange, Output, ParseError, SubmitError};

/// Time from a receive error to the next read.
const RETRY_PERIOD: Duration = Duration::from_millis(1);
/// The receive errors in a row after which a port is taken for empty before a request is sent.
const MAX_ERRORS: u8 = 8;

/// A monotonic clock with a timer: the only part of a runtime that the driver needs.
///
/// ```no_run
/// use armwire::driver::Clock;
/// use armwire::time::Instant;
/// use embassy_time::Timer;
///
/// struct Embassy;
///
/// impl Clock for Embassy {
///     fn now(&self) -> Instant {
///         Instant::from_micros(embassy_time::Instant::now().as_micros())
///     }
///
///     async fn wait_until(&self, instant: Instant) {
///         Timer::at(embassy_time::Instant::from_micros(instant.as_micros())).await;
///     }
/// }
/// ```
pub trait Clock {
    /// The current time.
    fn now(&self) -> Instant;

    /// Resolves at `instant`, or at once if it has passed.
    fn wait_until(&self, instant: Instant) -> impl Future<Output = ()>;
}

impl<C: Clock> Clock for &C {
    fn now(&self) -> Instant {
        C::now(self)
    }

    fn wait_until(&self, instant: Instant) -> impl Future<Output = ()> {
        C::wait_until(self, instant)
    }
}

/// The error of a call: `E` is the error of the port.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum CallError<E> {
    /// The port failed.
    Io(E),
    /// The port accepted or returned zero bytes: it is closed.
    Closed,
    /// The port reported more bytes than were passed to it or requested.
    Port(OutOfRange<usize>),
    /// The client did not accept the request.
    Submit(SubmitError),
    /// A lossless stream broke: no later byte can be decoded, and the connection must be closed.
    Broken {
        /// The offset of the break, in bytes since the driver was created.
        offset: u64,
        /// The reason.
        reason: Reason,
    },
    /// The arm's answer has an invalid value or length.
    Unacceptable(ParseError),
    /// The arm answered with an error frame.
    ErrorFrame(ErrorFrame),
    /// The xArm answered with an invalid state, or without the requested value.
    #[cfg(feature = "xarm")]
    Refused(crate::xarm::State),
    /// The Ling arm may still move.
    #[cfg(feature = "ling")]
    NotStopped(crate::ling::stop::StopError),
    /// The Ling arm has not applied the control mode.
    #[cfg(feature = "ling")]
    ModeNotApplied(crate::ling::mode_change::ModeError),
    /// The Alpha1, or its servo, reported a failure. It gives no reason.
    #[cfg(feature = "alpha1")]
    Failed,
    /// The arm did not answer.
    TimedOut {
        /// The number of transmissions of the request.
        sends: u8,
    },
}

impl<E: fmt::Display> fmt::Display for CallError<E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Io(error) => write!(f, "the port failed: {error}"),
            Self::Closed => f.write_str("the port is closed"),
            Self::Port(count) => write!(f, "the port reported an invalid count: {count}"),
            Self::Submit(error) => error.fmt(f),
            Self::Broken { offset, reason } => write!(f, "the connection is broken: byte {offset}: {reason}"),
            Self::Unacceptable(error) => write!(f, "the arm's answer cannot be accepted: {error}"),
            Self::ErrorFrame(frame) => write!(f, "the arm sent an error frame: {frame}"),
            #[cfg(feature = "xarm")]
            Self::Refused(state) => write!(f, "the arm refused, its state: {state}"),
            #[cfg(feature = "ling")]
            Self::NotStopped(error) => write!(f, "the arm is not stopped: {error}"),
            #[cfg(feature = "ling")]
            Self::ModeNotApplied(error) => error.fmt(f),
            #[cfg(feature = "alpha1")]
            Self::Failed => f.write_str("the arm reported a failure"),
            Self::TimedOut { sends: 1 } => f.write_str("the arm did not answer"),
            Self::TimedOut { sends } => write!(f, "the arm did not answer in {sends} attempts"),
        }
    }
}

impl<E: fmt::Debug + fmt::Display> core::error::Error for CallError<E> {}

/// Counts of received frames and bytes other than answers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct Counters {
    /// Bytes that were not part of a frame.
    pub noise_bytes: u32,
    /// Valid frames that are no message of the protocol.
    pub unknown: u32,
    /// Answers that came too late, or twice.
    pub late: u32,
    /// Responses without a request.
    pub unsolicited: u32,
    /// Requests that the line echoed.
    pub echoes: u32,
    /// Receive errors of the port that ended no call.
    pub receive_errors: u32,
    /// Answers that did not keep the order of their requests: see [`Client::out_of_order`].
    pub out_of_order: u32,
}

impl Counters {
    /// Counts an event that does not end a call.
    fn count<R>(&mut self, event: &Event<'_, R>) {
        let (count, n) = match event {
            Event::Noise { bytes, .. } => (&mut self.noise_bytes, bytes.len() as u32),
            Event::Unknown { .. } => (&mut self.unknown, 1),
            Event::Late(_) => (&mut self.late, 1),
            Event::Unsolicited(_) => (&mut self.unsolicited, 1),
            Event::Echo => (&mut self.echoes, 1),
            Event::Answer(_)
            | Event::Unacceptable(_)
            | Event::ErrorFrame { .. }
            | Event::Sent
            | Event::TimedOut { .. }
            | Event::Broken { .. } => return,
        };
        *count = count.wrapping_add(n);
    }
}

/// A client that owns its port.
///
/// `N` is the size of its buffers in bytes; 260 bytes hold every message.
///
/// **The port** must buffer bytes between reads, return them when a read is first polled, and lose nothing in a dropped
/// read: every timeout drops one. A UART with a receive buffer does. A port that accepts no bytes blocks the call: add
/// a timeout around the call where this can happen.
///
/// **A receive error** of the port, such as an overrun or a framing error of a UART, is damage: a frame that it interrupts
/// is noise, and a read is repeated within its call. If no byte comes after it, the call ends with it at its timeout, as
/// [`CallError::Io`]. It ends the call at once on a [lossless](crate::framing::Framing::LOSSLESS) line, and if its kind is
/// none of `Other`, `InvalidData`, `Interrupted` and `TimedOut`: by the kind, the port decides. An error of a write ends
/// the call.
///
/// **Dropping a call** before it is complete is allowed if the port's writes may be dropped too. An unstarted request
/// is then never sent, and a partly written one is never executed: the next call makes the arm discard it, as
/// [`Client`] describes, or writes its rest if it has no void. A written one is flushed by the next call, and a later
/// answer to it satisfies no request.
///
/// **Timeouts** begin when the port has accepted the last byte. A flush does not extend them: an answer can be taken
/// for the answer to a newer request if its own request left the port after [`Config::stale_window`].
///
/// Each protocol has an `Arm` with a method for each request, built on these calls.
///
/// ```
/// # use armwire::driver::Clock;
/// # use embedded_io_async::{Read, Write};
/// use armwire::driver::{CallError, Counters, Driver};
/// use armwire::ling::{JointState, Ling, Request, Response};
/// use armwire::Config;
///
/// async fn joints<P: Read + Write>(port: P, clock: impl Clock) -> Result<Option<JointState>, CallError<P::Error>> {
///     let mut driver = Driver::<Ling, P, _, 70>::new(Ling, port, clock, Config::default());
///     let joints = driver.call(&Request::ReadJoints, |response| match response {
///         Response::Joints(state) => Some(state),
///         _ => None,
///     });
///     let joints = joints.await?.flatten();
///     let _counters: Counters = driver.counters();
///     let (_port, _clock) = driver.into_parts();
///     Ok(joints)
/// }
/// ```
pub struct Driver<M: Messages, Port, C, const N: usize> {
    port: Port,
    clock: C,
    client: Client<M, N>,
    counters: Counters,
    /// A frame was written, and no flush has completed since.
    needs_flush: bool,
}

impl<M: Messages, Port: Read + Write, C: Clock, const N: usize> Driver<M, Port, C, N> {
    /// A driver for the arm at the other end of `port`.
    pub const fn new(messages: M, port: Port, clock: C, config: Config) -> Self {
        Self {
            port,
            clock,
            client: Client::new(messages, config),
            counters: Counters {
                noise_bytes: 0,
                unknown: 0,
                late: 0,
                unsolicited: 0,
                echoes: 0,
                receive_errors: 0,
                out_of_order: 0,
            },
            needs_flush: false,
        }
    }

    /// Sends a request, waits for its answer, and returns the result of `take`. `None` for a request without an answer,
    /// once it is written.
    ///
    /// Bytes that have arrived are read before the request is sent: at most [`Config::backlog`] of them, or one read
    /// before a request without an answer. An endless stream of bytes delays neither the answer nor the timeout.
    ///
    /// # Errors
    ///
    /// [`CallError`] if the port fails, the connection is broken, or the arm does not answer, or with an error frame or
    /// an unacceptable answer.
    pub async fn call<T>(
        &mut self,
        request: &M::Request<'_>,
        take: impl FnOnce(M::Response<'_>) -> T,
    ) -> Result<Option<T>, CallError<Port::Error>> {
        // A request in flight belongs to a call that was dropped or has failed.
        self.client.cancel();
        self.complete().await?;
        self.flush().await?;
        self.client.submit(request).map_err(CallError::Submit)?;
        // The receive errors since the last byte, and the last of them.
        let mut failing = Failing { count: 0, last: None };
        loop {
            match self.client.poll(self.clock.now()) {
                Output::Receive => self.receive(Instant::ZERO, &mut failing).await?,
                Output::Timeout(until) => self.receive(until.unwrap_or_default(), &mut failing).await?,
                Output::Transmit(bytes) => {
                    let len = bytes.len();
                    let n = self.port.write(bytes).await.map_err(CallError::Io)?;
                    self.accepted(n, len).await?;
                }
                Output::Event(Event::Answer(response)) => return Ok(Some(take(response))),
                Output::Event(Event::Sent) => return Ok(None),
                Output::Event(Event::Unacceptable(error)) => return Err(CallError::Unacceptable(error)),
                Output::Event(Event::ErrorFrame { frame }) => {
                    return Err(CallError::ErrorFrame(ErrorFrame::new(frame)));
                }
                Output::Event(Event::TimedOut { sends }) => {
                    return Err(failing.last.map_or(CallError::TimedOut { sends }, CallError::Io));
                }
                Output::Event(Event::Broken { offset, reason }) => return Err(CallError::Broken { offset, reason }),
                Output::Event(other) => self.counters.count(&other),
            }
        }
    }

    /// Sends a request and returns its answer. `take` accepts every answer that is matched to the request.
    #[cfg(any(feature = "ling", feature = "xarm", feature = "alpha1"))]
    pub(crate) async fn read<T>(
        &mut self,
        request: &M::Request<'_>,
        take: impl FnOnce(M::Response<'_>) -> Option<T>,
    ) -> Result<T, CallError<Port::Error>> {
        let answer = self.call(request, take).await?;
        answer.flatten().ok_or(CallError::Unacceptable(ParseError::NO_FRAME))
    }

    /// Sends a request. Returns once it is answered, or once it is written if it has no answer.
    #[cfg(any(feature = "ling", feature = "xarm", feature = "alpha1"))]
    pub(crate) async fn send(&mut self, request: &M::Request<'_>) -> Result<(), CallError<Port::Error>> {
        self.call(request, |_| ()).await.map(drop)
    }

    /// The current time.
    #[cfg(feature = "ling")]
    pub(crate) fn now(&self) -> Instant {
        self.clock.now()
    }

    /// Resolves at `instant`.
    #[cfg(feature = "ling")]
    pub(crate) async fn wait_until(&self, instant: Instant) {
        self.clock.wait_until(instant).await;
    }

    /// The counts of received frames and bytes other than answers, since the driver was created.
    pub const fn counters(&self) -> Counters {
        let mut counters = self.counters;
        counters.out_of_order = self.client.out_of_order() as u32;
        counters
    }

    /// The frame that ended the last call: an answer, which may have more bytes than its response contains, or an error
    /// frame. Empty if the call ended without one.
    pub fn frame(&self) -> &[u8] {
        self.client.frame()
    }

    /// The protocol, for changes that apply to later requests.
    pub const fn messages_mut(&mut self) -> &mut M {
        self.client.messages_mut()
    }

    /// The port and the clock.
    pub fn into_parts(self) -> (Port, C) {
        (self.port, self.clock)
    }

    /// Transmits the rest of a cancelled request that has no void.
    async fn complete(&mut self) -> Result<(), CallError<Port::Error>> {
        while !self.client.is_idle() {
            if let Output::Transmit(bytes) = self.client.poll(self.clock.now()) {
                let len = bytes.len();
                let n = self.port.write(bytes).await.map_err(CallError::Io)?;
                self.accepted(n, len).await?;
            }
        }
        Ok(())
    }

    /// The port accepted `n` of `len` bytes. Flushes after the last of them.
    ///
    /// The bytes count before the flush, because the call may be dropped in it.
    async fn accepted(&mut self, n: usize, len: usize) -> Result<(), CallError<Port::Error>> {
        if n == 0 {
            return Err(CallError::Closed);
        }
        let now = self.clock.now();
        self.client.transmitted(now, n).map_err(CallError::Port)?;
        if n < len {
            return Ok(());
        }
        self.needs_flush = true;
        self.flush().await
    }

    /// Flushes the port, if a frame was written since the last complete flush.
    async fn flush(&mut self) -> Result<(), CallError<Port::Error>> {
        if self.needs_flush {
            self.port.flush().await.map_err(CallError::Io)?;
            self.needs_flush = false;
        }
        Ok(())
    }

    /// Reads once, until this time.
    async fn receive(
        &mut self,
        until: Instant,
        failing: &mut Failing<Port::Error>,
    ) -> Result<(), CallError<Port::Error>> {
        let read = first(self.port.read(self.client.space()), self.clock.wait_until(until)).await;
        let n = match read {
            None => 0,
            Some(Err(error)) if M::LOSSLESS || !is_damage(&error) => return Err(CallError::Io(error)),
            Some(Err(error)) => {
                self.counters.receive_errors = self.counters.receive_errors.wrapping_add(1);
                // No later byte continues the frame that it has interrupted.
                self.client.idle();
                failing.last = Some(error);
                failing.count = failing.count.saturating_add(1);
                if failing.count < MAX_ERRORS && until == Instant::ZERO {
                    return Ok(());
                }
                let next = self.clock.now() + RETRY_PERIOD;
                self.clock.wait_until(next.min(until)).await;
                0
            }
            Some(Ok(0)) => return Err(CallError::Closed),
            Some(Ok(n)) => {
                *failing = Failing { count: 0, last: None };
                n
            }
        };
        let now = self.clock.now();
        self.client.received(now, n).map_err(CallError::Port)
    }
}

impl<M: Messages, Port, C, const N: usize> fmt::Debug for Driver<M, Port, C, N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Driver")
            .field("client", &self.client)
            .field("counters", &self.counters)
            .finish_non_exhaustive()
    }
}

/// The receive errors of a port since its last byte.
struct Failing<E> {
    count: u8,
    last: Option<E>,
}

/// Returns true for a receive error after which the port goes on.
fn is_damage(error: &impl embedded_io_async::Error) -> bool {
    matches!(
        error.kind(),
        ErrorKind::Other | ErrorKind::InvalidData | ErrorKind::Interrupted | ErrorKind::TimedOut
    )
}

/// The output of `a`, or `None` if `b` completes first.
async fn first<A: Future>(a: A, b: impl Future<Output = ()>) -> Option<A::Output> {
    let (mut a, mut b) = (pin!(a), pin!(b));
    poll_fn(|cx| match a.as_mut().poll(cx) {
        Poll::Ready(output) => Poll::Ready(Some(output)),
        Poll::Pending => b.as_mut().poll(cx).map(|()| None),
    })
    .await
}
