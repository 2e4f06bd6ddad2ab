//! The clock tree: 168 MHz core, 42 MHz APB1, 84 MHz APB2, 48 MHz USB, from the crystal.

use embassy_stm32::Config;
use embassy_stm32::pac;
use embassy_stm32::rcc::{
    AHBPrescaler, APBPrescaler, Hse, HseMode, Pll, PllMul, PllPDiv, PllPreDiv, PllQDiv, PllSource, Sysclk, mux,
};
use embassy_stm32::time::Hertz;

/// The crystal, and what divides it to the PLL's 2 MHz.
const CRYSTAL: (Hertz, PllPreDiv) = if cfg!(feature = "crystal-12mhz") {
    (Hertz(12_000_000), PllPreDiv::DIV6)
} else {
    (Hertz(8_000_000), PllPreDiv::DIV4)
};

/// The configuration of the chip.
pub(crate) fn config() -> Config {
    let (freq, prediv) = CRYSTAL;
    let mut config = Config::default();
    let rcc = &mut config.rcc;
    rcc.hse = Some(Hse {
        freq,
        mode: HseMode::Oscillator,
    });
    rcc.pll_src = PllSource::HSE;
    rcc.pll = Some(Pll {
        prediv,
        mul: PllMul::MUL168,
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

/// Switches on the flash prefetch and caches (RM0090 3.5.2), which hide most of the five wait states of 168 MHz.
pub(crate) fn accelerate_flash() {
    pac::FLASH.acr().modify(|w| {
        w.set_prften(true);
        w.set_icen(true);
        w.set_dcen(true);
    });
}
