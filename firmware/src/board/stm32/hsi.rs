//! The internal oscillator, from which the core runs in its reset state.

use embassy_stm32::pac::RCC;
use embassy_stm32::pac::rcc::{regs, vals};

/// Runs the core from the internal oscillator, with that of the crystal and the PLL off. These are the reset values of
/// the registers of the clocks and the PLL.
pub(super) fn run_from_hsi(cfgr: regs::Cfgr, pllcfgr: regs::Pllcfgr) {
    RCC.cr().modify(|w| w.set_hsion(true));
    while !RCC.cr().read().hsirdy() {}
    RCC.cfgr().write_value(cfgr);
    while RCC.cfgr().read().sws() != vals::Sw::HSI {}
    RCC.cr().modify(|w| {
        w.set_hseon(false);
        w.set_csson(false);
        w.set_pllon(false);
    });
    while RCC.cr().read().pllrdy() {}
    RCC.pllcfgr().write_value(pllcfgr);
}
