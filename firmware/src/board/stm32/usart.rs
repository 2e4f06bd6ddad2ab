//! The control registers of the arm's UART that are the same in every STM32. The board has the others.
//!
//! Interrupt handlers write them, too, and can preempt each other: every read-modify-write must be in a critical
//! section.

use embassy_stm32::pac::gpio::vals::{Moder, Ot, Pupdr};

use super::{TX_PIN, UART};

pub(crate) use super::status::Status;
pub(crate) use super::uart::{Usart, clear_sent, clear_transmitted, rx_data, rx_has_wrapped, rx_remaining};

/// Enables the receive DMA, and the interrupts for an idle line and errors.
pub(crate) fn start_receiving() {
    set_receive_requests(true);
    critical_section::with(|_| {
        UART.cr1().modify(|w| {
            w.set_idleie(true);
            w.set_peie(w.pce());
        });
    });
}

/// Disables everything that [`start_receiving`] and [`set_byte_interrupt`] enable.
pub(crate) fn stop_receiving() {
    critical_section::with(|_| {
        UART.cr1().modify(|w| {
            w.set_rxneie(false);
            w.set_idleie(false);
            w.set_peie(false);
        });
    });
    set_receive_requests(false);
}

/// Enables or disables the receive DMA requests and the error interrupt.
fn set_receive_requests(on: bool) {
    critical_section::with(|_| {
        UART.cr3().modify(|w| {
            w.set_eie(on);
            w.set_dmar(on);
        });
    });
}

/// Enables or disables the interrupt for each byte.
pub(crate) fn set_byte_interrupt(on: bool) {
    critical_section::with(|_| UART.cr1().modify(|w| w.set_rxneie(on)));
}

/// Enables or disables the transmit DMA requests.
pub(crate) fn set_transmit_requests(on: bool) {
    critical_section::with(|_| UART.cr3().modify(|w| w.set_dmat(on)));
}

/// Drives the TX pin high, independent of the UART. A disabled UART leaves the pin floating, and the arm may read that
/// as a start bit. The pin's port must have its clock.
pub(crate) fn hold_tx_high() {
    let (port, pin, _) = TX_PIN;
    port.bsrr().write(|w| w.set_bs(pin, true));
    port.moder().modify(|w| w.set_moder(pin, Moder::OUTPUT));
}

/// Returns the TX pin to the UART, which must be enabled.
pub(crate) fn release_tx() {
    let (port, pin, function) = TX_PIN;
    port.afr(pin / 8).modify(|w| w.set_afr(pin % 8, function));
    port.moder().modify(|w| w.set_moder(pin, Moder::ALTERNATE));
}

/// Enables the transmitter of an enabled UART.
pub(crate) fn start_transmitter() {
    critical_section::with(|_| UART.cr1().modify(|w| w.set_te(true)));
    release_tx();
}

impl Usart {
    /// Enables or disables the interrupt after the last bit.
    pub(crate) fn set_transmitted_interrupt(&self, on: bool) {
        critical_section::with(|_| UART.cr1().modify(|w| w.set_tcie(on)));
    }

    /// Returns true if the interrupt of [`set_transmitted_interrupt`](Self::set_transmitted_interrupt) is pending.
    pub(crate) fn is_transmitted_interrupt(&self) -> bool {
        UART.cr1().read().tcie() && self.is_transmitted()
    }

    /// Selects one wire for both directions, on the TX pin, or two. Call this only on an idle line.
    ///
    /// Bytes sent on one wire are also received, unless the receiver is off: [`set_receiver`](Self::set_receiver).
    pub(crate) fn set_half_duplex(&self, on: bool) {
        // The wire floats between bytes: a pull-up keeps it high.
        let (output, pull) = match on {
            true => (Ot::OPEN_DRAIN, Pupdr::PULL_UP),
            false => (Ot::PUSH_PULL, Pupdr::FLOATING),
        };
        let (port, pin, _) = TX_PIN;
        port.otyper().modify(|w| w.set_ot(pin, output));
        port.pupdr().modify(|w| w.set_pupdr(pin, pull));
        // Newer UARTs ignore writes to HDSEL while they are enabled.
        critical_section::with(|_| {
            UART.cr1().modify(|w| w.set_ue(false));
            UART.cr3().modify(|w| w.set_hdsel(on));
            self.configure_byte_mode();
            UART.cr1().modify(|w| w.set_ue(true));
        });
    }

    /// Returns true if one wire is selected: see [`set_half_duplex`](Self::set_half_duplex).
    pub(crate) fn is_half_duplex(&self) -> bool {
        UART.cr3().read().hdsel()
    }

    /// Returns true if a burst ends after its DMA: on a single wire, with its last bit.
    pub(crate) fn sends_after_dma(&self) -> bool {
        self.is_half_duplex()
    }

    /// Switches the receiver on or off.
    pub(crate) fn set_receiver(&self, on: bool) {
        critical_section::with(|_| UART.cr1().modify(|w| w.set_re(on)));
    }
}
