//! The clock: a 32-bit timer that counts microseconds, for the [timers](crate::board::timers).
//!
//! The HAL's driver uses 16 bits of any timer and counts its periods by interrupts, one every 33 ms. The erase of the
//! flash stalls the chip for longer, and that clock would lose time. This one tolerates half an hour without an
//! interrupt.
//!
//! It also starts the UART at a given time: see [`transmit_at`].

use core::sync::atomic::{AtomicU32, Ordering};

use armwire_bridge::Instant;
use embassy_stm32::interrupt::typelevel::Interrupt;
use embassy_stm32::pac::timer::vals::Urs;
use embassy_stm32::rcc;
use embassy_time_driver::TICK_HZ;

use super::{TIMER, TIMER_HZ, TimerInterrupt, TimerPeripheral, usart};

/// Number of counter bits below the half-turn.
const HALF_TURN: u32 = 31;
/// The compare channels: the middle of a turn, the next alarm, the start of the UART, and the interrupt for each of its
/// bytes.
const MIDDLE: usize = 0;
const ALARM: usize = 1;
const START: usize = 2;
const BYTES: usize = 3;

/// The half-turns of the counter. Written only by the interrupt handler. They may lag by almost one: see [`micros`].
static HALF_TURNS: AtomicU32 = AtomicU32::new(0);

/// Starts the clock at 0.
pub(super) fn start() {
    rcc::enable_and_reset::<TimerPeripheral>();
    TIMER.psc().write_value((TIMER_HZ / TICK_HZ - 1) as u16);
    TIMER.arr().write_value(u32::MAX);
    TIMER.ccr(MIDDLE).write_value(1 << HALF_TURN);
    // The prescaler takes effect at the next update, which is made here and does not count as a turn of the counter.
    TIMER.cr1().write(|w| w.set_urs(Urs::COUNTER_ONLY));
    TIMER.egr().write(|w| w.set_ug(true));
    TIMER.dier().write(|w| {
        w.set_uie(true);
        w.set_ccie(MIDDLE, true);
        w.set_ccie(BYTES, true);
    });
    TIMER.cr1().modify(|w| w.set_cen(true));
    // SAFETY: the handler uses only initialised state.
    unsafe { TimerInterrupt::enable() };
}

/// Starts the transmit DMA at `at`, less than a half-turn ahead, or at once if that has passed.
///
/// The interrupt handler starts it: no task would be as punctual.
pub(crate) fn transmit_at(at: Instant) {
    TIMER.ccr(START).write_value(at.as_micros() as u32);
    clear(START);
    set_start_interrupt(true);
    // The counter may have passed it in between.
    if micros() >= at.as_micros() {
        start_transmitting();
    }
}

/// Enables the UART's interrupt for each byte in some microseconds.
///
/// The UART's interrupt handler calls this, or another in a critical section.
pub(crate) fn wake_byte_interrupt_in(micros: u32) {
    TIMER.ccr(BYTES).write_value(TIMER.cnt().read().wrapping_add(micros));
}

/// Returns true if the time of [`wake_byte_interrupt_in`] has come since the last call.
pub(crate) fn take_byte_alarm() -> bool {
    let is_due = TIMER.sr().read().ccif(BYTES);
    if is_due {
        clear(BYTES);
    }
    is_due
}

/// Clears the flag of a compare channel.
fn clear(channel: usize) {
    TIMER.sr().write(|w| {
        // Writing 0 clears, writing 1 has no effect.
        w.0 = u32::MAX;
        w.set_ccif(channel, false);
    });
}

fn start_transmitting() {
    set_start_interrupt(false);
    usart::set_transmit_requests(true);
}

/// Enables the interrupt for the start of the UART.
fn set_start_interrupt(on: bool) {
    critical_section::with(|_| TIMER.dier().modify(|w| w.set_ccie(START, on)));
}

/// The time in microseconds.
// One copy, not one for each call.
#[inline(never)]
pub(in crate::board) fn micros() -> u64 {
    // This order tolerates a half-turn that ends in between. An even number belongs to the lower half of the counter.
    // If the counter is in the other half, the handler has not run yet, and the previous half-turn still counts.
    let half_turns = HALF_TURNS.load(Ordering::Acquire);
    let count = TIMER.cnt().read();
    (u64::from(half_turns) << HALF_TURN) + u64::from(count ^ (half_turns & 1) << HALF_TURN)
}

/// Sets the alarm of the next timer. Returns false if its time has come.
pub(in crate::board) fn set_next_alarm(now: u64, at: u64) -> bool {
    // A later timer is checked again when the half-turn ends.
    let is_near = at - now < 1 << HALF_TURN;
    TIMER.ccr(ALARM).write_value(at as u32);
    TIMER.dier().modify(|w| w.set_ccie(ALARM, is_near));
    // The counter may have passed it in between.
    !is_near || micros() < at
}

/// Counts half-turns, and starts the UART if its time has come. Returns true if a timer may have expired. The interrupt
/// handler calls this.
pub(in crate::board) fn take_alarm() -> bool {
    let flags = TIMER.sr().read();
    TIMER.sr().write(|w| {
        // Writing 0 clears, writing 1 has no effect.
        w.0 = !flags.0;
        // It may have come after its own handler has looked.
        w.set_ccif(BYTES, true);
    });
    let ended = u32::from(flags.uif()) + u32::from(flags.ccif(MIDDLE));
    HALF_TURNS.store(
        HALF_TURNS.load(Ordering::Relaxed).wrapping_add(ended),
        Ordering::Release,
    );
    if flags.ccif(START) && TIMER.dier().read().ccie(START) {
        start_transmitting();
    }
    flags.ccif(ALARM) || ended > 0
}
