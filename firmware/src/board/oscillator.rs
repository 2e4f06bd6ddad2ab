//! The crystal's oscillator: started with a time-out before the clock tree is set up. Until then everything runs from the
//! internal oscillator of 16 MHz (HSI), and the timer of the clock counts microseconds.
//!
//! Without a crystal that runs, or with one of another frequency than the board can do with, the LED flashes three times
//! every 2 s, and each time the crystal is started anew.

use embassy_stm32::pac;
use embassy_stm32::pac::gpio::vals::Moder;

use super::{LED, TIMER, Watchdog};

/// The internal oscillator.
pub(super) const HSI_MEGAHERTZ: u32 = 16;

/// How long a crystal has to start until it is started anew, in microseconds.
const RETRY_US: u32 = 2_000_000;
/// How long nobody looks whether it has started, in cycles of HSI: 1 ms.
const LOOK_CYCLES: u32 = HSI_MEGAHERTZ * 1_000;
/// When the LED flashes first, in microseconds after the crystal was started: crystals need a few milliseconds.
const PATIENCE_US: u32 = 200_000;
/// From one flash to the next, how long it is on, and how many there are.
const FLASH_US: (u32, u32) = (300_000, 100_000);
const FLASHES: u32 = 3;

/// Starts the crystal. Returns when it runs and `measure` knows it, with what that makes of it.
///
/// The core must run from HSI, and the timer and the LED's port must have their clocks.
pub(super) fn start<T>(watchdog: &mut Watchdog, measure: impl Fn() -> Option<T>) -> T {
    let (port, pin) = LED;
    port.moder().modify(|w| w.set_moder(pin, Moder::OUTPUT));
    start_timer();
    let crystal = loop {
        if let Some(crystal) = attempt(watchdog, &measure) {
            break crystal;
        }
    };
    set_led(false);
    crystal
}

/// Starts the crystal, and gives up after a while.
fn attempt<T>(watchdog: &mut Watchdog, measure: impl Fn() -> Option<T>) -> Option<T> {
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

/// Lets the timer count microseconds. The clock of the firmware resets it.
fn start_timer() {
    TIMER.psc().write_value(HSI_MEGAHERTZ as u16 - 1);
    // The prescaler counts from the next update on.
    TIMER.egr().write(|w| w.set_ug(true));
    TIMER.cr1().write(|w| w.set_cen(true));
}

/// Microseconds since the crystal was started first.
pub(super) fn micros() -> u32 {
    TIMER.cnt().read()
}
