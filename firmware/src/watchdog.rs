//! The independent watchdog: resets the chip when a task makes no progress.
//!
//! A task with nothing to do rests: it waits for a signal, for as long as it takes, and says so with [`rest`].
//! Everything else that it waits for, such as the end of a DMA transfer, takes a time that is bounded. A task that is
//! not at rest must come to rest, or say now and then that it has done something, with [`progress`]. The watchdog is
//! fed while none owes that. It is fed by a task of its own, so one that never yields starves it too; and only while
//! the bridge says that bytes move, for a task might rest where there is something to do.

use core::sync::atomic::{AtomicU32, Ordering};

use embassy_stm32::peripherals::IWDG;
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_time::Timer;

use crate::adapter::{Adapter, now};
use crate::board::Watchdog;
use crate::uart;

/// How long it may go unfed, by its own clock, which may be off by half. The erasing of a flash sector stops the core
/// for 500 ms at worst.
const TIMEOUT_US: u32 = 2_000_000;

/// How often the tasks are looked at.
const ROUND_MS: u64 = 100;

/// How many rounds a task may be busy. At 1200 baud a frame takes half a second.
const PATIENCE: u32 = 12;

/// Those that must make progress.
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

/// How many there are.
const TASKS: usize = Task::Action as usize + 1;

/// Counts rounds.
static ROUND: AtomicU32 = AtomicU32::new(0);
/// The round in which each task was last heard of, or [`AT_REST`].
static HEARD: [AtomicU32; TASKS] = [const { AtomicU32::new(0) }; TASKS];
const AT_REST: u32 = u32::MAX;

/// The task has nothing to do and begins to wait for a signal, until what this returns is dropped.
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

/// The task has done something.
pub(crate) fn progress(task: Task) {
    HEARD[task as usize].store(ROUND.load(Ordering::Relaxed), Ordering::Relaxed);
}

/// Starts the watchdog, which runs on an oscillator of its own: whoever waits for a clock is restarted. Nothing stops it
/// but a reset. To be called once, and not before the boot loader, which does not feed it.
pub(crate) fn start() -> Watchdog {
    // SAFETY: nobody else takes it.
    let mut watchdog = IndependentWatchdog::new(unsafe { IWDG::steal() }, TIMEOUT_US);
    watchdog.unleash();
    watchdog
}

/// Feeds the watchdog while all tasks make progress.
#[embassy_executor::task]
pub(crate) async fn feed(adapter: &'static Adapter, mut watchdog: Watchdog) {
    watchdog.pet();
    // Out of step with the LED: both at once would hold up the end of a frame for longer.
    Timer::after_millis(ROUND_MS / 4).await;
    loop {
        let round = ROUND.fetch_add(1, Ordering::Relaxed);
        let is_late = |heard: &AtomicU32| round.saturating_sub(heard.load(Ordering::Relaxed)) > PATIENCE;
        // `AT_REST` is later than every round.
        if !HEARD.iter().any(is_late) && !adapter.take(|bridge| bridge.is_stuck(now())) {
            watchdog.pet();
        }
        // The bridge wants to see that somebody looks at the UART.
        uart::wake();
        Timer::after_millis(ROUND_MS).await;
    }
}
