//! The watchdog.

use embassy_stm32::peripherals::IWDG;
use embassy_stm32::wdg::IndependentWatchdog;

/// The watchdog. It runs on an oscillator of its own: a wait for a clock that never starts ends in a reset.
pub(crate) struct Watchdog(IndependentWatchdog<'static, IWDG>);

impl Watchdog {
    /// Starts the watchdog. Only a reset stops it. Call this once.
    pub(crate) fn start(timeout_us: u32) -> Self {
        // SAFETY: no other code takes it.
        let mut watchdog = IndependentWatchdog::new(unsafe { IWDG::steal() }, timeout_us);
        watchdog.unleash();
        Self(watchdog)
    }

    /// Starts the timeout again.
    pub(crate) fn pet(&mut self) {
        self.0.pet();
    }
}
