//! The time, as the bridge counts it.

use armwire_bridge::Instant;

/// The current time of the microsecond timer.
pub(crate) fn now() -> Instant {
    Instant::from_micros(embassy_time::Instant::now().as_micros())
}
