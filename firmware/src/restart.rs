//! Restarts, and the state that survives them: the record of starts and the next start.
//!
//! This state is in memory that the start-up code does not clear.

use armwire_bridge::Start;
use armwire_bridge::start::{Cause, StartLog};
use portable_atomic::{AtomicU32, Ordering};

use crate::board::{self, ChipReset};
use crate::fmt;

/// The boot loader must start instead of the firmware.
const BOOT_LOADER: u32 = 0x5C6B_07E1;

/// A stream of motion is armed.
const ARMED_MARK: u32 = 0x5EA1_D0FF;

/// The run ended in a panic, or in a hard fault.
const PANICKED: u32 = 0x71C4_E80B;
const FAULTED: u32 = 0x0FA1_17ED;

#[unsafe(link_section = ".uninit.restart")]
static ARMED: AtomicU32 = AtomicU32::new(0);
#[unsafe(link_section = ".uninit.restart")]
static ENDED: AtomicU32 = AtomicU32::new(0);
#[unsafe(link_section = ".uninit.restart")]
static NEXT: AtomicU32 = AtomicU32::new(0);
#[unsafe(link_section = ".uninit.restart")]
static STARTS: [AtomicU32; StartLog::WORDS] = [const { AtomicU32::new(0) }; StartLog::WORDS];

/// Begins a start after this reset. Call this once.
pub(crate) fn begin(reset: ChipReset) -> StartLog {
    let cause = match (reset, ENDED.swap(0, Ordering::Relaxed)) {
        (ChipReset::PowerOn, _) => Cause::PowerOn,
        (_, PANICKED) => Cause::Panic,
        (_, FAULTED) => Cause::HardFault,
        (ChipReset::Watchdog, _) => Cause::Watchdog,
        (ChipReset::Other, _) => Cause::Other,
    };
    let starts = StartLog::begin(STARTS.each_ref().map(|word| word.load(Ordering::Relaxed)), cause);
    keep(starts.to_words());
    starts
}

/// Stores the record of starts.
pub(crate) fn keep(words: [u32; StartLog::WORDS]) {
    for (kept, word) in STARTS.iter().zip(words) {
        kept.store(word, Ordering::Relaxed);
    }
}

/// Logs how earlier runs ended, if they crashed.
pub(crate) fn log(start: &Start) {
    if start.panics > 0 || start.watchdog_resets > 0 || start.hard_faults > 0 {
        warning!(
            "since power-on: {=u32} panics, {=u32} resets by the watchdog, {=u32} hard faults",
            start.panics,
            start.watchdog_resets,
            start.hard_faults
        );
    }
    if start.was_armed {
        warning!("the last run ended during an armed stream: torque-off goes out");
    }
}

/// Records for the next start that a stream of motion is armed, or is not.
pub(crate) fn armed(is: bool) {
    ARMED.store(if is { ARMED_MARK } else { 0 }, Ordering::Relaxed);
}

/// Returns true if a stream of motion was armed at the last stop. The mark stays until torque-off is out: this start may
/// crash, too.
pub(crate) fn was_armed() -> bool {
    ARMED.load(Ordering::Relaxed) == ARMED_MARK
}

/// Records a panic for the next start.
pub(crate) fn panicked() {
    ENDED.store(PANICKED, Ordering::Relaxed);
}

/// Records a hard fault for the next start.
pub(crate) fn faulted() {
    ENDED.store(FAULTED, Ordering::Relaxed);
}

/// Restarts the chip.
pub(crate) fn restart() -> ! {
    fmt::flush();
    board::reset()
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
