//! The crystal, measured before the clock tree is configured: one image runs with each of [`CRYSTALS`].
//!
//! Until then the chip runs from the internal 16 MHz oscillator (HSI), and TIM11 counts its cycles between edges of the
//! crystal's divided clock (RM0090 7.2.11, 19.5.11).

use embassy_stm32::pac;
use embassy_stm32::pac::timer::vals::CcmrInputCcs;
use embassy_stm32::rcc::{PllMul, PllPreDiv};

use super::super::oscillator::{self, HSI_MEGAHERTZ, micros};
use super::super::{Led, Watchdog, enable_clocks};

/// A crystal, and the PLL settings for 336 MHz (RM0090 7.3.2).
pub(super) struct Crystal {
    pub(super) megahertz: u32,
    pub(super) divider: PllPreDiv,
    pub(super) multiplier: PllMul,
}

/// The supported crystals.
const CRYSTALS: [Crystal; 4] = [
    Crystal {
        megahertz: 8,
        divider: PllPreDiv::DIV4,
        multiplier: PllMul::MUL168,
    },
    Crystal {
        megahertz: 12,
        divider: PllPreDiv::DIV6,
        multiplier: PllMul::MUL168,
    },
    Crystal {
        megahertz: 16,
        divider: PllPreDiv::DIV8,
        multiplier: PllMul::MUL168,
    },
    Crystal {
        megahertz: 25,
        divider: PllPreDiv::DIV25,
        multiplier: PllMul::MUL336,
    },
];

/// Tolerance of a measurement, in percent: HSI is −8 % to +4.5 % off over all temperatures (DS8626, 5.3.9).
const TOLERANCE: u32 = 10;

/// RTCPRE of RCC_CFGR, which divides the crystal's clock for TIM11.
const DIVIDER: u8 = 30;
/// TIM11 captures every eighth edge.
const EDGES: u32 = 8;
/// IC1PSC of TIM11_CCMR1 for every eighth edge.
const EACH_EIGHTH: u8 = 3;
/// TI1_RMP of TIM11_OR: the divided clock is the input.
const HSE_RTC: u32 = 0b10;

/// The time between two captures is 10 to 30 µs.
const CAPTURE_US: u32 = 1_000;

/// Starts the crystal and measures it. Returns when one of [`CRYSTALS`] runs.
///
/// The core must run from HSI.
pub(super) fn start(watchdog: &mut Watchdog, led: &mut Led) -> &'static Crystal {
    enable_clocks(pac::RCC.apb1enr(), |w| w.set_tim5en(true));
    start_capturing();
    let crystal = oscillator::start(watchdog, led, measure);
    stop_capturing();
    crystal
}

/// Starts the edge capture of TIM11.
fn start_capturing() {
    let rcc = pac::RCC;
    enable_clocks(rcc.apb2enr(), |w| w.set_tim11en(true));
    rcc.cfgr().modify(|w| w.set_rtcpre(DIVIDER));
    let capture = pac::TIM11;
    capture.or().write_value(HSE_RTC);
    capture.arr().write(|w| w.set_arr(u16::MAX));
    capture.ccmr_input(0).write(|w| {
        w.set_ccs(0, CcmrInputCcs::TI4);
        w.set_icpsc(0, EACH_EIGHTH);
    });
    capture.ccer().write(|w| w.set_cce(0, true));
    capture.cr1().write(|w| w.set_cen(true));
}

/// Returns TIM11 and the divider to their reset state.
fn stop_capturing() {
    let rcc = pac::RCC;
    rcc.apb2rstr().modify(|w| w.set_tim11rst(true));
    rcc.apb2rstr().modify(|w| w.set_tim11rst(false));
    rcc.apb2enr().modify(|w| w.set_tim11en(false));
    rcc.cfgr().modify(|w| w.set_rtcpre(0));
}

/// The running crystal. `None` if it is none of [`CRYSTALS`], or has stopped.
fn measure() -> Option<&'static Crystal> {
    // Earlier captures are discarded.
    pac::TIM11.sr().write(|_| {});
    let start = capture()?;
    let cycles = u32::from(capture()?.wrapping_sub(start));
    let expected = HSI_MEGAHERTZ * EDGES * u32::from(DIVIDER);
    CRYSTALS
        .iter()
        .find(|crystal| (cycles * crystal.megahertz).abs_diff(expected) * 100 < expected * TOLERANCE)
}

/// The next capture of TIM11.
fn capture() -> Option<u16> {
    let start = micros();
    while !pac::TIM11.sr().read().ccif(0) {
        if micros().wrapping_sub(start) > CAPTURE_US {
            return None;
        }
    }
    // Reading clears the flag (RM0090 19.5.4).
    let captured = pac::TIM11.ccr(0).read().ccr();
    // After another capture in between, the time to the next one would be too short.
    (!pac::TIM11.sr().read().ccof(0)).then_some(captured)
}
