//! A [`Client`] over `embedded-io-async`.

use core::fmt;
use core::future::{Future, poll_fn};
use core::pin::pin;
use core::task::Poll;

use embedded_io_async::{Read, Write};

use crate::{Client, Config, Event, Input, Micros, Noise, OutOfRange, Protocol};

/// A monotonic clock that can also wait: the driver's only need of a runtime.
///
/// ```no_run
/// use armwire::Micros;
/// use armwire::driver::Clock;
/// use embassy_time::{Instant, Timer};
///
/// struct Embassy;
///
/// impl Clock for Embassy {
///     fn now(&self) -> Micros {
///         Micros(Instant::now().as_micros())
///     }
///
///     async fn wait_until(&self, instant: Micros) {
///         Timer::at(Instant::from_micros(instant.0)).await;
///     }
/// }
/// ```
pub trait Clock {
    /// Now.
    fn now(&self) -> Micros;

    /// Resolves at `instant`, or at once if it is past.
    fn wait_until(&self, instant: Micros) -> impl Future<Output = ()>;
}

impl<C: Clock> Clock for &C {
    fn now(&self) -> Micros {
        C::now(self)
    }

    fn wait_until(&self, instant: Micros) -> impl Future<Output = ()> {
        C::wait_until(self, instant)
    }
}

/// The most reads that give bytes before [`Driver::call`] sends a request, where the bytes do not end.
///
/// What has arrived is read first, so that an old answer is not taken for the new one. A port that keeps more than this
/// many reads give may pass an old answer off as a new one.
pub const READS_BEFORE_SEND: usize = 256;

/// Why a call failed: `E` is the error of the port, `R` the [`Protocol::Error`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum CallError<E, R> {
    /// The port failed.
    Io(E),
    /// The port says that it took more bytes than it was given.
    TookTooMany(OutOfRange<usize>),
    /// The port took or gave no bytes where it must: it is closed.
    Closed,
    /// What arrived cannot be read, nor can anything after it: the connection must be closed.
    Broken(Noise),
    /// The arm's answer has a value or a length that the protocol does not have, for this reason.
    Unacceptable(R),
    /// The arm did not answer.
    TimedOut {
        /// How often the request was sent.
        sends: u8,
    },
}

impl<E: fmt::Display, R: fmt::Display> fmt::Display for CallError<E, R> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Io(error) => write!(f, "the port failed: {error}"),
            Self::TookTooMany(error) => write!(f, "the port took more than it was given: {error}"),
            Self::Closed => f.write_str("the port is closed"),
            Self::Broken(noise) => write!(f, "the connection is broken: {noise}"),
            Self::Unacceptable(error) => write!(f, "the arm's answer cannot be accepted: {error}"),
            Self::TimedOut { sends: 1 } => f.write_str("the arm did not answer"),
            Self::TimedOut { sends } => write!(f, "the arm did not answer, asked {sends} times"),
        }
    }
}

impl<E, R> core::error::Error for CallError<E, R>
where
    E: core::error::Error + 'static,
    R: core::error::Error + 'static,
{
    fn source(&self) -> Option<&(dyn core::error::Error + 'static)> {
        match self {
            Self::Io(error) => Some(error),
            Self::TookTooMany(error) => Some(error),
            Self::Broken(noise) => Some(noise),
            Self::Unacceptable(error) => Some(error),
            Self::Closed | Self::TimedOut { .. } => None,
        }
    }
}

/// Counts of what was heard besides answers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Counters {
    /// Bytes that were not part of a frame.
    pub noise_bytes: u32,
    /// Good frames that are no message of the protocol.
    pub unknown: u32,
    /// Answers that came too late, or twice.
    pub late: u32,
    /// Responses that answer nothing.
    pub unsolicited: u32,
    /// Requests that the line gave back.
    pub echoes: u32,
}

/// A client that owns its port.
///
/// `N` is the size of its buffers in bytes, at least [`Framing::MAX_FRAME`](crate::Framing::MAX_FRAME).
///
/// **The port** must keep what arrives between reads, and a read that is dropped must lose nothing: every time-out
/// drops one. A UART with a receive buffer does so. A port that takes no bytes stalls a call for as long: put a
/// time-out around the call where that may be.
///
/// **Dropping a call** before it is done is allowed if the port's writes may be dropped too. A request that was not
/// begun is then never sent. One that was half written is finished by the next call, before its own, so the arm is
/// never left with half a frame. Its answer, should it come, satisfies nothing (see [`Client`]).
///
/// Each protocol has an `Arm` with a call for each request; this is what they are made of.
///
/// ```
/// # use armwire::driver::Clock;
/// # use embedded_io_async::{Read, Write};
/// use armwire::driver::{Counters, Driver};
/// use armwire::ling::{CallError, Ling, MAX_FRAME, Request, Response};
/// use armwire::Config;
///
/// async fn listen<P: Read + Write>(port: P, clock: impl Clock) -> Result<(P, Counters), CallError<P::Error>> {
///     let mut driver = Driver::<Ling, P, _, MAX_FRAME>::new(port, clock, Config::default());
///     let answer: Option<Response> = driver.call(Request::ReadJoints).await?;
///     let heard = driver.counters();
///     let (port, _clock) = driver.into_parts();
///     Ok((port, heard))
/// }
/// ```
pub struct Driver<P: Protocol, Port, C, const N: usize> {
    port: Port,
    clock: C,
    client: Client<P, N>,
    counters: Counters,
}

