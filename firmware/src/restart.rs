//! Counts that outlive a reset: how often the firmware found itself broken and started again.
//!
//! They lie in memory that start-up does not clear, behind a mark that tells them from what memory holds at power-on.

use core::sync::atomic::{AtomicU32, Ordering};

/// The counts below are counts.
const MARK: u32 = 0xA23D_914E;

#[unsafe(link_section = ".uninit.restart")]
static MARKED: AtomicU32 = AtomicU32::new(0);
#[unsafe(link_section = ".uninit.restart")]
static PANICS: AtomicU32 = AtomicU32::new(0);
#[unsafe(link_section = ".uninit.restart")]
static WATCHDOG_RESETS: AtomicU32 = AtomicU32::new(0);

/// Panics and resets by the watchdog since power-on.
#[derive(Clone, Copy)]
pub(crate) struct Restarts {
    pub(crate) panics: u32,
    pub(crate) watchdog: u32,
}

/// Takes note of a start, and whether the watchdog caused it.
pub(crate) fn started(by_watchdog: bool) -> Restarts {
    if MARKED.swap(MARK, Ordering::Relaxed) != MARK {
        PANICS.store(0, Ordering::Relaxed);
        WATCHDOG_RESETS.store(0, Ordering::Relaxed);
    }
    WATCHDOG_RESETS.fetch_add(by_watchdog.into(), Ordering::Relaxed);
    Restarts {
        panics: PANICS.load(Ordering::Relaxed),
        watchdog: WATCHDOG_RESETS.load(Ordering::Relaxed),
    }
}

/// Takes note of a panic, for the next start.
pub(crate) fn panicked() {
    PANICS.fetch_add(1, Ordering::Relaxed);
}
