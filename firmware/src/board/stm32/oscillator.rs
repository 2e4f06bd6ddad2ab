//! The crystal oscillator, started with a timeout before the clock tree is configured. Until then the chip runs from
//! the internal 16 MHz oscillator (HSI), and the clock's timer counts microseconds.
//!
//! If no crystal starts, or only one with an unsupported frequency, the LED flashes three times every 2 s, and the
//! crystal is restarted each time.

use embassy_stm32::pac;

use super::{Led, TIMER, Watchdog};

/// The internal oscillator.
pub(super) const HSI_MEGAHERTZ: u32 = 16;

/// Time for a crystal to start before it is restarted, in microseconds.
const RETRY_US: u32 = 2_000_000;
/// Polling period, in cycles of HSI: 1 ms.
const POLL_CYCLES: u32 = HSI_MEGAHERTZ * 1_000;
/// Time of the first LED flash after the crystal's start, in microseconds: crystals need a few milliseconds.
const FIRST_FLASH_US: u32 = 200_000;
/// Period and duration of the LED flashes in microseconds, and their number.
const FLASH_US: (u32, u32) = (300_000, 100_000);
const FLASHES: u32 = 3;

/// Starts the crystal. Returns the result of `measure` once the crystal runs and `measure` recognises it.
///
/// The core must run from HSI, and the timer must have its clock.
pub(super) fn start<T>(watchdog: &mut Watchdog, led: &mut Led, measure: impl Fn() -> Option<T>) -> T {
    start_timer();
    let crystal = loop {
        if let Some(crystal) = attempt(watchdog, led, &measure) {
            break crystal;
        }
        warning!("the crystal does not run, or has an unsupported frequency");
    };
    led.set(false);
    crystal
}

/// Starts the crystal, with a timeout.
fn attempt<T>(watchdog: &mut Watchdog, led: &mut Led, measure: impl Fn() -> Option<T>) -> Option<T> {
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
        led.set(is_flash(elapsed));
        cortex_m::asm::delay(POLL_CYCLES);
    }
}

/// Returns true if the LED is on at this time after the crystal's start.
fn is_flash(elapsed: u32) -> bool {
    let (period, on) = FLASH_US;
    elapsed
        .checked_sub(FIRST_FLASH_US)
        .is_some_and(|elapsed| elapsed < FLASHES * period && elapsed % period < on)
}

/// Starts the timer at one count per microsecond. The firmware's clock resets it.
fn start_timer() {
    TIMER.psc().write_value(HSI_MEGAHERTZ as u16 - 1);
    // The prescaler takes effect at the next update.
    TIMER.egr().write(|w| w.set_ug(true));
    TIMER.cr1().write(|w| w.set_cen(true));
}

/// Microseconds since the first start of the crystal.
pub(super) fn micros() -> u32 {
    TIMER.cnt().read()
}
