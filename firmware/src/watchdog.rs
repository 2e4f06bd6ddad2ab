//! The watchdog: resets the chip when a task makes no [progress](crate::progress).
//!
//! The watchdog is fed while no task is overdue. A separate task feeds it, which a task that never yields would block.
//! It is fed only while the bridge reports that bytes move: a task might rest despite pending work.

use armwire_bridge::start::StartLog;
use embassy_time::Timer;

use crate::adapter::Adapter;
use crate::board::Watchdog;
use crate::clock::now;
use crate::pend::pend;
use crate::progress::end_round;
use crate::restart;

/// The timeout, by the watchdog's own clock, which may be off by half. The erase of both flash sectors of the
/// configuration stalls the core for 1 s at worst.
const TIMEOUT_US: u32 = 2_000_000;

/// Period of the checks.
const ROUND_MS: u64 = 100;

/// Starts the watchdog. It can only be stopped by a reset. Call this once, and not before the boot loader, which does not
/// feed it.
pub(crate) fn start() -> Watchdog {
    Watchdog::start(TIMEOUT_US)
}

/// Feeds the watchdog while all tasks make progress, and keeps the record of starts.
#[embassy_executor::task]
pub(crate) async fn feed(adapter: &'static Adapter, mut watchdog: Watchdog, mut starts: StartLog) {
    watchdog.pet();
    // Offset from the LED's period: both at once would delay the end of a frame for longer.
    Timer::after_millis(ROUND_MS / 4).await;
    loop {
        let progresses = end_round();
        if progresses && !adapter.take(|bridge| bridge.is_stuck(now())) {
            watchdog.pet();
        } else {
            warning!("the watchdog is not fed: tasks make progress: {=bool}", progresses);
        }
        let config = adapter.take(|bridge| bridge.config());
        if let Some(words) = starts.running(now(), &config) {
            restart::keep(words);
        }
        // The service must show that it runs.
        pend();
        Timer::after_millis(ROUND_MS).await;
    }
}
