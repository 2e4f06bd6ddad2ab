//! The restart of the chip, and the cause of the last one.

use embassy_rp::pac;
use embassy_rp::peripherals::WATCHDOG;

use super::Watchdog;
use crate::board::ChipReset;

/// The interrupts of the chip (2.3.2).
pub(crate) const INTERRUPTS: usize = 26;

/// The HAL's `init` resets the peripherals and starts the clocks from the ring oscillator.
pub(crate) fn reset_clocks() {}

/// Reads the cause of the last reset. The chip clears it at the next (2.12.7, 4.7.6).
pub(crate) fn take_reset() -> ChipReset {
    let by_watchdog = pac::WATCHDOG.reason().read();
    if Watchdog::has_reset() {
        ChipReset::Watchdog
    } else if !by_watchdog.timer() && !by_watchdog.force() && pac::VREG_AND_CHIP_RESET.chip_reset().read().had_por() {
        ChipReset::PowerOn
    } else {
        ChipReset::Other
    }
}

/// The chip's kind and revision: CHIP_ID (2.20.2).
pub(crate) fn chip_id() -> u32 {
    pac::SYSINFO.chip_id().read().0
}

/// Restarts the chip with all peripherals. A reset by the core's own register would leave these as they are.
pub(crate) fn reset() -> ! {
    // SAFETY: nothing else runs from here on.
    embassy_rp::watchdog::Watchdog::new(unsafe { WATCHDOG::steal() }).trigger_reset();
    loop {
        cortex_m::asm::nop();
    }
}
