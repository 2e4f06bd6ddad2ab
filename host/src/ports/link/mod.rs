//! Blocking calls over a line, one at a time.
//!
//! * `line_client`: the client and its line, which move each other's bytes;
//! * `calls`: requests whose answers are waited for;
//! * `readings`: requests whose answers arrive later;
//! * `line_errors`: errors counted on the line.

mod calls;
#[cfg(test)]
mod fake;
mod line_client;
mod line_errors;
mod readings;

use std::fmt;
use std::time::{Duration, Instant};

use armwire::Config;

use crate::describe::Arm;
use crate::error::Error;
use crate::error::outside::Outside;
use crate::ports::interrupt::{Check, Interrupt};
use crate::ports::line::Line;
use crate::ports::lost_line::LostLine;
use crate::ports::tap::Tap;
use crate::time::stamps::HostTime;
use line_client::LineClient;
pub use line_errors::LineErrors;

/// An open line with a client on it.
pub struct Link<P: Arm> {
    client: LineClient<P>,
    stale_window: Duration,
}

impl<P: Arm> Link<P> {
    /// A client on this line with the timing in `config`.
    pub(crate) fn new(line: Box<dyn Line>, config: Config) -> Self {
        Self {
            client: LineClient::new(line, config),
            stale_window: config.stale_window.into(),
        }
    }

    /// Goes on with this line, which has the timing in `config`. The tap and the interrupt stay.
    pub(crate) fn replace_line(&mut self, line: Box<dyn Line>, config: Config) {
        self.stale_window = config.stale_window.into();
        self.client.replace_line(line, config);
    }

    /// Closes the port. Calls fail with this reason as [`Error::Lost`].
    pub(crate) fn disconnect(&mut self, reason: Outside) {
        let name = self.name().to_owned();
        self.replace_line(Box::new(LostLine { name, reason }), P::CONFIG);
    }

    /// The protocol, to change what the next requests are like.
    pub fn messages_mut(&mut self) -> &mut P {
        self.client.messages_mut()
    }

    /// Makes calls run this check at least every 100 ms while they wait, whether bytes arrive or not. Its error ends the
    /// call, as [`Error::Interrupted`].
    pub fn set_interrupt(&mut self, check: impl FnMut() -> Interrupt + Send + 'static) {
        self.client.port.set_interrupt(check);
    }

    /// Gives `tap` all bytes from now on, in both directions.
    pub fn set_tap(&mut self, tap: impl Tap + 'static) {
        self.client.port.set_tap(tap);
    }

    /// Runs the interrupt's check.
    pub(crate) fn check_interrupt(&mut self) -> Result<(), Error> {
        self.client.port.interrupter.run(Instant::now())
    }

    /// The text of the last error that the interrupt's check returned since this was last called.
    pub(crate) fn take_interrupted(&mut self) -> Option<String> {
        self.client.port.interrupter.take_interrupted()
    }

    /// Runs calls without the interrupt.
    pub(crate) fn uninterrupted<T>(&mut self, run: impl FnOnce(&mut Self) -> T) -> T {
        let check = self.take_check();
        let result = run(self);
        self.set_check(check);
        result
    }

    /// Takes the check of the interrupt, if there is one.
    pub(crate) fn take_check(&mut self) -> Option<Check> {
        self.client.port.interrupter.take()
    }

    pub(crate) fn set_check(&mut self, check: Option<Check>) {
        self.client.port.interrupter.set(check);
    }

    /// The frame that ended the last call: an answer, which may have more bytes than its response contains. Empty if
    /// the call ended without one.
    pub fn frame(&self) -> &[u8] {
        self.client.frame()
    }

    /// The time of the state in the answer that ended the last call: see
    /// [`Client::time_of_state`](armwire::Client::time_of_state).
    pub(crate) fn time_of_state(&self) -> HostTime {
        self.client.time_of_state()
    }

    /// Errors on the line so far.
    pub fn line_errors(&self) -> LineErrors {
        self.client.errors()
    }

    /// The line's name, as typed by the user.
    pub fn name(&self) -> &str {
        self.client.name()
    }
}

impl<P: Arm> fmt::Debug for Link<P> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Link")
            .field("name", &self.name())
            .field("protocol", &P::PROTOCOL)
            .field("errors", &self.line_errors())
            .finish_non_exhaustive()
    }
}
