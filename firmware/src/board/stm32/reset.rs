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
