//! A client, and the line whose bytes it takes and gives.

use std::mem;
use std::ops::ControlFlow;
use std::time::Duration;

use armwire::framing::Reason;
use armwire::time::Instant;
use armwire::{Client, Config, Event, Output, xarm};

use super::line_errors::LineErrors;
use crate::describe::Arm;
use crate::error::Error;
use crate::error::text::Text;
use crate::ports::line::{Line, Names, Reception};
use crate::ports::raw_port::RawPort;
use crate::time::stamps::{HostTime, monotonic};
use crate::time::stopwatch::Stopwatch;

/// Buffer size: the longest frame of every protocol fits.
pub(super) const BUFFER: usize = xarm::MAX_FRAME;
/// Number of received bytes kept for hints after a missing answer.
const MAX_KEPT: usize = 256;

/// A client on an open line, the only one that reads and writes it.
pub(super) struct LineClient<P: Arm> {
    pub(super) port: RawPort,
    client: Client<P, BUFFER>,
    /// Bytes read but not yet passed to the client.
    unread: Vec<u8>,
    /// Bytes received since the last request was submitted: their number, and the first [`MAX_KEPT`].
    received: usize,
    kept: Vec<u8>,
    clock: Stopwatch,
    /// The start of the clock, on the monotonic clock. Times that are converted by it keep their order.
    started_ns: i64,
    errors: LineErrors,
}

impl<P: Arm> LineClient<P> {
    pub(super) fn new(line: Box<dyn Line>, config: Config) -> Self {
        // Not later than the start: no state is stated younger than it is.
        let started_ns = monotonic();
        Self {
            started_ns,
            port: RawPort::new(line),
            client: Client::new(P::default(), config),
            unread: Vec::new(),
            received: 0,
            kept: Vec::new(),
            clock: Stopwatch::start(),
            errors: LineErrors::default(),
        }
    }

    /// Goes on with this line, without the requests on the one before. The tap and the interrupt stay.
    pub(super) fn replace_line(&mut self, line: Box<dyn Line>, config: Config) {
        self.errors = self.errors();
        self.port.line = line;
        self.client = Client::new(mem::take(self.client.messages_mut()), config);
        self.unread.clear();
        (self.received, self.kept) = (0, Vec::new());
    }

    pub(super) fn messages_mut(&mut self) -> &mut P {
        self.client.messages_mut()
    }

    /// Replaces the request in flight by this one.
    pub(super) fn submit(&mut self, request: &P::Request<'_>) {
        self.cancel();
        self.client
            .submit(request)
            .expect("the client is idle, and has room for any request");
    }

    /// Replaces the request in flight by this reading. See [`Client::submit_reading`].
    pub(super) fn submit_reading(&mut self, request: &P::Request<'_>) {
        self.cancel();
        self.client
            .submit_reading(request)
            .expect("the client is idle, has room for any request, and this one is a read");
    }

    /// Cancels the request in flight, and forgets the received bytes.
    pub(super) fn cancel(&mut self) {
        self.client.cancel();
        self.received = 0;
        self.kept.clear();
    }

    /// Does all work of the client that is due: sends its bytes, reads those that have arrived, and passes its events to
    /// `take`, except for noise, which it counts. Ends with the first value that `take` returns, or with the time until
    /// which the client waits for bytes.
    ///
    /// # Errors
    ///
    /// Errors of the line, and [`Error::Unacceptable`] or [`Error::Lost`] if the stream is broken.
    pub(super) fn advance<T>(
        &mut self,
        mut take: impl FnMut(Event<'_, P::Response<'_>>) -> ControlFlow<T>,
    ) -> Result<ControlFlow<T, Option<Instant>>, Error> {
        loop {
            match self.client.poll(self.clock.now()) {
                Output::Receive => {
                    self.receive(Duration::ZERO)?;
                }
                Output::Transmit(bytes) => {
                    let n = self.port.write(bytes)?;
                    self.client
                        .transmitted(self.clock.now(), n)
                        .expect("the line wrote no more than there was");
                }
                Output::Timeout(until) => return Ok(ControlFlow::Continue(until)),
                Output::Event(Event::Noise { bytes, reason, .. }) => self.errors.count(bytes, reason),
                Output::Event(Event::Broken { offset, reason }) => return Err(self.broken(offset, reason)),
                Output::Event(event) => {
                    if let ControlFlow::Break(value) = take(event) {
                        return Ok(ControlFlow::Break(value));
                    }
                }
            }
        }
    }

    /// Passes the events of the received bytes to `take`, except for noise, which it counts. Sends and reads nothing.
    ///
    /// # Errors
    ///
    /// The stream is broken.
    pub(super) fn take_events(&mut self, mut take: impl FnMut(Event<'_, P::Response<'_>>)) -> Result<(), Error> {
        let now = self.clock.now();
        while let Output::Event(event) = self.client.poll(now) {
            match event {
                Event::Noise { bytes, reason, .. } => self.errors.count(bytes, reason),
                Event::Broken { offset, reason } => return Err(self.broken(offset, reason)),
                event => take(event),
            }
        }
        Ok(())
    }

    /// Passes received bytes to the client, waiting at most this long for the first one. Returns their number.
    ///
    /// # Errors
    ///
    /// Errors of the line, and [`Error::Interrupted`] by the program's check.
    pub(super) fn receive(&mut self, wait: Duration) -> Result<usize, Error> {
        if self.unread.is_empty() {
            let mut buf = [0; 256];
            let n = self.port.read(&mut buf, wait)?;
            self.unread.extend(&buf[..n]);
            self.received += n;
            let room = MAX_KEPT - self.kept.len();
            self.kept.extend(buf[..n].iter().take(room));
        }
        let left = self.client.receive(self.clock.now(), &self.unread).len();
        let n = self.unread.len() - left;
        self.unread.drain(..n);
        Ok(n)
    }

    /// The error of a stream that broke at this offset.
    fn broken(&self, offset: u64, reason: Reason) -> Error {
        if reason == Reason::Abandoned {
            let reason = "the connection ended in the middle of a request: open it again";
            return Error::lost(self.name(), reason);
        }
        let name = P::NAME;
        let reason = format_args!(
            "the received bytes are no message of {name} (byte {offset}: {reason}): is it this arm, and its control \
             port?"
        );
        Error::unacceptable(self.name(), reason)
    }

    /// The number of bytes received since the last request was submitted, and the first of them.
    pub(super) fn received(&self) -> (usize, &[u8]) {
        (self.received, &self.kept)
    }

    /// The frame that ended the last request.
    pub(super) fn frame(&self) -> &[u8] {
        self.client.frame()
    }

    /// The time of the state in the last answer: see [`Client::time_of_state`]. Now, if the last event was no answer.
    pub(super) fn time_of_state(&self) -> HostTime {
        let at = self.client.time_of_state().unwrap_or_else(|| self.clock.now());
        let since_start = i64::try_from(at.as_micros()).unwrap_or(i64::MAX).saturating_mul(1_000);
        HostTime::now().at(self.started_ns.saturating_add(since_start))
    }

    pub(super) fn errors(&self) -> LineErrors {
        LineErrors {
            out_of_order: self.errors.out_of_order + usize::from(self.client.out_of_order()),
            ..self.errors
        }
    }

    pub(super) fn clock(&self) -> Stopwatch {
        self.clock
    }

    pub(super) fn name(&self) -> &str {
        self.port.name()
    }

    pub(super) fn hint(&self, reception: Reception, names: Names) -> Text {
        self.port.hint(reception, names)
    }
}
