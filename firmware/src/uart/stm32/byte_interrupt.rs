//! The interrupt for each byte. It is off while no byte can be an event: between the length of a frame and its last
//! bytes a timer waits instead.

use armwire_bridge::LineCoding;
use embassy_stm32::interrupt::typelevel::Handler;
use portable_atomic::Ordering;

use super::super::state::{STATE, byte_at, wake};
use super::tail::tail;
use crate::board::{TimerInterrupt, take_byte_alarm, usart, wake_byte_interrupt_in};

/// Time before the end of a frame from which the interrupt is on, in microseconds. The timer's interrupt handler is
/// delayed by less.
const LEAD: u32 = 20;

/// The line uses this coding.
pub(super) fn set_coding(coding: LineCoding) {
    STATE
        .interrupt
        .byte_time
        .store(coding.micros(1) as u32, Ordering::Relaxed);
}

/// Enables or disables the interrupt. The timer does not change that.
pub(super) fn set(on: bool) {
    critical_section::with(|_| {
        STATE.interrupt.is_asleep.store(false, Ordering::Relaxed);
        usart::set_byte_interrupt(on);
    });
}

/// Disables the interrupt while so many bytes arrive, if that is long enough. Returns true if it did.
///
/// The UART's interrupt handler calls this, or another in a critical section.
// Inline: it is executed for each byte.
#[inline(always)]
pub(super) fn sleep(bytes: usize) -> bool {
    let time = (bytes as u32).saturating_mul(STATE.interrupt.byte_time.load(Ordering::Relaxed));
    let is_long = time >= 2 * LEAD;
    if is_long {
        usart::set_byte_interrupt(false);
        STATE.interrupt.is_asleep.store(true, Ordering::Relaxed);
        wake_byte_interrupt_in(time - LEAD);
    }
    is_long
}

/// Ends the sleep in time for the last bytes of a frame.
pub(crate) struct SleepHandler;

impl Handler<TimerInterrupt> for SleepHandler {
    unsafe fn on_interrupt() {
        if take_byte_alarm() {
            end_sleep();
        }
    }
}

/// Enables the interrupt. If the line has paused, the frame still lacks more bytes, and the sleep goes on.
fn end_sleep() {
    critical_section::with(|_| {
        if !STATE.interrupt.is_asleep.load(Ordering::Relaxed) {
            return;
        }
        let end = tail();
        if sleep(STATE.rx.ring(|ring| ring.quiet(end, byte_at))) {
            return;
        }
        set(true);
        // The timer was late: the bytes are passed on without a stamp.
        if STATE.rx.ring(|ring| ring.is_overdue(tail())) {
            wake();
        }
    });
}
