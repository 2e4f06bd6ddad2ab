//! The receive path of an STM32. The registers are in the board's [`usart`].
//!
//! The HAL's ring-buffered receiver is not used. Each call reads the data register, which on older UARTs takes a byte
//! from the DMA if one arrives at that moment. It reports one error if the status register has several. After an error
//! it re-enables the DMA stream without a new configuration, and its position in the ring is then wrong. Here only the
//! interrupt handler reads the data register, and only to clear a flag. Each start of the receive path configures the
//! stream completely.
//!
//! # Time stamps
//!
//! The interrupt handler checks each byte up to the length of a frame, and each of the frame's last ones. It therefore
//! sees the byte that completes the frame as it arrives, and records the time. Tasks and other interrupt handlers do not
//! delay it: it preempts all of them.

mod byte_interrupt;
pub(super) mod interrupt;
mod tail;

use armwire_bridge::{Duration, Instant, LineCoding, Parity, RxRing, StopBits};
use embassy_stm32::dma::{Channel, TransferOptions};
use embassy_stm32::interrupt::typelevel::Handler;
use embassy_stm32::mode::Blocking;
use embassy_stm32::usart::{self as hal, UartRx};
use portable_atomic::Ordering;

use super::state::{BYTES, SIZE, STATE, byte_at, wake};
use super::transmit::transmission_complete;
use crate::board::usart::{self, Status};
use crate::board::{RX_REQUEST, RxInterrupt, UartInterrupt};
use crate::clock::now;

pub(crate) use byte_interrupt::SleepHandler;
pub(super) use tail::tail;

/// The HAL's driver, for the line coding.
pub(crate) type Uart = UartRx<'static, Blocking>;
/// The receive DMA.
pub(crate) type Dma = Channel<'static>;
/// The receive DMA in operation.
pub(super) type Transfer<'a> = embassy_stm32::dma::Transfer<'a>;

/// Configures the DMA stream and connects it to the UART.
pub(super) fn start(dma: &mut Dma, coding: LineCoding) -> Transfer<'_> {
    byte_interrupt::set_coding(coding);
    let ring = core::ptr::slice_from_raw_parts_mut(BYTES.address(), SIZE);
    let mut options = TransferOptions::default();
    options.circular = true;
    options.half_transfer_ir = true;
    let transfer = critical_section::with(|cs| {
        // The byte that the UART holds becomes the first in the ring, and its counted errors stay counted.
        let counted = STATE.interrupt.counted.borrow(cs);
        let held = counted.take().filter(|&(end, _)| end == tail());
        counted.set(held.map(|(_, status)| (0, status)));
        // SAFETY: the source is the UART's data register, whose stream this is; the target consists of static
        // atomics.
        unsafe { dma.read_raw(RX_REQUEST, usart::rx_data(), ring, options) }
    });
    usart::start_receiving();
    // The byte that the UART holds counts as one before the start.
    wait_for_count();
    transfer
}

/// The duration of a byte since the last start, rounded down to a microsecond.
pub(super) fn byte_time() -> Duration {
    Duration::from_micros(STATE.interrupt.byte_time.load(Ordering::Relaxed).into())
}

/// Stops the stream.
pub(super) fn stop(mut transfer: Transfer<'_>) {
    // The interrupt handler leaves a byte in the data register to the DMA, which will not fetch it now.
    critical_section::with(|_| {
        byte_interrupt::set(false);
        usart::stop_receiving();
    });
    transfer.request_pause();
    while transfer.is_running() {}
}

/// Applies a line coding, which the bridge has checked. The byte that arrives meanwhile is lost.
pub(super) async fn configure(uart: &mut Uart, _was: LineCoding, coding: LineCoding) {
    let mut config = hal::Config::default();
    config.baudrate = coding.baud;
    config.parity = match coding.parity {
        Parity::None => hal::Parity::ParityNone,
        Parity::Odd => hal::Parity::ParityOdd,
        Parity::Even => hal::Parity::ParityEven,
    };
    config.stop_bits = match coding.stop_bits {
        StopBits::One => hal::StopBits::STOP1,
        StopBits::Two => hal::StopBits::STOP2,
    };
    // The bridge accepts only configurations that this UART supports.
    if uart.set_config(&config).is_err() {
        unreachable!()
    }
}

/// Makes the interrupt handler look at each byte. Returns true if an event has already come: bytes that arrived before
/// the handler knew the threshold do not pend the service.
pub(super) fn listen(ring: &mut RxRing<SIZE>) -> bool {
    byte_interrupt::set(true);
    ring.has_mark() || ring.is_overdue(tail())
}

/// Records the arrival of the threshold, idle lines and errors.
pub(crate) struct InterruptHandler;

