//! The cause of the last reset.

use embassy_stm32::pac;

use crate::board::ChipReset;

/// Reads the cause of the last reset, and clears it for the next (RM0090 7.3.21).
pub(crate) fn take_reset() -> ChipReset {
    let cause = pac::RCC.csr().read();
    pac::RCC.csr().modify(|w| w.set_rmvf(true));
    if cause.porrstf() || cause.borrstf() {
        ChipReset::PowerOn
    } else if cause.wdgrstf() {
        ChipReset::Watchdog
    } else {
        ChipReset::Other
    }
}
