//! The reset state of clocks and peripherals.

use embassy_stm32::pac::rcc::regs;
use embassy_stm32::pac::{FLASH, RCC};

use super::super::hsi::run_from_hsi;

/// The interrupts of the chip (RM0090 table 61).
pub(crate) const INTERRUPTS: usize = 82;

/// The peripherals of each bus, but the core-coupled memory (RM0090 7.3.5 to 7.3.9).
const AHB1: u32 = 0x2260_11FF;
const AHB2: u32 = 0xF1;
const APB1: u32 = 0x36FE_C9FF;
const APB2: u32 = 0x0007_5933;
/// The enabled clock of the core-coupled memory, the reset value of AHB1ENR (RM0090 7.3.10).
const AHB1ENR: u32 = 1 << 20;
/// The reset value of PLLCFGR (RM0090 7.3.2).
const PLLCFGR: u32 = 0x2400_3010;
/// Clears all flags of CIR, and disables its interrupts (RM0090 7.3.4).
const CIR: u32 = 0x00BF_0000;

/// Puts clocks and peripherals into their reset state. The order is that of the HAL of ST for this chip, `HAL_RCC_DeInit`.
pub(crate) fn reset_clocks() {
    run_from_hsi(regs::Cfgr(0), regs::Pllcfgr(PLLCFGR));
    RCC.cir().write_value(regs::Cir(CIR));

    for on in [true, false] {
        let all = |bus: u32| if on { bus } else { 0 };
        RCC.ahb1rstr().write_value(regs::Ahb1rstr(all(AHB1)));
        RCC.ahb2rstr().write_value(regs::Ahb2rstr(all(AHB2)));
        RCC.apb1rstr().write_value(regs::Apb1rstr(all(APB1)));
        RCC.apb2rstr().write_value(regs::Apb2rstr(all(APB2)));
    }
    RCC.ahb1enr().write_value(regs::Ahb1enr(AHB1ENR));
    RCC.ahb2enr().write_value(regs::Ahb2enr(0));
    RCC.apb1enr().write_value(regs::Apb1enr(0));
    RCC.apb2enr().write_value(regs::Apb2enr(0));
    reset_flash();
}

/// Locks the flash, clears its errors, and empties its caches, which may have content from before an update. The core runs
/// from HSI, which needs no wait states.
fn reset_flash() {
    while FLASH.sr().read().bsy() {}
    FLASH.cr().modify(|w| w.set_lock(true));
    // The flags are cleared by ones.
    FLASH.sr().modify(|_| {});
    // Caches are emptied while they are off (RM0090 3.9.2).
    FLASH.acr().modify(|w| {
        w.set_prften(false);
        w.set_icen(false);
        w.set_dcen(false);
    });
    for on in [true, false] {
        FLASH.acr().modify(|w| {
            w.set_icrst(on);
            w.set_dcrst(on);
        });
    }
    FLASH
        .acr()
        .modify(|w| w.set_latency(embassy_stm32::pac::flash::vals::Latency::WS0));
}
