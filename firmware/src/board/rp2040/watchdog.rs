//! The watchdog.

use embassy_rp::peripherals::WATCHDOG;
use embassy_time::Duration;

/// The watchdog. Its ticks come from the crystal: it counts from [`init`](super::init) on.
pub(crate) struct Watchdog {
    hal: embassy_rp::watchdog::Watchdog,
    timeout: Duration,
}

impl Watchdog {
    /// Starts the watchdog. Only a reset stops it. Call this once.
    pub(crate) fn start(timeout_us: u32) -> Self {
        // SAFETY: no other code takes it.
        let mut hal = embassy_rp::watchdog::Watchdog::new(unsafe { WATCHDOG::steal() });
        let timeout = Duration::from_micros(timeout_us.into());
        hal.start(timeout);
        Self { hal, timeout }
    }

    /// Starts the timeout again.
    pub(crate) fn pet(&mut self) {
        self.hal.feed(self.timeout);
    }
}
