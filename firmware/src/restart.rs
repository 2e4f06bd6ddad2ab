//! Starting again, and what outlives it: counts of how often the firmware found itself broken, and what to start.
//!
//! They lie in memory that start-up does not clear, behind a mark that tells them from what memory holds at power-on.

use core::sync::atomic::{AtomicU32, Ordering};

use cortex_m::peripheral::SCB;

/// The counts below are counts.
const MARK: u32 = 0x71C4_E80B;

/// The boot loader is to start instead of the firmware.
const BOOT_LOADER: u32 = 0x5C6B_07E1;

/// A stream of motion is armed.
const ARMED_MARK: u32 = 0x5EA1_D0FF;

#[unsafe(link_section = ".uninit.restart")]
static ARMED: AtomicU32 = AtomicU32::new(0);
#[unsafe(link_section = ".uninit.restart")]
static MARKED: AtomicU32 = AtomicU32::new(0);
#[unsafe(link_section = ".uninit.restart")]
static PANICS: AtomicU32 = AtomicU32::new(0);
#[unsafe(link_section = ".uninit.restart")]
static WATCHDOG_RESETS: AtomicU32 = AtomicU32::new(0);
#[unsafe(link_section = ".uninit.restart")]
static HARD_FAULTS: AtomicU32 = AtomicU32::new(0);
#[unsafe(link_section = ".uninit.restart")]
static NEXT: AtomicU32 = AtomicU32::new(0);

/// Panics, resets by the watchdog and hard faults since power-on, and what the firmware was doing when it stopped.
#[derive(Clone, Copy)]
pub(crate) struct Restarts {
    pub(crate) panics: u32,
    pub(crate) watchdog: u32,
    pub(crate) hard_faults: u32,
    /// Whether a stream of motion was armed.
    pub(crate) while_armed: bool,
}

/// Takes note of a start, and whether the watchdog caused it.
pub(crate) fn started(by_watchdog: bool) -> Restarts {
    if MARKED.swap(MARK, Ordering::Relaxed) != MARK {
        PANICS.store(0, Ordering::Relaxed);
        WATCHDOG_RESETS.store(0, Ordering::Relaxed);
        HARD_FAULTS.store(0, Ordering::Relaxed);
    }
    WATCHDOG_RESETS.fetch_add(by_watchdog.into(), Ordering::Relaxed);
    Restarts {
        panics: PANICS.load(Ordering::Relaxed),
        watchdog: WATCHDOG_RESETS.load(Ordering::Relaxed),
        hard_faults: HARD_FAULTS.load(Ordering::Relaxed),
        while_armed: ARMED.swap(0, Ordering::Relaxed) == ARMED_MARK,
    }
}

/// Takes note of whether a stream of motion is armed, for the next start.
pub(crate) fn armed(is: bool) {
    ARMED.store(if is { ARMED_MARK } else { 0 }, Ordering::Relaxed);
}

/// Takes note of a panic, for the next start.
pub(crate) fn panicked() {
    PANICS.fetch_add(1, Ordering::Relaxed);
}

/// Takes note of a hard fault, for the next start.
pub(crate) fn faulted() {
    HARD_FAULTS.fetch_add(1, Ordering::Relaxed);
}

/// Starts again.
pub(crate) fn restart() -> ! {
    SCB::sys_reset()
}

/// Starts the chip's own boot loader, by way of a reset, for it wants the chip as a reset leaves it.
pub(crate) fn restart_into_boot_loader() -> ! {
    NEXT.store(BOOT_LOADER, Ordering::Relaxed);
    SCB::sys_reset()
}

/// Whether this start is to start the boot loader. The next one is not.
pub(crate) fn is_into_boot_loader() -> bool {
    NEXT.swap(0, Ordering::Relaxed) == BOOT_LOADER
}
