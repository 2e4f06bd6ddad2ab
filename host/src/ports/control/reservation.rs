//! The reservation of the line between an adapter and its arm.

use std::fmt;
use std::time::{Duration, Instant};

use armwire_bridge::control::{RESERVATION_MS, Request};

use crate::error::Error;
use crate::ports::control::Adapter;

/// Period of the renewals: a fraction of a reservation.
const RENEWAL_PERIOD: Duration = Duration::from_millis(RESERVATION_MS as u64 / 5);

/// The line of an adapter, reserved for the host on USB: no polls, no CAN, no torque-off. Its drop releases the line.
#[must_use = "its drop releases the line"]
pub struct ReservedLine<'a> {
    adapter: &'a mut Adapter,
    renewed: Instant,
    /// True until the release is sent.
    is_reserved: bool,
}

impl Adapter {
    /// Reserves the line to the arm for the host on USB for [`RESERVATION_MS`] milliseconds: see
    /// [`Request::ReserveLine`].
    ///
    /// # Errors
    ///
    /// [`Error::Refused`] while a host streams motion, or has reserved the line on the other control port. Otherwise
    /// as of [`call`](Self::call): a reservation without a reply ends after its time.
    pub fn reserve_line(&mut self) -> Result<ReservedLine<'_>, Error> {
        self.call(Request::ReserveLine)?;
        Ok(ReservedLine {
            adapter: self,
            renewed: Instant::now(),
            is_reserved: true,
        })
    }
}

impl ReservedLine<'_> {
    /// Renews the reservation if a fifth of it has passed. Call it at least every second.
    ///
    /// # Errors
    ///
    /// As of [`Adapter::reserve_line`]: the line may not be reserved any more.
    pub fn renew(&mut self) -> Result<(), Error> {
        if self.renewed.elapsed() >= RENEWAL_PERIOD {
            self.adapter.call(Request::ReserveLine)?;
            self.renewed = Instant::now();
        }
        Ok(())
    }

    /// Releases the line.
    ///
    /// # Errors
    ///
    /// As of [`Adapter::call`]: the line is reserved until the end of the reservation.
    pub fn release(mut self) -> Result<(), Error> {
        self.is_reserved = false;
        self.adapter.call(Request::ReleaseLine).map(drop)
    }
}

impl Drop for ReservedLine<'_> {
    fn drop(&mut self) {
        if self.is_reserved {
            // An error has no recipient, and the reservation ends after its time.
            let _ = self.adapter.call(Request::ReleaseLine);
        }
    }
}

impl fmt::Debug for ReservedLine<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ReservedLine")
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
        let ends: [fn(ReservedLine<'_>); 2] = [|line| drop(line), |line| line.release().unwrap()];
        for end in ends {
            let requests = Arc::default();
            let mut adapter = Adapter::new(Box::new(Obedient {
                requests: Arc::clone(&requests),
                sequence: 0,
            }));
            let mut line = adapter.reserve_line().unwrap();
            line.renew().unwrap();
            end(line);
            assert_eq!(*requests.lock().unwrap(), [Request::ReserveLine, Request::ReleaseLine]);
        }
    }
}