impl<P: Protocol, Port: Read + Write, C: Clock, const N: usize> Driver<P, Port, C, N> {
    /// A driver for the arm at the other end of `port`.
    pub const fn new(port: Port, clock: C, config: Config) -> Self {
        Self {
            port,
            clock,
            client: Client::new(config),
            counters: Counters {
                noise_bytes: 0,
                unknown: 0,
                late: 0,
                unsolicited: 0,
                echoes: 0,
            },
        }
    }

    /// Sends a request and waits for its answer; `None` for a request the arm does not answer, once it is written.
    ///
    /// What has arrived is read before the request is sent, with at most [`READS_BEFORE_SEND`] reads. Bytes that do not
    /// end delay neither the answer nor the time-out.
    ///
    /// # Errors
    ///
    /// [`CallError`] when the port fails, the connection is broken, or the arm does not answer or gives an answer that is
    /// none.
    pub async fn call(&mut self, request: P::Request) -> Result<Option<P::Response>, CallError<Port::Error, P::Error>> {
        // Whatever is in flight here belongs to a call that was dropped, or failed.
        self.client.cancel(self.clock.now());
        // So this cannot be refused.
        let _ = self.client.submit(request);
        let mut reads = 0_usize;
        loop {
            let mut buf = [0; N];
            // With nothing to wait for this takes what has arrived, so that no old answer is taken for a new one.
            let due = self.client.poll_timeout().unwrap_or_default();
            let mut input = match first(self.port.read(&mut buf), self.clock.wait_until(due)).await {
                None => Input::Tick,
                Some(Err(error)) => return Err(CallError::Io(error)),
                Some(Ok(0)) => return Err(CallError::Closed),
                Some(Ok(n)) => Input::Bytes(buf.get(..n).unwrap_or_default()),
            };
            let drained = matches!(input, Input::Tick);
            let mut outcome = None;
            // To the end, even once the answer is there: what follows it in the same read would be lost.
            while let Some(event) = self.client.handle(self.clock.now(), &mut input) {
                match event {
                    Event::Answer(response) => outcome = Some(Ok(Some(response))),
                    Event::Unacceptable(error) => outcome = Some(Err(CallError::Unacceptable(error))),
                    Event::Sent => outcome = Some(Ok(None)),
                    Event::TimedOut { sends } => outcome = Some(Err(CallError::TimedOut { sends })),
                    Event::Broken(noise) => outcome = Some(outcome.unwrap_or(Err(CallError::Broken(noise)))),
                    other => self.count(&other),
                }
            }
            if let Some(outcome) = outcome {
                return outcome;
            }
            reads = reads.saturating_add(1);
            // Torque off does not wait for an arm that never stops talking.
            if drained || reads >= READS_BEFORE_SEND || P::reply(&request).is_none() {
                self.write().await?;
            }
        }
    }

    /// Makes a call that has an answer. `take` must take every answer the request may get.
    #[cfg(any(feature = "ling", feature = "xarm", feature = "alpha1"))]
    pub(crate) async fn read<T>(
        &mut self,
        request: P::Request,
        take: fn(P::Response) -> Option<T>,
    ) -> Result<T, CallError<Port::Error, P::Error>> {
        loop {
            // The client lets only answers to this request through, so the first one is it.
            if let Some(answer) = self.call(request).await?.and_then(take) {
                return Ok(answer);
            }
        }
    }

    /// What was heard besides answers, since the driver was made.
    pub const fn counters(&self) -> Counters {
        self.counters
    }

    /// The port and the clock.
    pub fn into_parts(self) -> (Port, C) {
        (self.port, self.clock)
    }

    async fn write(&mut self) -> Result<(), CallError<Port::Error, P::Error>> {
        let mut wrote = false;
        while let Some(bytes) = self.client.poll_transmit(self.clock.now()) {
            match self.port.write(bytes).await {
                Ok(0) => return Err(CallError::Closed),
                Ok(n) => self
                    .client
                    .transmitted(self.clock.now(), n)
                    .map_err(CallError::TookTooMany)?,
                Err(error) => return Err(CallError::Io(error)),
            }
            wrote = true;
        }
        if wrote {
            self.port.flush().await.map_err(CallError::Io)?;
        }
        Ok(())
    }

    fn count(&mut self, event: &Event<P>) {
        let (count, n) = match event {
            Event::Noise(noise) => (&mut self.counters.noise_bytes, noise.len as u32),
            Event::Unknown(_) => (&mut self.counters.unknown, 1),
            Event::Late(_) => (&mut self.counters.late, 1),
            Event::Unsolicited(_) => (&mut self.counters.unsolicited, 1),
            Event::Echo => (&mut self.counters.echoes, 1),
            Event::Answer(_) | Event::Unacceptable(_) | Event::Sent | Event::TimedOut { .. } | Event::Broken(_) => {
                return;
            }
        };
        *count = count.wrapping_add(n);
    }
}

impl<P: Protocol, Port, C, const N: usize> fmt::Debug for Driver<P, Port, C, N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Driver")
            .field("client", &self.client)
            .field("counters", &self.counters)
            .finish_non_exhaustive()
    }
}

/// The output of `a`, or `None` when `b` is done first.
async fn first<A: Future>(a: A, b: impl Future<Output = ()>) -> Option<A::Output> {
    let (mut a, mut b) = (pin!(a), pin!(b));
    poll_fn(|cx| match a.as_mut().poll(cx) {
        Poll::Ready(output) => Poll::Ready(Some(output)),
        Poll::Pending => b.as_mut().poll(cx).map(|()| None),
    })
    .await
}
