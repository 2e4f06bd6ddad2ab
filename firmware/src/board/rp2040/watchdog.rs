//! The watchdog.

use embassy_rp::pac;
use embassy_rp::peripherals::WATCHDOG;
use embassy_time::Duration;

/// The mark in SCRATCH4 of a watchdog that the firmware has started. The ROM's restart after an update clears the register
/// and uses the watchdog's timer, too (2.8.1.1, 2.8.4).
const MARK: u32 = 0x3A7E_11D5;

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
        hal.set_scratch(4, MARK);
        hal.start(timeout);
        Self { hal, timeout }
    }

    /// Returns true if the watchdog of an earlier run has reset the chip (4.7.6).
    pub(super) fn has_reset() -> bool {
        pac::WATCHDOG.reason().read().timer() && pac::WATCHDOG.scratch4().read() == MARK
    }

    /// Starts the timeout again.
    pub(crate) fn pet(&mut self) {
        self.hal.feed(self.timeout);
    }
}
