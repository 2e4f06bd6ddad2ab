//! The crystal, measured before the clock tree is configured: one image runs with each [`Crystal`].
//!
//! Until then the chip runs from the internal 16 MHz oscillator (HSI), and a timer counts its cycles between edges of the
//! crystal's divided clock (RM0090 7.2.11 and 19.5.11, RM0440 31.8).

use embassy_stm32::pac::timer::vals::CcmrInputCcs;

use super::capture::{self, DIVIDER, TIMER};
use super::oscillator::{self, HSI_MEGAHERTZ, micros};
use super::{Led, Watchdog};

/// A supported crystal, by its frequency in megahertz.
#[derive(Clone, Copy)]
pub(super) enum Crystal {
    Mhz8 = 8,
    Mhz12 = 12,
    Mhz16 = 16,
    Mhz25 = 25,
}

const ALL: [Crystal; 4] = [Crystal::Mhz8, Crystal::Mhz12, Crystal::Mhz16, Crystal::Mhz25];

impl Crystal {
    /// The frequency in megahertz.
    pub(super) const fn megahertz(self) -> u32 {
        self as u32
    }
}

/// Tolerance of a measurement, in percent: HSI is −8 % to +4.5 % off over all temperatures on the STM32F405 (DS8626,
/// 5.3.9), and less on the STM32G431 (DS12589, "HSI16 oscillator characteristics").
const TOLERANCE: u32 = 10;

/// The timer captures every eighth edge.
const EDGES: u32 = 8;
/// IC1PSC of CCMR1 for every eighth edge.
const EACH_EIGHTH: u8 = 3;

/// The time between two captures is 10 to 32 µs.
const CAPTURE_US: u32 = 1_000;

/// Starts the crystal and measures it. Returns when a supported one runs.
///
/// The core must run from HSI, and the timer of the firmware's clock must have its own clock.
pub(super) fn start(watchdog: &mut Watchdog, led: &mut Led) -> Crystal {
    capture::connect();
    TIMER.arr().write(|w| w.set_arr(u16::MAX));
    TIMER.ccmr_input(0).write(|w| {
        w.set_ccs(0, CcmrInputCcs::TI4);
        w.set_icpsc(0, EACH_EIGHTH);
    });
    TIMER.ccer().write(|w| w.set_cce(0, true));
    TIMER.cr1().write(|w| w.set_cen(true));
    let crystal = oscillator::start(watchdog, led, measure);
    capture::disconnect();
    crystal
}

/// The running crystal. `None` if it is not supported, or has stopped.
fn measure() -> Option<Crystal> {
    // Earlier captures are discarded.
    TIMER.sr().write(|_| {});
    let start = capture()?;
    let cycles = u32::from(capture()?.wrapping_sub(start));
    let expected = HSI_MEGAHERTZ * EDGES * DIVIDER;
    ALL.into_iter()
        .find(|crystal| (cycles * crystal.megahertz()).abs_diff(expected) * 100 < expected * TOLERANCE)
}

/// The timer's next capture.
fn capture() -> Option<u16> {
    let start = micros();
    while !TIMER.sr().read().ccif(0) {
        if micros().wrapping_sub(start) > CAPTURE_US {
            return None;
        }
    }
    // Reading clears the flag (RM0090 19.5.4).
    let captured = TIMER.ccr(0).read().ccr();
    // After another capture in between, the time to the next one would be too short.
    (!TIMER.sr().read().ccof(0)).then_some(captured)
}