impl Handler<UartInterrupt> for InterruptHandler {
    unsafe fn on_interrupt() {
        // The future position of the byte that the status belongs to, if it waits: the DMA may fetch it from here on.
        let place = tail();
        let status = STATE.usart.take_status();
        let is_byte = !status.is_error() && !status.idle && !STATE.usart.is_transmitted_interrupt();
        // Usually it is a byte inside a frame, which the DMA may not have counted yet.
        if is_byte && !STATE.usart.must_keep_parity_errors() {
            let quiet = STATE.rx.ring(|ring| ring.quiet(place, byte_at));
            if quiet > 0 {
                byte_interrupt::sleep(quiet);
                return;
            }
        }
        if !is_byte || !wait_for_dma() {
            return record_flags(status, place);
        }
        if record_bytes(tail(), now) {
            wake();
        }
    }
}

/// Records the bytes before `end`, and their time if they reach the threshold. Returns true if they do.
// Inline: it is executed for each byte.
#[inline(always)]
fn record_bytes(end: usize, at: impl FnOnce() -> Instant) -> bool {
    let last = byte_at(end.wrapping_sub(1));
    STATE.rx.ring(|ring| {
        let is_event = ring.arrived(end, last, at);
        if is_event && !ring.is_waiting() {
            byte_interrupt::set(false);
        }
        is_event
    })
}

/// Records errors, an idle line and the end of a transmission. A byte that waits will be at `place` in the ring.
#[cold]
fn record_flags(status: Status, place: usize) {
    let at = now();
    if STATE.usart.is_transmitted_interrupt() {
        transmission_complete();
    }
    // The byte that triggered the handler is in the ring a few cycles later.
    let is_fetched = wait_for_dma();
    if status.is_error() {
        record_errors(status, place, is_fetched);
    }
    let end = tail();
    let is_event = record_bytes(end, || at);
    let is_idle = status.idle && STATE.rx.ring(|ring| ring.idle(end, at));
    // Errors are reported to the bridge together with the bytes.
    if is_event || is_idle {
        wake();
    }
}

/// Polls of the interrupt handler for the DMA's fetch of a byte, which takes less time.
const FETCH_TRIES: usize = 16;

/// Cycles within which the DMA has written and counted a fetched byte.
const COUNT_CYCLES: u32 = 24;

/// Waits for [`COUNT_CYCLES`]. A turn of the loop in `delay` counts as two cycles there, and takes three at least on a
/// Cortex-M4: a branch fills the pipeline again (ARM DDI 0439, 3.3.1).
fn wait_for_count() {
    cortex_m::asm::delay(COUNT_CYCLES * 2 / 3);
}

/// Waits briefly until the DMA has fetched and counted the UART's byte. Returns true if it has.
// Inline: it is executed for each byte.
#[inline(always)]
fn wait_for_dma() -> bool {
    let is_fetched = (0..FETCH_TRIES).any(|_| !STATE.usart.is_byte_waiting());
    if is_fetched {
        STATE.usart.keep_parity_error();
    }
    wait_for_count();
    is_fetched
}

/// Counts the errors of a byte at this future position in the ring, but only once while the byte waits for the DMA.
#[cold]
fn record_errors(status: Status, place: usize, is_fetched: bool) {
    critical_section::with(|cs| {
        let held = STATE.interrupt.counted.borrow(cs);
        let counted = match held.take() {
            Some((held, counted)) if held == place => counted,
            _ => Status::default(),
        };
        STATE.rx.count_errors(|errors| {
            for (flag, was, counter) in [
                (status.framing, counted.framing, &mut errors.framing),
                (status.parity, counted.parity, &mut errors.parity),
                (status.noise, counted.noise, &mut errors.noise),
                (status.overrun, counted.overrun, &mut errors.overrun),
            ] {
                *counter += u32::from(flag && !was);
            }
        });
        if !is_fetched {
            held.set(Some((place, status)));
        }
    });
    if is_fetched {
        STATE.usart.clear_errors();
    }
}

/// Checks, each time the DMA enters a half of the ring, that the content of that half had been read.
pub(crate) struct RingHandler;

impl Handler<RxInterrupt> for RingHandler {
    unsafe fn on_interrupt() {
        // With two checks per turn the DMA cannot pass the head unnoticed. With fewer, as after a stall for the flash,
        // `rx_has_wrapped` detects it.
        if STATE.rx.ring(|ring| ring.unread(tail())) > SIZE / 2 - MARGIN || usart::rx_has_wrapped() {
            STATE.rx.overrun();
        }
    }
}

/// Bytes that may arrive before the handler runs.
const MARGIN: usize = 16;
