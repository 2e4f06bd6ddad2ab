//! Time of the state machines, on this computer's monotonic clock.

use std::time::{Duration, Instant};

use armwire::time;

use super::stamps::{HostTime, monotonic};

/// Stands for a time that is farther than the clock counts: 30 years.
const FAR: Duration = Duration::from_secs(30 * 365 * 24 * 60 * 60);

/// The end of a wait that begins now.
pub(crate) fn after(wait: Duration) -> Instant {
    let now = Instant::now();
    now.checked_add(wait).unwrap_or(now + FAR)
}

/// A clock that is zero at an instant.
#[derive(Clone, Copy, Debug)]
pub struct Stopwatch(pub Instant);

impl Stopwatch {
    /// A clock that is zero now.
    pub fn start() -> Self {
        Self(Instant::now())
    }

    /// Time since the start.
    pub fn now(&self) -> time::Instant {
        time::Instant::from_micros(self.0.elapsed().as_micros().try_into().unwrap_or(u64::MAX))
    }

    /// The instant at this time of the host; zero if the clock was not started then.
    pub fn at(&self, time: HostTime) -> time::Instant {
        // Not later than it was, even if this thread is interrupted here.
        let now = self.now();
        let age = monotonic().saturating_sub(time.monotonic_ns).try_into().unwrap_or(0);
        now - Duration::from_nanos(age).try_into().unwrap_or(time::Duration::MAX)
    }

    /// Time from now to `instant`; zero if it has passed.
    pub fn until(&self, instant: time::Instant) -> Duration {
        instant.since(self.now()).into()
    }
}
