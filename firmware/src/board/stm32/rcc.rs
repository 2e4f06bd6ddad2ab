//! The clocks of peripherals.

use embassy_stm32::pac::common::{RW, Reg};

/// Enables clocks of peripherals in a register of RCC. Returns when they run.
///
/// An access within two cycles of the bus after the write may be lost (ES0182, "Delay after an RCC peripheral clock
/// enabling"; RM0440, "Peripheral clock enable register"): the pin to the arm would be driven low. The read takes longer.
pub(super) fn enable_clocks<T: Copy>(register: Reg<T, RW>, enable: impl FnOnce(&mut T)) {
    register.modify(enable);
    register.read();
}
