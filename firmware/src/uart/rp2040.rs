//! The receive path of the RP2040. The registers are in the board's [`usart`].
//!
//! # Time stamps
//!
//! The DMA writes a stamp beside each byte as it arrives. No interrupt is involved: a stamp is exact even if the flash
//! is being written. The interrupt handler of a byte only looks for the bytes that the bridge waits for.
//!
//! The UART has no interrupt for an idle line while the DMA empties its FIFO. An alarm compares the last stamp with the
//! clock.

use core::marker::PhantomData;

use armwire_bridge::{Duration, Instant, LineCoding, RxRing};
use portable_atomic::{AtomicBool, AtomicU32, AtomicUsize, Ordering};

use super::{BYTES, ERRORS, RING_OVERRUN, SIZE, byte_at, wake, with_ring};
use crate::adapter::now;
use crate::board::hal::interrupt::typelevel::{Handler, Interrupt};
use crate::board::usart;
use crate::board::{IdleInterrupt, RxInterrupt, UartInterrupt, clear_idle_alarm, set_idle_alarm};

/// The UART, for its line coding.
pub(crate) struct Uart;
/// The receive DMA.
pub(crate) struct Dma;
/// The receive DMA in operation.
pub(super) struct Transfer<'a>(PhantomData<&'a mut Dma>);

/// A stamp for each byte of the ring: the lower half of the clock.
#[repr(align(4096))]
struct Stamps([AtomicU32; SIZE]);

/// The alignment is that of a ring of the DMA.
const _: () = assert!(align_of::<Stamps>() == 4 * SIZE);

static STAMPS: Stamps = Stamps([const { AtomicU32::new(0) }; SIZE]);
/// The position after the last byte that the handler has seen; [`SIZE`] if it must look at all unread bytes.
static SEEN: AtomicUsize = AtomicUsize::new(SIZE);
/// The position after the last byte before the line was found idle. Without further bytes it is not found idle again:
/// the bridge may wait for an idle line as long as a host reads nothing.
static IDLE_AFTER: AtomicUsize = AtomicUsize::new(0);
/// An alarm looks for an idle line.
static IS_WATCHED: AtomicBool = AtomicBool::new(false);

/// Tolerance of the clock and of the byte time, which are whole microseconds.
const ROUNDING: Duration = Duration::from_micros(2);

/// Unread bytes at which bytes count as lost. The handlers see each byte before the rest of the ring is full.
const FULL: usize = SIZE - 64;

/// Starts the DMA at the first position of the ring.
pub(super) fn start(_: &mut Dma, _: LineCoding) -> Transfer<'_> {
    SEEN.store(0, Ordering::Relaxed);
    IDLE_AFTER.store(0, Ordering::Relaxed);
    usart::start_receiving(
        BYTES.0.as_ptr() as u32,
        STAMPS.0.as_ptr() as u32,
        SIZE.trailing_zeros() as u8,
    );
    usart::set_byte_interrupt(true);
    Transfer(PhantomData)
}

/// Stops the DMA.
pub(super) fn stop(_: Transfer<'_>) {
    usart::stop_receiving();
}

/// Applies a line coding, which the bridge has checked.
pub(super) fn configure(_: &mut Uart, coding: LineCoding) {
    usart::configure(coding);
}

/// The DMA's next write position in the ring.
pub(super) fn tail() -> usize {
    (usart::next_stamp() as usize - STAMPS.0.as_ptr() as usize) / size_of::<u32>() % SIZE
}

/// The arrival of the byte before a position.
fn arrival(end: usize) -> Instant {
    let now = now();
    let stamp = STAMPS.0[end.wrapping_sub(1) % SIZE].load(Ordering::Relaxed);
    now - Duration::from_micros((now.as_micros() as u32).wrapping_sub(stamp).into())
}

/// Makes the handler look for the bytes that the ring waits for, also among unread ones.
pub(super) fn listen(ring: &RxRing<SIZE>) {
    if !ring.has_mark() {
        SEEN.store(SIZE, Ordering::Relaxed);
    }
    usart::set_byte_interrupt(true);
    RxInterrupt::pend();
}

/// Looks at the bytes that have arrived.
pub(crate) struct RingHandler;

impl Handler<RxInterrupt> for RingHandler {
    unsafe fn on_interrupt() {
        usart::clear_received();
        let end = tail();
        let (is_event, is_waiting) = with_ring(|ring| {
            let unread = ring.unread(end);
            let fresh = match SEEN.swap(end, Ordering::Relaxed) {
                SIZE => unread,
                seen => unread.min(end.wrapping_sub(seen) % SIZE),
            };
            let mut is_event = false;
            for before in (1..=fresh).rev().map(|back| end.wrapping_sub(back) % SIZE) {
                let after = (before + 1) % SIZE;
                if ring.quiet(before, byte_at) == 0 {
                    is_event |= ring.arrived(after, byte_at(before), || arrival(after));
                }
            }
            (is_event, ring.is_waiting())
        });
        if !is_waiting {
            usart::set_byte_interrupt(false);
        }
        if is_event {
            wake();
        }
        check_room(end);
        if end != IDLE_AFTER.load(Ordering::Relaxed) && !IS_WATCHED.swap(true, Ordering::Relaxed) {
            set_idle_alarm(idle_from(end));
        }
    }
}

/// The time from which the line is idle, if the byte before `end` is the last: a byte that began in the first byte time
/// after it has arrived in the second.
fn idle_from(end: usize) -> Instant {
    arrival(end) + usart::line_time(2) + ROUNDING
}

/// Records an idle line.
pub(crate) struct IdleHandler;

impl Handler<IdleInterrupt> for IdleHandler {
    unsafe fn on_interrupt() {
        clear_idle_alarm();
        let end = tail();
        let at = idle_from(end);
        if now() < at {
            return set_idle_alarm(at);
        }
        IS_WATCHED.store(false, Ordering::Relaxed);
        IDLE_AFTER.store(end, Ordering::Relaxed);
        // The next byte starts the alarm.
        SEEN.store(end, Ordering::Relaxed);
        usart::set_byte_interrupt(true);
        let detected = arrival(end) + usart::line_time(1);
        if with_ring(|ring| ring.idle(end, detected)) {
            wake();
        }
        check_room(end);
    }
}

/// Checks that the DMA has not overwritten unread bytes.
fn check_room(end: usize) {
    if with_ring(|ring| ring.unread(end)) > FULL {
        RING_OVERRUN.store(true, Ordering::Relaxed);
        wake();
    }
}

/// No handler ran since `start`. If bytes arrived for longer than the ring lasts, some count as lost.
pub(crate) fn stalled_since(start: Instant) {
    let end = tail();
    let lasts = usart::line_time(FULL as u32);
    if arrival(end) >= start + lasts {
        RING_OVERRUN.store(true, Ordering::Relaxed);
        wake();
    }
}

/// Counts errors.
pub(crate) struct InterruptHandler;

impl Handler<UartInterrupt> for InterruptHandler {
    unsafe fn on_interrupt() {
        let now = usart::take_errors();
        critical_section::with(|cs| {
            let mut errors = ERRORS.borrow(cs).get().unwrap_or_default();
            errors.framing += u32::from(now.framing);
            errors.parity += u32::from(now.parity);
            errors.overrun += u32::from(now.overrun);
            ERRORS.borrow(cs).set(Some(errors));
        });
    }
}

/// The last byte of a burst is on the line, or was sent on one wire.
pub(crate) fn burst_ended() {
    super::transmission_complete();
}
