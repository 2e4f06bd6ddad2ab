//! The clock tree: 160 MHz core and buses and 80 MHz CAN from the crystal, 48 MHz USB from HSI48.
//!
//! 160 MHz and not the 170 MHz that the chip can do: all bit rates of CAN and CAN FD divide 80 MHz, but 4 Mbit/s does
//! not divide 170 MHz or any part of it. USB's 48 MHz do not come out either, so they come from an oscillator of their
//! own, which the clock recovery system trims to the host's start-of-frame packets. CAN needs the crystal (CiA 601-3).

use embassy_stm32::Config;
use embassy_stm32::pac;
use embassy_stm32::rcc::{
    AHBPrescaler, APBPrescaler, Hse, HseMode, Hsi48Config, Pll, PllMul, PllPreDiv, PllQDiv, PllRDiv, PllSource, Sysclk,
    mux,
};
use embassy_stm32::time::Hertz;

/// The configuration of the chip.
pub(crate) fn config() -> Config {
    let mut config = Config::default();
    let rcc = &mut config.rcc;
    rcc.hse = Some(Hse {
        freq: Hertz(8_000_000),
        mode: HseMode::Oscillator,
    });
    rcc.pll = Some(Pll {
        source: PllSource::HSE,
        prediv: PllPreDiv::DIV2,
        mul: PllMul::MUL80,
        divp: None,
        divq: Some(PllQDiv::DIV4),
        divr: Some(PllRDiv::DIV2),
    });
    rcc.sys = Sysclk::PLL1_R;
    // Above 150 MHz (RM0440 6.1.5).
    rcc.boost = true;
    rcc.ahb_pre = AHBPrescaler::DIV1;
    rcc.apb1_pre = APBPrescaler::DIV1;
    rcc.apb2_pre = APBPrescaler::DIV1;
    rcc.hsi48 = Some(Hsi48Config { sync_from_usb: true });
    rcc.mux.clk48sel = mux::Clk48sel::HSI48;
    rcc.mux.fdcansel = mux::Fdcansel::PLL1_Q;
    config
}

/// Switches on the flash prefetch (RM0440 5.3.4), which hides most of the four wait states of 160 MHz. The caches are
/// on after a reset.
pub(crate) fn accelerate_flash() {
    pac::FLASH.acr().modify(|w| w.set_prften(true));
}
