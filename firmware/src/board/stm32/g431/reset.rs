//! The cause of the last reset.

use embassy_stm32::pac;

use crate::board::ChipReset;

/// Reads the cause of the last reset, and clears it for the next (RM0440 7.4, RCC_CSR).
pub(crate) fn take_reset() -> ChipReset {
    let cause = pac::RCC.csr().read();
    pac::RCC.csr().modify(|w| w.set_rmvf(true));
    if cause.borrstf() {
        ChipReset::PowerOn
    } else if cause.iwdgrstf() {
        ChipReset::Watchdog
    } else {
        ChipReset::Other
    }
}
