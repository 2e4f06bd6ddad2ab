//! TIM16, which captures edges of the crystal's clock (RM0440 31.8).

use embassy_stm32::pac;
use embassy_stm32::pac::timer::Tim1chCmp;

use super::super::rcc::enable_clocks;

pub(crate) const TIMER: Tim1chCmp = pac::TIM16;

/// The fixed divider of the crystal's clock.
pub(crate) const DIVIDER: u32 = 32;
/// HSE32EN of OR1 starts the divided clock (31.8.19).
const HSE32EN: u32 = 1;
/// TI1SEL of TISEL: the divided clock is the input (table 305).
const HSE_32: u8 = 0b0011;

/// Starts the timer's clock, and connects the crystal's.
pub(crate) fn connect() {
    enable_clocks(pac::RCC.apb2enr(), |w| w.set_tim16en(true));
    TIMER.or().write_value(HSE32EN);
    TIMER.tisel().write(|w| w.set_tisel(0, HSE_32));
}

/// Returns the timer to its reset state.
pub(crate) fn disconnect() {
    let rcc = pac::RCC;
    rcc.apb2rstr().modify(|w| w.set_tim16rst(true));
    rcc.apb2rstr().modify(|w| w.set_tim16rst(false));
    rcc.apb2enr().modify(|w| w.set_tim16en(false));
}
