//! The receive path of the RP2040. The registers are in the board's [`usart`].
//!
//! # Time stamps
//!
//! The DMA writes a stamp beside each byte as it arrives. No interrupt is involved: a stamp is exact even if the flash
//! is being written. The interrupt handler of a byte only looks for the bytes that the bridge waits for.
//!
//! The UART has no interrupt for an idle line while the DMA empties its FIFO. An alarm compares the last stamp with the
//! clock. Inside a frame, whose end is known, and above 1 Mbaud it looks for bytes, too: the byte interrupt is off.

mod burst;
pub(super) mod interrupt;

use core::marker::PhantomData;
use core::sync::atomic::{AtomicU32, Ordering};

use armwire_bridge::{Duration, LineCoding, RxRing};
use embassy_time::Timer;

use super::state::{BYTES, SIZE, STATE, byte_at, wake};
use crate::board::hal::interrupt::typelevel::Handler;
use crate::board::usart;
use crate::board::{IdleInterrupt, RxInterrupt, Stamp, UartInterrupt, clear_idle_alarm, set_idle_alarm};
use crate::ceiling::{SERVICE, mask};

pub(crate) use burst::BurstHandler;

/// The UART, for its line coding.
pub(crate) struct Uart;
/// The receive DMA.
pub(crate) struct Dma;
/// The receive DMA in operation.
pub(super) struct Transfer<'a>(PhantomData<&'a mut Dma>);

/// A [`Stamp`] for each byte of the ring.
#[repr(align(4096))]
struct Stamps([AtomicU32; SIZE]);

/// The alignment is that of a ring of the DMA.
const _: () = assert!(align_of::<Stamps>() == 4 * SIZE);

/// The stamps, written by the DMA.
static STAMPS: Stamps = Stamps([const { AtomicU32::new(0) }; SIZE]);

/// Number of byte times without a byte after which the line is idle.
const IDLE_BYTES: u32 = 2;

/// Tolerance of the clock and of the byte time, which are whole microseconds.
const ROUNDING: Duration = Duration::from_micros(2);

/// The shortest time after which the line is idle, that of [`IDLE_BYTES`] at 1 Mbaud.
const SHORTEST_IDLE: Duration = Duration::from_micros(20);

/// The shortest time of [`IDLE_BYTES`] at which an interrupt comes for each byte: at 2 Mbaud the interrupts would take more
/// than half of the time.
const SHORTEST_INTERRUPTED: Duration = Duration::from_micros(20);

/// Unread bytes at which bytes count as lost. The handlers see each byte before the rest of the ring is full.
const FULL: usize = SIZE - 64;

/// Starts the DMA at the first position of the ring.
pub(super) fn start(_: &mut Dma, coding: LineCoding) -> Transfer<'_> {
    STATE.usart.set_byte_time(coding);
    STATE.interrupt.seen.store(0, Ordering::Relaxed);
    // The receiver reports the idle line after the bytes before this start. The next byte starts the alarm.
    STATE.interrupt.is_idle.store(true, Ordering::Relaxed);
    usart::start_receiving(
        BYTES.address() as u32,
        STAMPS.0.as_ptr() as u32,
        SIZE.trailing_zeros() as u8,
    );
    usart::set_byte_interrupt(true);
    Transfer(PhantomData)
}

/// The duration of a byte since the last start, rounded down to a microsecond.
pub(super) fn byte_time() -> Duration {
    STATE.usart.line_time(1)
}

/// Stops the DMA.
pub(super) fn stop(_: Transfer<'_>) {
    usart::stop_receiving();
}

/// Applies a line coding, which the bridge has checked. `was` is the one before.
///
/// A byte whose line coding changes while it arrives would be garbled. The wait is that of pico-sdk, 15 bits
/// (`hardware_uart/uart.c`, `uart_disable_before_lcr_write`). A byte that begins meanwhile is lost.
pub(super) async fn configure(_: &mut Uart, was: LineCoding, coding: LineCoding) {
    STATE.usart.disable();
    Timer::after_micros(was.micros(3) / 2).await;
    STATE.usart.enable(coding);
}

/// The DMA's next write position in the ring.
pub(super) fn tail() -> usize {
    (usart::next_stamp() as usize).wrapping_sub(STAMPS.0.as_ptr() as usize) / size_of::<u32>() % SIZE
}

/// The stamp of the byte before a position.
fn stamp(end: usize) -> Stamp {
    Stamp::from_bits(STAMPS.0[end.wrapping_sub(1) % SIZE].load(Ordering::Relaxed))
}

