//! The control registers of the arm's UART, which are the same in every STM32. What is not is the board's.
//!
//! Interrupt handlers change them, too, and the handler of one may interrupt that of another: nobody else may come in
//! between the reading and the writing of one.

use embassy_stm32::pac::gpio::vals::{Moder, Ot, Pupdr};

use super::{TX_PIN, UART};

pub(crate) use super::uart::{
    clear_errors, clear_transmitted, is_byte_waiting, is_transmitted, keep_to_bytes, rx_data, rx_remaining,
    rx_went_round, take_status, tx_data,
};

/// What the UART had to say since it was last asked.
#[derive(Clone, Copy, Default)]
pub(crate) struct Status {
    /// A byte without its stop bit came.
    pub(crate) framing: bool,
    /// A byte with the wrong parity came.
    pub(crate) parity: bool,
    /// A byte with noise on it came.
    pub(crate) noise: bool,
    /// A byte was lost: nobody had fetched the one before.
    pub(crate) overrun: bool,
    /// The line went idle after a byte.
    pub(crate) idle: bool,
}

impl Status {
    /// Whether something was wrong.
    pub(crate) fn is_error(&self) -> bool {
        self.framing || self.parity || self.noise || self.overrun
    }
}

/// Lets the DMA fetch what comes in, and asks for interrupts when the line goes idle and on errors.
pub(crate) fn start_receiving() {
    set_receive_requests(true);
    critical_section::with(|_| {
        UART.cr1().modify(|w| {
            w.set_idleie(true);
            w.set_peie(w.pce());
        });
    });
}

/// Takes back all that [`start_receiving`] and [`set_byte_interrupt`] asked for.
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

/// Whether the DMA is asked to fetch what comes in, and an interrupt when something is wrong with it.
fn set_receive_requests(on: bool) {
    critical_section::with(|_| {
        UART.cr3().modify(|w| {
            w.set_eie(on);
            w.set_dmar(on);
        });
    });
}

/// Whether there is to be an interrupt when a byte comes.
pub(crate) fn set_byte_interrupt(on: bool) {
    critical_section::with(|_| UART.cr1().modify(|w| w.set_rxneie(on)));
}

/// Whether the DMA is asked to bring what goes out.
pub(crate) fn set_transmit_requests(on: bool) {
    critical_section::with(|_| UART.cr3().modify(|w| w.set_dmat(on)));
}

/// Whether there is to be an interrupt when the last bit of what was sent is out.
pub(crate) fn set_transmitted_interrupt(on: bool) {
    critical_section::with(|_| UART.cr1().modify(|w| w.set_tcie(on)));
}

/// Whether the interrupt that [`set_transmitted_interrupt`] asks for is there.
pub(crate) fn is_transmitted_interrupt() -> bool {
    UART.cr1().read().tcie() && is_transmitted()
}

/// Holds the pin that sends high, whatever becomes of the UART. Nothing drives the pin while the UART is disabled, and the arm
/// may take that for a start bit. The pin's port must have its clock.
pub(crate) fn hold_tx_high() {
    let (port, pin, _) = TX_PIN;
    port.bsrr().write(|w| w.set_bs(pin, true));
    port.moder().modify(|w| w.set_moder(pin, Moder::OUTPUT));
}

/// Gives the pin that sends to the UART, which must be enabled.
pub(crate) fn release_tx() {
    let (port, pin, function) = TX_PIN;
    port.afr(pin / 8).modify(|w| w.set_afr(pin % 8, function));
    port.moder().modify(|w| w.set_moder(pin, Moder::ALTERNATE));
}

/// Lets a UART that is enabled send.
pub(crate) fn start_transmitter() {
    critical_section::with(|_| UART.cr1().modify(|w| w.set_te(true)));
    release_tx();
}

/// One wire for both ways, on the pin that sends, or two. Only while nothing is on the line.
///
/// What goes out on one wire also comes in, unless the receiver is off meanwhile: [`set_receiver`].
pub(crate) fn set_half_duplex(on: bool) {
    // Nobody drives the wire between bytes: a pull-up keeps it high.
    let (output, pull) = match on {
        true => (Ot::OPEN_DRAIN, Pupdr::PULL_UP),
        false => (Ot::PUSH_PULL, Pupdr::FLOATING),
    };
    let (port, pin, _) = TX_PIN;
    port.otyper().modify(|w| w.set_ot(pin, output));
    port.pupdr().modify(|w| w.set_pupdr(pin, pull));
    // Newer UARTs keep HDSEL as it is while they are enabled.
    critical_section::with(|_| {
        UART.cr1().modify(|w| w.set_ue(false));
        UART.cr3().modify(|w| w.set_hdsel(on));
        keep_to_bytes();
        UART.cr1().modify(|w| w.set_ue(true));
    });
}

/// Switches the receiver on or off.
pub(crate) fn set_receiver(on: bool) {
    critical_section::with(|_| UART.cr1().modify(|w| w.set_re(on)));
}
