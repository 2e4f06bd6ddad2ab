//! The crystal: started with a time-out and measured before the clock tree is set up, so that one image runs with each of
//! [`CRYSTALS`].
//!
//! Until then everything runs from the internal oscillator of 16 MHz (HSI): TIM5 counts microseconds, and TIM11 counts
//! cycles of HSI between edges of the crystal's clock, divided (RM0090 7.2.11, 19.5.11).
//!
//! Without a crystal that runs, or with one of another frequency, the LED flashes three times every 2 s, and each time the
//! crystal is started anew.

use embassy_stm32::pac;
use embassy_stm32::pac::gpio::vals::Moder;
use embassy_stm32::pac::timer::vals::CcmrInputCcs;
use embassy_stm32::rcc::{PllMul, PllPreDiv};

use super::super::Watchdog;
use super::TIMER;

/// A crystal, and what the PLL makes 336 MHz of it with (RM0090 7.3.2).
pub(super) struct Crystal {
    pub(super) megahertz: u32,
    pub(super) divider: PllPreDiv,
    pub(super) multiplier: PllMul,
}

/// The crystals that boards have.
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

/// The internal oscillator.
const HSI_MEGAHERTZ: u32 = 16;
/// How far off a measurement may be, in percent: HSI is −8 % to +4.5 % off over all temperatures (DS8626, 5.3.9).
const TOLERANCE: u32 = 10;

/// RTCPRE of RCC_CFGR, which divides the crystal's clock for TIM11.
const DIVIDER: u8 = 30;
/// TIM11 captures each eighth edge.
const EDGES: u32 = 8;
/// IC1PSC of TIM11_CCMR1 for that.
const EACH_EIGHTH: u8 = 3;
/// TI1_RMP of TIM11_OR: the divided clock is the input.
const HSE_RTC: u32 = 0b10;

/// How long a crystal has to start until it is started anew, in microseconds.
const RETRY_US: u32 = 2_000_000;
/// How long nobody looks whether it has started, in cycles of HSI: 1 ms.
const LOOK_CYCLES: u32 = HSI_MEGAHERTZ * 1_000;
/// The time between two captures is 10 to 30 µs.
const CAPTURE_US: u32 = 1_000;
/// When the LED flashes first, in microseconds after the crystal was started: crystals need a few milliseconds.
const PATIENCE_US: u32 = 200_000;
/// From one flash to the next, how long it is on, and how many there are.
const FLASH_US: (u32, u32) = (300_000, 100_000);
const FLASHES: u32 = 3;

/// The LED's pin, PB2, and its port's bit in RCC_AHB1ENR is on.
const LED: (pac::gpio::Gpio, usize) = (pac::GPIOB, 2);

/// Starts the crystal and measures it. Returns when one of [`CRYSTALS`] runs.
///
/// The core must run from HSI, and the LED's port must have its clock.
pub(super) fn start(watchdog: &mut Watchdog) -> &'static Crystal {
    let (port, pin) = LED;
    port.moder().modify(|w| w.set_moder(pin, Moder::OUTPUT));
    start_timers();
    let crystal = loop {
        if let Some(crystal) = attempt(watchdog) {
            break crystal;
        }
    };
    set_led(false);
    stop_capturing();
    crystal
}

/// Starts the crystal, and gives up after a while.
fn attempt(watchdog: &mut Watchdog) -> Option<&'static Crystal> {
    let control = pac::RCC.cr();
    control.modify(|w| w.set_hseon(false));
    control.modify(|w| w.set_hseon(true));
    let start = micros();
    loop {
        watchdog.pet();
        if control.read().hserdy()
            && let Some(crystal) = measure()
        {
            return Some(crystal);
        }
        let elapsed = micros().wrapping_sub(start);
        if elapsed >= RETRY_US {
            return None;
        }
        set_led(is_flash(elapsed));
        cortex_m::asm::delay(LOOK_CYCLES);
    }
}

/// Whether the LED is on so long after the crystal was started.
fn is_flash(elapsed: u32) -> bool {
    let (period, on) = FLASH_US;
    elapsed
        .checked_sub(PATIENCE_US)
        .is_some_and(|elapsed| elapsed < FLASHES * period && elapsed % period < on)
}

fn set_led(on: bool) {
    let (port, pin) = LED;
    port.bsrr().write(|w| match on {
        true => w.set_bs(pin, true),
        false => w.set_br(pin, true),
    });
}

/// Lets TIM5 count microseconds and TIM11 capture edges.
fn start_timers() {
    let rcc = pac::RCC;
    rcc.apb1enr().modify(|w| w.set_tim5en(true));
    rcc.apb2enr().modify(|w| w.set_tim11en(true));
    // A clock is there two cycles after it was switched on (ES0182, "Delay after an RCC peripheral clock enabling").
    rcc.apb2enr().read();

    TIMER.psc().write_value(HSI_MEGAHERTZ as u16 - 1);
    // The prescaler counts from the next update on.
    TIMER.egr().write(|w| w.set_ug(true));
    TIMER.cr1().write(|w| w.set_cen(true));

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

/// Leaves TIM11 and the divider as a reset does. The clock of the firmware resets TIM5.
fn stop_capturing() {
    let rcc = pac::RCC;
    rcc.apb2rstr().modify(|w| w.set_tim11rst(true));
    rcc.apb2rstr().modify(|w| w.set_tim11rst(false));
    rcc.apb2enr().modify(|w| w.set_tim11en(false));
    rcc.cfgr().modify(|w| w.set_rtcpre(0));
}

fn micros() -> u32 {
    TIMER.cnt().read()
}

/// Which crystal runs. `None` if it is none of [`CRYSTALS`], or stands still.
fn measure() -> Option<&'static Crystal> {
    // What was captured before is of no use.
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
    // Reading it clears the flag (RM0090 19.5.4).
    let captured = pac::TIM11.ccr(0).read().ccr();
    // Another one that came meanwhile makes the time to the next one too short.
    (!pac::TIM11.sr().read().ccof(0)).then_some(captured)
}
