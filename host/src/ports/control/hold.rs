//! The hold of the line between an adapter and its arm.

use std::fmt;
use std::time::{Duration, Instant};

use armwire_bridge::control::{HOLD_LEASE_MS, Request};

use crate::error::Error;
use crate::ports::control::Adapter;

/// Period of the renewals: a fraction of the lease.
const RENEWAL_PERIOD: Duration = Duration::from_millis(HOLD_LEASE_MS as u64 / 5);

/// The line of an adapter, held for the host on USB: no polls, no CAN, no torque-off. Its drop releases the line.
#[must_use = "its drop releases the line"]
pub struct Hold<'a> {
    adapter: &'a mut Adapter,
    renewed: Instant,
    /// True until the release is sent.
    is_held: bool,
}

impl Adapter {
    /// Holds the line to the arm for the host on USB, for [`HOLD_LEASE_MS`] milliseconds: see [`Request::HoldLine`].
    ///
    /// # Errors
    ///
    /// [`Error::Refused`] while a host streams motion, or holds the line on the other control port. Otherwise as of
    /// [`call`](Self::call): a hold without a reply ends with its lease.
    pub fn hold_line(&mut self) -> Result<Hold<'_>, Error> {
        self.call(Request::HoldLine)?;
        Ok(Hold {
            adapter: self,
            renewed: Instant::now(),
            is_held: true,
        })
    }
}

impl Hold<'_> {
    /// Renews the lease if a fifth of it has passed. Call it at least every second.
    ///
    /// # Errors
    ///
    /// As of [`Adapter::hold_line`]: the line may not be held any more.
    pub fn keep(&mut self) -> Result<(), Error> {
        if self.renewed.elapsed() >= RENEWAL_PERIOD {
            self.adapter.call(Request::HoldLine)?;
            self.renewed = Instant::now();
        }
        Ok(())
    }

    /// Releases the line.
    ///
    /// # Errors
    ///
    /// As of [`Adapter::call`]: the line is held until the end of the lease.
    pub fn release(mut self) -> Result<(), Error> {
        self.is_held = false;
        self.adapter.call(Request::ReleaseLine).map(drop)
    }
}

impl Drop for Hold<'_> {
    fn drop(&mut self) {
        if self.is_held {
            // An error has no recipient, and the lease ends the hold.
            let _ = self.adapter.call(Request::ReleaseLine);
        }
    }
}

impl fmt::Debug for Hold<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Hold")
            .field("adapter", &self.adapter)
            .finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use std::sync::{Arc, Mutex};

    use armwire_bridge::control::{FromAdapter, FromHost, Reply};

    use super::*;
    use crate::ports::control::{Received, Transport};

    /// An adapter that does whatever is requested.
    struct Obedient {
        requests: Arc<Mutex<Vec<Request>>>,
        sequence: u8,
    }

    impl Transport for Obedient {
        fn name(&self) -> &str {
            "fake"
        }

        fn send(&mut self, message: &FromHost) -> Result<(), Error> {
            self.sequence = message.sequence;
            self.requests.lock().unwrap().push(message.request);
            Ok(())
        }

        fn receive(&mut self, _: Duration) -> Result<Option<Received>, Error> {
            let (sequence, reply) = (self.sequence, Reply::Done);
            Ok(Some(Ok(FromAdapter::Reply { sequence, reply })))
        }

        fn hint(&self) -> String {
            String::new()
        }
    }

    #[test]
    fn line_is_released_once() {
        let ends: [fn(Hold<'_>); 2] = [|hold| drop(hold), |hold| hold.release().unwrap()];
        for end in ends {
            let requests = Arc::default();
            let mut adapter = Adapter::new(Box::new(Obedient {
                requests: Arc::clone(&requests),
                sequence: 0,
            }));
            let mut hold = adapter.hold_line().unwrap();
            hold.keep().unwrap();
            end(hold);
            assert_eq!(*requests.lock().unwrap(), [Request::HoldLine, Request::ReleaseLine]);
        }
    }
}
