//! The independent watchdog: resets the chip when a task makes no progress.
//!
//! An idle task rests: it waits for a signal, for any time, inside [`rest`]. All other waits, for example for the end
//! of a DMA transfer, are bounded. A task that is not at rest must come to rest, or report [`progress`] from time to
//! time. The watchdog is fed while no task is overdue. It is fed by a separate task: a task that never yields starves
//! it too. It is fed only while the bridge reports that bytes move, because a task might rest despite pending work.

use core::sync::atomic::{AtomicU32, Ordering};

use embassy_stm32::peripherals::IWDG;
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_time::Timer;

use crate::adapter::{Adapter, now};
use crate::board::Watchdog;
use crate::uart;

/// The timeout, by the watchdog's own clock, which may be off by half. The erase of a flash sector stalls the core for
/// 500 ms at worst.
const TIMEOUT_US: u32 = 2_000_000;

/// Period of the checks.
const ROUND_MS: u64 = 100;

/// Maximum number of rounds for a busy task. At 1200 baud a frame takes half a second.
const PATIENCE: u32 = 12;

/// Tasks that must make progress.
#[derive(Clone, Copy)]
pub(crate) enum Task {
    Receive,
    Transmit,
    Usb,
    PortToHost,
    PortFromHost,
    ControlToHost,
    ControlFromHost,
    Can,
    Time,
    Action,
}

/// Number of tasks.
const TASKS: usize = Task::Action as usize + 1;

/// Number of the current round.
static ROUND: AtomicU32 = AtomicU32::new(0);
/// The round of each task's last progress, or [`AT_REST`].
static HEARD: [AtomicU32; TASKS] = [const { AtomicU32::new(0) }; TASKS];
const AT_REST: u32 = u32::MAX;

/// The task is idle and waits for a signal, until the returned guard is dropped.
pub(crate) fn rest(task: Task) -> Resting {
    HEARD[task as usize].store(AT_REST, Ordering::Relaxed);
    Resting(task)
}

/// A task at rest.
#[must_use]
pub(crate) struct Resting(Task);

impl Drop for Resting {
    fn drop(&mut self) {
        progress(self.0);
    }
}

/// The task has made progress.
pub(crate) fn progress(task: Task) {
    HEARD[task as usize].store(ROUND.load(Ordering::Relaxed), Ordering::Relaxed);
}

/// Starts the watchdog, which runs on an oscillator of its own: a wait for a clock that never starts ends in a reset.
/// It can only be stopped by a reset. Call this once, and not before the boot loader, which does not feed it.
pub(crate) fn start() -> Watchdog {
    // SAFETY: no other code takes it.
    let mut watchdog = IndependentWatchdog::new(unsafe { IWDG::steal() }, TIMEOUT_US);
    watchdog.unleash();
    watchdog
}

/// Feeds the watchdog while all tasks make progress.
#[embassy_executor::task]
pub(crate) async fn feed(adapter: &'static Adapter, mut watchdog: Watchdog) {
    watchdog.pet();
    // Offset from the LED's period: both at once would delay the end of a frame for longer.
    Timer::after_millis(ROUND_MS / 4).await;
    loop {
        let round = ROUND.fetch_add(1, Ordering::Relaxed);
        let is_late = |heard: &AtomicU32| round.saturating_sub(heard.load(Ordering::Relaxed)) > PATIENCE;
        // `AT_REST` is later than every round.
        if !HEARD.iter().any(is_late) && !adapter.take(|bridge| bridge.is_stuck(now())) {
            watchdog.pet();
        }
        // The bridge requires regular reads of the UART.
        uart::wake();
        Timer::after_millis(ROUND_MS).await;
    }
}
