//! A fixed grid of instants.

use armwire::time::{Duration, Instant};

/// The next instant of the grid through `at`, or one period from now if that has passed.
pub(super) fn next(at: Instant, period: Duration, now: Instant) -> Instant {
    let next = at + period;
    if next > now { next } else { now + period }
}
