//! The clock tree: 160 MHz core and buses and 80 MHz CAN from the crystal, 48 MHz USB from HSI48.
//!
//! The core runs at 160 MHz instead of the possible 170 MHz: 80 MHz is divisible by all bit rates of CAN and CAN FD,
//! but no fraction of 170 MHz is divisible by 4 Mbit/s. 48 MHz for USB are not available from the PLL either; they come
//! from HSI48, which the clock recovery system trims to the host's start-of-frame packets. CAN needs the crystal (CiA
//! 601-3).

use cortex_m::asm::delay;
use embassy_stm32::Peri;
use embassy_stm32::pac;
use embassy_stm32::pac::flash::vals::Latency;
use embassy_stm32::peripherals::RCC;
use embassy_stm32::rcc::{
    self, AHBPrescaler, APBPrescaler, Config, Hse, HseMode, Hsi48Config, Pll, PllMul, PllPreDiv, PllQDiv, PllRDiv,
    PllSource, Sysclk, mux,
};
use embassy_stm32::time::Hertz;

use super::super::crystal::{self, Crystal};
use super::super::rcc::enable_clocks;
use super::super::{Led, Watchdog};

/// R1MODE of PWR_CR5: boost mode is on while it is clear (RM0440 6.4.22).
const R1MODE: u32 = 1 << 8;

/// Cycles of the core at half of its final clock: 2 µs, at least 1 µs (RM0440 6.1.5, 7.2.7).
const HALF_SPEED_CYCLES: u32 = 160;

/// Starts the clocks of a chip that runs on its internal oscillator. Returns when the crystal runs.
///
/// The HAL's chip description, stm32-metapac 21, has R1MODE at the unused bit 0 of PWR_CR5: the HAL does not enable
/// boost mode. Its `init` resets PWR before it starts the clocks: boost mode must be enabled between the two.
pub(crate) fn start(rcc: &mut Peri<'static, RCC>, watchdog: &mut Watchdog, led: &mut Led) -> Crystal {
    enable_clocks(pac::RCC.apb1enr1(), |w| w.set_tim2en(true));
    let crystal = crystal::start(watchdog, led);
    pac::PWR.cr5().modify(|w| w.0 &= !R1MODE);
    rcc::reinit(config(crystal), rcc);
    leave_half_speed();
    accelerate_flash();
    crystal
}

/// Doubles the clocks of the core and the buses. A switch from 16 MHz to more than 80 MHz requires a step at half of the
/// new clock (RM0440 6.1.5, 7.2.7).
fn leave_half_speed() {
    let access = pac::FLASH.acr();
    access.modify(|w| w.set_latency(Latency::WS4));
    while access.read().latency() != Latency::WS4 {}
    delay(HALF_SPEED_CYCLES);
    pac::RCC.cfgr().modify(|w| w.set_hpre(AHBPrescaler::DIV1));
}

/// The configuration of the clocks until [`leave_half_speed`]. The HAL, which makes only one step, then knows half of
/// the buses' clocks. USART2 therefore has the system clock, and the timer of the firmware's clock its own constant.
fn config(crystal: Crystal) -> Config {
    // 320 MHz (RM0440 7.4.4).
    let (prediv, mul) = match crystal {
        Crystal::Mhz8 => (PllPreDiv::DIV2, PllMul::MUL80),
        Crystal::Mhz12 => (PllPreDiv::DIV3, PllMul::MUL80),
        Crystal::Mhz16 => (PllPreDiv::DIV4, PllMul::MUL80),
        Crystal::Mhz25 => (PllPreDiv::DIV5, PllMul::MUL64),
    };
    let mut rcc = Config::default();
    rcc.hse = Some(Hse {
        freq: Hertz::mhz(crystal.megahertz()),
        mode: HseMode::Oscillator,
    });
    rcc.pll = Some(Pll {
        source: PllSource::HSE,
        prediv,
        mul,
        divp: None,
        divq: Some(PllQDiv::DIV4),
        divr: Some(PllRDiv::DIV2),
    });
    rcc.sys = Sysclk::PLL1_R;
    // Above 150 MHz (RM0440 6.1.5). The HAL only sets the wait states of boost mode.
    rcc.boost = true;
    rcc.ahb_pre = AHBPrescaler::DIV2;
    rcc.apb1_pre = APBPrescaler::DIV1;
    rcc.apb2_pre = APBPrescaler::DIV1;
    rcc.hsi48 = Some(Hsi48Config { sync_from_usb: true });
    rcc.mux.clk48sel = mux::Clk48sel::HSI48;
    rcc.mux.usart2sel = mux::Uartsel::SYS;
    rcc.mux.fdcansel = mux::Fdcansel::PLL1_Q;
    rcc
}

/// Enables the flash prefetch (RM0440 5.3.4), which hides most of the four wait states at 160 MHz. The caches are
/// enabled after a reset.
fn accelerate_flash() {
    pac::FLASH.acr().modify(|w| w.set_prften(true));
}
