//! What is this chip's own in the registers of the arm's UART (RM0090 section 30.6) and of the DMA stream that serves
//! it.

use core::sync::atomic::{AtomicU32, Ordering};

use embassy_stm32::interrupt::typelevel::Interrupt;
use embassy_stm32::pac;
use embassy_stm32::pac::usart::regs::Sr;

use super::super::usart::Status;
use super::{RX_STREAM, UART, UartInterrupt};

/// PE, FE, NF, ORE and IDLE of SR.
const FLAGS: u32 = 0b1_1111;
/// The flags that the last read of SR showed.
static SHOWN: AtomicU32 = AtomicU32::new(0);
/// The flags that reads of SR have shown since the interrupt handler was last told.
static UNTOLD: AtomicU32 = AtomicU32::new(0);

/// Reads SR for something else than its flags. The DMA's read of DR then clears a flag that this read showed (RM0090 30.6.1),
/// so the interrupt handler is told of it, and comes for it.
fn look_at_status() -> Sr {
    critical_section::with(|_| {
        let sr = UART.sr().read();
        keep_flags(sr);
        sr
    })
}

/// Keeps the flags of SR for the interrupt handler. To be called in the critical section in which SR was read.
fn keep_flags(sr: Sr) {
    let flags = sr.0 & FLAGS;
    let new = flags & !SHOWN.load(Ordering::Relaxed);
    SHOWN.store(flags, Ordering::Relaxed);
    if new != 0 {
        UNTOLD.store(UNTOLD.load(Ordering::Relaxed) | new, Ordering::Relaxed);
        UartInterrupt::pend();
    }
}

/// Reads and clears what the UART has to say.
///
/// What is read while a byte waits stays set until the DMA has fetched that byte.
pub(crate) fn take_status() -> Status {
    let shown = critical_section::with(|_| {
        let sr = UART.sr().read();
        clear_flags(sr);
        SHOWN.store(sr.0 & FLAGS, Ordering::Relaxed);
        let untold = UNTOLD.load(Ordering::Relaxed);
        UNTOLD.store(0, Ordering::Relaxed);
        Sr(sr.0 | untold)
    });
    Status {
        framing: shown.fe(),
        parity: shown.pe(),
        noise: shown.ne(),
        overrun: shown.ore(),
        idle: shown.idle(),
    }
}

/// Clears the flags of SR, which was read just before: reading SR and then DR does (RM0090 30.6.1).
///
/// With RXNE set the DMA is about to do that read, and must: the byte is its. A byte that ends between the two reads would be
/// taken from the DMA, and nothing tells of it, so the reads are a few cycles apart.
#[inline(always)]
fn clear_flags(sr: Sr) {
    if sr.0 & FLAGS != 0 && !sr.rxne() {
        UART.dr().read();
    }
}

/// Clears errors that still stand after the DMA has fetched their byte: a byte that is sent between the two reads breaks
/// the sequence.
pub(crate) fn clear_errors() {
    critical_section::with(|_| {
        let sr = UART.sr().read();
        clear_flags(sr);
        keep_flags(sr);
    });
}

/// Lets the UART, which is disabled, tell of one byte at a time: this one knows nothing else.
pub(crate) fn keep_to_bytes() {}

/// Whether a byte waits for the DMA.
pub(crate) fn is_byte_waiting() -> bool {
    look_at_status().rxne()
}

/// Where the DMA fetches what came in.
pub(crate) fn rx_data() -> *mut u8 {
    UART.dr().as_ptr().cast()
}

/// How many bytes the DMA has left in its round of the receive ring.
pub(crate) fn rx_remaining() -> usize {
    pac::DMA1.st(RX_STREAM).ndtr().read().ndt().into()
}

/// Whether the DMA has gone through both halves of the receive ring since its interrupt handler last ran. To be asked
/// there, before the flags are cleared.
pub(crate) fn rx_went_round() -> bool {
    let flags = pac::DMA1.isr(RX_STREAM / 4).read();
    flags.htif(RX_STREAM % 4) && flags.tcif(RX_STREAM % 4)
}

/// Where the DMA brings what goes out.
pub(crate) fn tx_data() -> *mut u8 {
    UART.dr().as_ptr().cast()
}

/// Lets [`is_transmitted`] speak of what is sent from now on (RM0090 30.3.13).
pub(crate) fn clear_transmitted() {
    // Writing 1 leaves the other flags alone.
    UART.sr().write(|w| {
        w.0 = !0;
        w.set_tc(false);
    });
}

/// Whether the last bit of what was sent is out.
pub(crate) fn is_transmitted() -> bool {
    look_at_status().tc()
}
