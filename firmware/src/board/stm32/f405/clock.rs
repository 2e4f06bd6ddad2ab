//! The clock tree: 168 MHz core, 42 MHz APB1, 84 MHz APB2, 48 MHz USB, from the crystal.

use embassy_stm32::Config;
use embassy_stm32::pac;
use embassy_stm32::rcc::{
    AHBPrescaler, APBPrescaler, Hse, HseMode, Pll, PllMul, PllPDiv, PllPreDiv, PllQDiv, PllSource, Sysclk, mux,
};
use embassy_stm32::time::Hertz;

use super::super::crystal::Crystal;
use super::super::sleep::hal_config;

/// The configuration of the chip with this crystal.
pub(super) fn config(crystal: Crystal) -> Config {
    // 336 MHz (RM0090 7.3.2).
    let (prediv, mul) = match crystal {
        Crystal::Mhz8 => (PllPreDiv::DIV4, PllMul::MUL168),
        Crystal::Mhz12 => (PllPreDiv::DIV6, PllMul::MUL168),
        Crystal::Mhz16 => (PllPreDiv::DIV8, PllMul::MUL168),
        Crystal::Mhz25 => (PllPreDiv::DIV25, PllMul::MUL336),
    };
    let mut config = hal_config();
    let rcc = &mut config.rcc;
    rcc.hse = Some(Hse {
        freq: Hertz::mhz(crystal.megahertz()),
        mode: HseMode::Oscillator,
    });
    rcc.pll_src = PllSource::HSE;
    rcc.pll = Some(Pll {
        prediv,
        mul,
        divp: Some(PllPDiv::DIV2),
        divq: Some(PllQDiv::DIV7),
        divr: None,
    });
    rcc.sys = Sysclk::PLL1_P;
    rcc.ahb_pre = AHBPrescaler::DIV1;
    rcc.apb1_pre = APBPrescaler::DIV4;
    rcc.apb2_pre = APBPrescaler::DIV2;
    rcc.mux.clk48sel = mux::Clk48sel::PLL1_Q;
    config
}

/// DEV_ID of DBGMCU_IDCODE, and the first REV_ID with a working prefetch, revision Z (RM0090 38.6.1). Revision A can
/// also be recognised by the DEV_ID of an STM32F2 (ES0182, "MCU device ID is incorrect").
const DEVICE: u16 = 0x413;
const FIRST_WITH_PREFETCH: u16 = 0x1001;

/// Enables the flash prefetch and caches (RM0090 3.5.2), which hide most of the five wait states at 168 MHz. On
/// revision A the prefetch stays off (ES0182).
pub(crate) fn accelerate_flash() {
    let id = pac::DBGMCU.idcode().read();
    let prefetches = id.dev_id() == DEVICE && id.rev_id() >= FIRST_WITH_PREFETCH;
    pac::FLASH.acr().modify(|w| {
        w.set_prften(prefetches);
        w.set_icen(true);
        w.set_dcen(true);
    });
}
