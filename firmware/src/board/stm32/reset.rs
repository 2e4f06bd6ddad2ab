//! The restart of the chip, and its identity.

use cortex_m::peripheral::SCB;

/// Restarts the chip.
pub(crate) fn reset() -> ! {
    SCB::sys_reset()
}

/// The chip's 96-bit unique id in hexadecimal: the adapter's serial number.
pub(crate) fn serial_number() -> &'static str {
    embassy_stm32::uid::uid_hex()
}

/// The chip's kind and revision: DBGMCU_IDCODE (RM0090 38.6.1, RM0440 47.6.1).
pub(crate) fn chip_id() -> u32 {
    embassy_stm32::pac::DBGMCU.idcode().read().0
}
