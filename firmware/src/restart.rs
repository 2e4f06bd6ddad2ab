//! Restarts, and the state that survives them: fault counts and the next start.
//!
//! This state is in memory that the start-up code does not clear, behind a mark that distinguishes it from power-on
//! contents.

use core::sync::atomic::{AtomicU32, Ordering};

use cortex_m::peripheral::SCB;

use crate::fmt;

/// The counts below are valid.
const MARK: u32 = 0x71C4_E80B;

/// The boot loader must start instead of the firmware.
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

/// Panics, watchdog resets and hard faults since power-on, and the state at the last stop.
#[derive(Clone, Copy)]
pub(crate) struct Restarts {
    pub(crate) panics: u32,
    pub(crate) watchdog: u32,
    pub(crate) hard_faults: u32,
    /// True if a stream of motion was armed.
    pub(crate) while_armed: bool,
}

impl Restarts {
    /// Logs the restarts, if there were any.
    pub(crate) fn log(&self) {
        if self.panics > 0 || self.watchdog > 0 || self.hard_faults > 0 {
            warning!(
                "since power-on: {=u32} panics, {=u32} resets by the watchdog, {=u32} hard faults",
                self.panics,
                self.watchdog,
                self.hard_faults
            );
        }
        if self.while_armed {
            warning!("the last run ended during an armed stream: torque-off goes out");
        }
    }
}

/// Records a start and its cause.
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

/// Records for the next start that a stream of motion is armed, or is not.
pub(crate) fn armed(is: bool) {
    ARMED.store(if is { ARMED_MARK } else { 0 }, Ordering::Relaxed);
}

/// Records a panic for the next start.
pub(crate) fn panicked() {
    PANICS.fetch_add(1, Ordering::Relaxed);
}

/// Records a hard fault for the next start.
pub(crate) fn faulted() {
    HARD_FAULTS.fetch_add(1, Ordering::Relaxed);
}

/// Restarts the chip.
pub(crate) fn restart() -> ! {
    fmt::flush();
    SCB::sys_reset()
}

/// Starts the chip's boot loader after a reset, because it expects the chip's reset state.
pub(crate) fn restart_into_boot_loader() -> ! {
    NEXT.store(BOOT_LOADER, Ordering::Relaxed);
    restart()
}

/// Returns true if this start must enter the boot loader. The next one will not.
pub(crate) fn is_into_boot_loader() -> bool {
    NEXT.swap(0, Ordering::Relaxed) == BOOT_LOADER
}
