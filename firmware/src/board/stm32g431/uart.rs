//! What is this chip's own in the registers of the arm's UART (RM0440 section 37.8) and of the DMA channel that serves
//! it.

use embassy_stm32::pac;

use super::super::usart::Status;
use super::{RX_CHANNEL, UART};

/// Reads and clears what the UART has to say.
pub(crate) fn take_status() -> Status {
    let isr = UART.isr().read();
    // Writing 1 clears.
    UART.icr().write(|w| {
        w.set_fe(isr.fe());
        w.set_pe(isr.pe());
        w.set_ne(isr.ne());
        w.set_ore(isr.ore());
        w.set_idle(isr.idle());
    });
    Status {
        framing: isr.fe(),
        parity: isr.pe(),
        noise: isr.ne(),
        overrun: isr.ore(),
        idle: isr.idle(),
    }
}

/// Clears errors that still stand: there are none, they were cleared when they were read.
pub(crate) fn clear_errors() {}

/// Lets the UART, which is disabled, tell of one byte at a time, and hand over a byte with an error, too.
///
/// The HAL switches on the FIFOs, in which a flag tells of a byte other than the last one. And without DDRE the DMA does not
/// get a byte with an error, but it is part of a frame (RM0440 37.8.4): with it, the DMA gets that once the flag is cleared,
/// which the interrupt handler does.
pub(crate) fn keep_to_bytes() {
    UART.cr1().modify(|w| w.set_fifoen(false));
    UART.cr3().modify(|w| w.set_ddre(true));
}

/// Whether a byte waits for the DMA.
pub(crate) fn is_byte_waiting() -> bool {
    UART.isr().read().rxne()
}

/// Where the DMA fetches what came in.
pub(crate) fn rx_data() -> *mut u8 {
    UART.rdr().as_ptr().cast()
}

/// How many bytes the DMA has left in its round of the receive ring.
pub(crate) fn rx_remaining() -> usize {
    pac::DMA1.ch(RX_CHANNEL).ndtr().read().ndt().into()
}

/// Whether the DMA has gone through both halves of the receive ring since its interrupt handler last ran. To be asked
/// there, before the flags are cleared.
pub(crate) fn rx_went_round() -> bool {
    let flags = pac::DMA1.isr().read();
    flags.htif(RX_CHANNEL) && flags.tcif(RX_CHANNEL)
}

/// Where the DMA brings what goes out.
pub(crate) fn tx_data() -> *mut u8 {
    UART.tdr().as_ptr().cast()
}

/// Lets [`is_transmitted`] speak of what is sent from now on.
pub(crate) fn clear_transmitted() {
    UART.icr().write(|w| w.set_tc(true));
}

/// Whether the last bit of what was sent is out.
pub(crate) fn is_transmitted() -> bool {
    UART.isr().read().tc()
}
