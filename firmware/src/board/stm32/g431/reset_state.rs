//! The reset state of clocks and peripherals.

use embassy_stm32::pac::rcc::regs;
use embassy_stm32::pac::{FLASH, RCC};

use super::super::hsi::run_from_hsi;

/// The interrupts of the chip (RM0440 table 97).
pub(crate) const INTERRUPTS: usize = 102;

/// The peripherals of each bus, but the flash, from which the core runs (RM0440 7.4.8 to 7.4.13).
const AHB1: u32 = 0x101F;
const AHB2: u32 = 0x050F_607F;
const APB1_1: u32 = 0xD2FE_C13F;
const APB1_2: u32 = 0x103;
const APB2: u32 = 0x0437_F801;
/// The enabled clock of the flash, the reset value of AHB1ENR (RM0440 7.4.14).
const AHB1ENR: u32 = 1 << 8;
/// The enabled clock of the bus of the RTC, the reset value of APB1ENR1 (RM0440 7.4.17).
const APB1ENR1: u32 = 1 << 10;
/// The reset value of PLLCFGR (RM0440 7.4.4).
const PLLCFGR: u32 = 0x1000;
/// The reset value of CFGR: HSI16 (RM0440 7.4.3).
const CFGR: u32 = 0b0101;
/// Clears all flags of the clocks (RM0440 7.4.7).
const CICR: u32 = 0x73B;

/// Puts clocks and peripherals into their reset state. The order is that of the HAL of ST for this chip, `HAL_RCC_DeInit`.
pub(crate) fn reset_clocks() {
    run_from_hsi(regs::Cfgr(CFGR), regs::Pllcfgr(PLLCFGR));
    RCC.ccipr().write_value(regs::Ccipr(0));
    RCC.cier().write_value(regs::Cier(0));
    RCC.cicr().write_value(regs::Cicr(CICR));

    for on in [true, false] {
        let all = |bus: u32| if on { bus } else { 0 };
        RCC.ahb1rstr().write_value(regs::Ahb1rstr(all(AHB1)));
        RCC.ahb2rstr().write_value(regs::Ahb2rstr(all(AHB2)));
        RCC.apb1rstr1().write_value(regs::Apb1rstr1(all(APB1_1)));
        RCC.apb1rstr2().write_value(regs::Apb1rstr2(all(APB1_2)));
        RCC.apb2rstr().write_value(regs::Apb2rstr(all(APB2)));
    }
    RCC.ahb1enr().write_value(regs::Ahb1enr(AHB1ENR));
    RCC.ahb2enr().write_value(regs::Ahb2enr(0));
    RCC.apb1enr1().write_value(regs::Apb1enr1(APB1ENR1));
    RCC.apb1enr2().write_value(regs::Apb1enr2(0));
    RCC.apb2enr().write_value(regs::Apb2enr(0));
    reset_flash();
}

/// Locks the flash, and clears its errors. The HAL empties the caches.
fn reset_flash() {
    while FLASH.sr().read().bsy() {}
    FLASH.cr().modify(|w| w.set_lock(true));
    // The flags are cleared by ones.
    FLASH.sr().modify(|_| {});
}
