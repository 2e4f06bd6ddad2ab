//! The questions to an adapter whether it refuses motion, and their times.

use std::time::{Duration, Instant};

use armwire_bridge::control::StopInForce;

use crate::arm::shared::Shared;
use crate::error::Error;
use crate::error::usb_fault::UsbFault;
use crate::ports::control::Adapter;
use crate::ports::port::Connection;

/// The longest time between two moves of a stream.
const STREAM_GAP: Duration = Duration::from_millis(250);
/// Time between two questions within a stream of moves, or within a wait: less than an adapter refuses motion.
const PERIOD: Duration = Duration::from_secs(1);

/// The questions to the adapter on the arm's port.
#[derive(Debug, Default)]
pub(crate) struct Refusals {
    /// True if no adapter on this port can tell.
    is_silent: bool,
    /// The adapter whose control port a reader of this arm has.
    lent: Option<Shared<Adapter>>,
    asked: Option<Instant>,
    moved: Option<Instant>,
}

impl Refusals {
    /// Takes the adapter whose control port a reader has, until the reader ends.
    pub(crate) fn lend(&mut self, adapter: Shared<Adapter>) {
        (self.lent, self.is_silent) = (Some(adapter), false);
    }

    /// Asks before a move, unless it goes on with a stream that was asked about within the last second. Returns what
    /// [`ask`](Self::ask) does.
    pub(crate) fn before_move(&mut self, connection: &Connection) -> Option<StopInForce> {
        let is_stream = is_within(self.moved.replace(Instant::now()), STREAM_GAP);
        match is_within(self.asked, if is_stream { PERIOD } else { STREAM_GAP }) {
            true => None,
            false => self.ask(connection),
        }
    }

    /// Asks in a wait for a motion, once a second. Returns what [`ask`](Self::ask) does.
    pub(crate) fn in_wait(&mut self, connection: &Connection) -> Option<StopInForce> {
        match is_within(self.asked, PERIOD) {
            true => None,
            false => self.ask(connection),
        }
    }

    /// Asks the adapter, and returns the stop for which it refuses motion. One that cannot be asked is not known to.
    pub(crate) fn ask(&mut self, connection: &Connection) -> Option<StopInForce> {
        if self.is_silent {
            return None;
        }
        self.asked = Some(Instant::now());
        match self.stop_in_force(connection) {
            Ok(None) => None,
            Ok(stop) => {
                // The next move asks again.
                self.asked = None;
                stop
            }
            // Later it may be free.
            Err(
                Error::InUse { .. }
                | Error::Usb {
                    fault: UsbFault::Busy, ..
                },
            ) => None,
            Err(_) => {
                self.is_silent = true;
                None
            }
        }
    }

    fn stop_in_force(&mut self, connection: &Connection) -> Result<Option<StopInForce>, Error> {
        if let Some(adapter) = &self.lent {
            match adapter.call(Adapter::stop_in_force) {
                Err(Error::Closed { .. }) => self.lent = None,
                told => return told,
            }
        }
        connection.adapter()?.stop_in_force()
    }
}

/// Returns true if less than this time has passed since then.
fn is_within(at: Option<Instant>, time: Duration) -> bool {
    at.is_some_and(|at| at.elapsed() < time)
}
