//! The chip-specific registers of the arm's UART (RM0440 section 37.8) and of its DMA channels.

use core::sync::atomic::{Ordering, fence};

use embassy_stm32::pac;
use embassy_stm32::pac::bdma::vals::Dir;

use super::super::status::Status;
use super::{RX_CHANNEL, TX_CHANNEL, TX_REQUEST, UART};

/// The DMA's source for received bytes.
pub(crate) fn rx_data() -> *mut u8 {
    UART.rdr().as_ptr().cast()
}

/// The number of bytes left in the DMA's pass over the receive ring.
pub(crate) fn rx_remaining() -> usize {
    pac::DMA1.ch(RX_CHANNEL).ndtr().read().ndt().into()
}

/// Returns true if the DMA has passed both halves of the receive ring since its interrupt handler last ran. Call this
/// in the handler, before the flags are cleared.
pub(crate) fn rx_has_wrapped() -> bool {
    let flags = pac::DMA1.isr().read();
    flags.htif(RX_CHANNEL) && flags.tcif(RX_CHANNEL)
}

/// Clears the interrupt of the transmit DMA, flag by flag: an error that comes with the clear of all at once may be lost
/// (ES0431, "DMA disable failure and error flag omission upon simultaneous transfer error and global flag clear").
pub(crate) fn clear_sent() {
    pac::DMA1.ifcr().write(|w| {
        w.set_tcif(TX_CHANNEL, true);
        w.set_htif(TX_CHANNEL, true);
        w.set_teif(TX_CHANNEL, true);
    });
}

/// Makes [`Usart::is_transmitted`] refer to bytes sent from now on.
pub(crate) fn clear_transmitted() {
    UART.icr().write(|w| w.set_tc(true));
}

/// The arm's UART. Its registers show all of its state.
pub(crate) struct Usart;

impl Usart {
    pub(crate) const fn new() -> Self {
        Self
    }

    /// Reads and clears the UART's flags.
    pub(crate) fn take_status(&self) -> Status {
        let isr = UART.isr().read();
        // Writing 1 clears. The DMA gets the byte of an error afterwards. No other driver with DDRE is known: DMAR at 0
        // meanwhile would cost the bytes behind it.
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

    /// Does nothing: [`take_status`](Self::take_status) has cleared the errors.
    pub(crate) fn clear_errors(&self) {}

    /// Returns false: see [`keep_parity_error`](Self::keep_parity_error).
    pub(crate) const fn must_keep_parity_errors(&self) -> bool {
        false
    }

    /// Does nothing: only a write of ICR clears an error.
    pub(crate) fn keep_parity_error(&self) {}

    /// Configures the disabled UART for one byte at a time, and for the delivery of bytes with errors.
    ///
    /// The HAL enables the FIFOs, with which a flag may belong to an earlier byte. Without DDRE the DMA does not get a byte
    /// with an error, which is part of a frame (RM0440 37.8.4). With DDRE the DMA gets the byte after the interrupt handler
    /// has cleared the flag.
    pub(crate) fn configure_byte_mode(&self) {
        UART.cr1().modify(|w| w.set_fifoen(false));
        UART.cr3().modify(|w| w.set_ddre(true));
    }

    /// Returns true if a byte waits for the DMA.
    pub(crate) fn is_byte_waiting(&self) -> bool {
        UART.isr().read().rxne()
    }

    /// Starts the transmit DMA, which must have stopped. `bytes` must stay unchanged until it has (RM0440 12.4.3).
    pub(crate) fn start_sending(&self, bytes: &[u8]) {
        // The channel stays enabled after the last byte, and its registers are then protected.
        self.stop_sending();
        let channel = pac::DMA1.ch(TX_CHANNEL);
        pac::DMAMUX1.ccr(TX_CHANNEL).write(|w| w.set_dmareq_id(TX_REQUEST));
        channel.par().write_value(UART.tdr().as_ptr() as u32);
        channel.mar().write_value(bytes.as_ptr() as u32);
        channel.ndtr().write(|w| w.set_ndt(bytes.len() as u16));
        // The bytes are written before the DMA reads them.
        fence(Ordering::Release);
        channel.cr().write(|w| {
            w.set_dir(Dir::FROM_MEMORY);
            w.set_minc(true);
            w.set_tcie(true);
            w.set_en(true);
        });
    }

    /// Stops the transmit DMA.
    pub(crate) fn stop_sending(&self) {
        pac::DMA1.ch(TX_CHANNEL).cr().write(|w| w.set_en(false));
        clear_sent();
    }

    /// Returns true if the last bit has been sent.
    pub(crate) fn is_transmitted(&self) -> bool {
        UART.isr().read().tc()
    }
}
