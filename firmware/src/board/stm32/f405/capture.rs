//! TIM11, which captures edges of the crystal's clock (RM0090 7.2.11).

use embassy_stm32::pac;
use embassy_stm32::pac::timer::Tim1ch;

use super::super::rcc::enable_clocks;

pub(crate) const TIMER: Tim1ch = pac::TIM11;

/// RTCPRE of RCC_CFGR, which divides the crystal's clock.
pub(crate) const DIVIDER: u32 = 30;
/// TI1_RMP of TIM11_OR: the divided clock is the input (19.5.11).
const HSE_RTC: u32 = 0b10;

/// Starts the timer's clock, and connects the crystal's.
pub(crate) fn connect() {
    enable_clocks(pac::RCC.apb2enr(), |w| w.set_tim11en(true));
    pac::RCC.cfgr().modify(|w| w.set_rtcpre(DIVIDER as u8));
    TIMER.or().write_value(HSE_RTC);
}

/// Returns the timer and the divider to their reset state.
pub(crate) fn disconnect() {
    let rcc = pac::RCC;
    rcc.apb2rstr().modify(|w| w.set_tim11rst(true));
    rcc.apb2rstr().modify(|w| w.set_tim11rst(false));
    rcc.apb2enr().modify(|w| w.set_tim11en(false));
    rcc.cfgr().modify(|w| w.set_rtcpre(0));
}
