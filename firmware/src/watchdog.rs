//! The independent watchdog: resets the chip when the adapter is stuck.
//!
//! It is fed by a task, so a task that never yields starves it, and only while the bridge says that bytes move.

use embassy_time::Timer;

use crate::adapter::{Adapter, now};
use crate::board::Watchdog;
use crate::uart;

/// How long the adapter may be stuck, by the watchdog's own clock, which may be off by half.
pub(crate) const TIMEOUT_US: u32 = 2_000_000;

/// Feeds the watchdog while bytes move.
#[embassy_executor::task]
pub(crate) async fn feed(adapter: &'static Adapter, mut watchdog: Watchdog) {
    watchdog.unleash();
    // Out of step with the LED: both at once would hold up the end of a frame for longer.
    Timer::after_millis(25).await;
    loop {
        if !adapter.with(|bridge| bridge.is_stuck(now())) {
            watchdog.pet();
        }
        uart::wake();
        Timer::after_millis(100).await;
    }
}