/// Looks for the events that the ring waits for among the unread bytes, and makes the handler look for later ones.
/// Returns true if there is one.
pub(super) fn listen(ring: &mut RxRing<SIZE>) -> bool {
    // The next byte starts the alarm, if there is none.
    usart::set_byte_interrupt(true);
    // After an event the handlers looked at no further byte.
    ring.look_again(tail(), |ring, end| look(ring, ring.unread(end), end))
}

/// Looks at `count` bytes before `end`, up to an event. Returns true if there is one.
fn look(ring: &mut RxRing<SIZE>, count: usize, end: usize) -> bool {
    let mut is_event = false;
    let mut left = count;
    while left > 0 {
        let before = end.wrapping_sub(left) % SIZE;
        let quiet = ring.quiet(before, byte_at);
        if quiet == 0 {
            let after = (before + 1) % SIZE;
            is_event |= ring.arrived(after, byte_at(before), || stamp(after).latest());
        }
        left = left.saturating_sub(quiet.max(1));
    }
    is_event
}

/// Looks at the bytes that arrived since the last call. Returns the position after the last one.
fn look_at_new() -> usize {
    STATE.rx.ring(|ring| {
        let end = tail();
        let unread = ring.unread(end);
        let new = end.wrapping_sub(STATE.interrupt.seen.load(Ordering::Relaxed)) % SIZE;
        if new > 0 {
            STATE.interrupt.seen.store(end, Ordering::Relaxed);
            STATE.interrupt.is_idle.store(false, Ordering::Relaxed);
        }
        let is_event = look(ring, unread.min(new), end);
        if unread > FULL {
            STATE.rx.overrun();
        } else if is_event {
            wake();
        }
        // Inside a frame the alarm for an idle line looks often enough.
        let is_inside = ring.quiet(end, byte_at) >= IDLE_BYTES as usize;
        usart::set_byte_interrupt(!is_inside && STATE.usart.line_time(IDLE_BYTES) >= SHORTEST_INTERRUPTED);
        end
    })
}

/// Looks at the bytes that have arrived, and makes the alarm look for an idle line after them.
pub(crate) struct RingHandler;

impl Handler<RxInterrupt> for RingHandler {
    unsafe fn on_interrupt() {
        usart::clear_received();
        let end = look_at_new();
        match STATE.interrupt.is_idle.load(Ordering::Relaxed) {
            // The next byte starts the alarm.
            true => usart::set_byte_interrupt(true),
            false => set_idle_alarm(idle_from(end)),
        }
    }
}

/// The time from which the line is idle, if the byte before `end` is the last: a byte that began in the first byte time
/// after it has arrived in the second.
fn idle_from(end: usize) -> Stamp {
    let wait = STATE.usart.line_time(IDLE_BYTES).max(SHORTEST_IDLE) + ROUNDING;
    stamp(end) + wait
}

/// Records an idle line.
pub(crate) struct IdleHandler;

impl Handler<IdleInterrupt> for IdleHandler {
    unsafe fn on_interrupt() {
        clear_idle_alarm();
        let end = look_at_new();
        let at = idle_from(end);
        if !STATE.interrupt.is_idle.load(Ordering::Relaxed) && !at.has_passed() {
            return set_idle_alarm(at);
        }
        // The next byte starts the alarm.
        usart::set_byte_interrupt(true);
        // An alarm that passed while it was set has two interrupts.
        if STATE.interrupt.is_idle.load(Ordering::Relaxed) {
            return;
        }
        STATE.interrupt.is_idle.store(true, Ordering::Relaxed);
        let detected = stamp(end).latest() + byte_time();
        if STATE.rx.ring(|ring| ring.idle(end, detected)) {
            wake();
        }
    }
}

/// Calls `f`, during which handlers may have to wait. If the DMA overwrites unread bytes meanwhile, they count as lost.
pub(crate) fn stall<R>(f: impl FnOnce() -> R) -> R {
    // The service must not read before a loss is known.
    let _masked = mask(SERVICE);
    let start = tail();
    let unread = STATE.rx.ring(|ring| ring.unread(start));
    // The stamp that is overwritten last.
    let last = stamp(start);
    let result = f();
    let arrived = tail().wrapping_sub(start) % SIZE;
    // The caller may stall again before a task has its turn.
    if stamp(start) != last || unread + arrived > FULL {
        STATE.rx.overrun();
    } else if STATE.rx.ring(|ring| ring.has_mark()) {
        wake();
    }
    result
}

/// Counts errors.
pub(crate) struct InterruptHandler;

impl Handler<UartInterrupt> for InterruptHandler {
    unsafe fn on_interrupt() {
        let now = usart::take_errors();
        STATE.rx.count_errors(|errors| {
            errors.framing += u32::from(now.framing);
            errors.parity += u32::from(now.parity);
            errors.overrun += u32::from(now.overrun);
        });
    }
}
