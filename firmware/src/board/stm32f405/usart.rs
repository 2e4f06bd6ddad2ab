//! The registers of the arm's UART, USART2 (RM0090 section 30.6), and of the DMA stream that serves it.

use embassy_stm32::pac;
use embassy_stm32::pac::gpio::vals::{Ot, Pupdr};

use super::UartStatus;

const UART: pac::usart::Usart = pac::USART2;
/// PA2.
const TX_PIN: usize = 2;

/// Reads and clears what the UART has to say.
///
/// What is read while a byte waits stays set until the DMA has fetched that byte.
pub(crate) fn take_status() -> UartStatus {
    let sr = UART.sr().read();
    let status = UartStatus {
        framing: sr.fe(),
        parity: sr.pe(),
        noise: sr.ne(),
        overrun: sr.ore(),
        idle: sr.idle(),
    };
    if (status.is_error() || status.idle) && !sr.rxne() {
        // RM0090 30.6.1: reading SR and then DR clears the flags. With RXNE set the DMA is about to do that read, and
        // must: the byte is its.
        UART.dr().read();
    }
    status
}

/// Lets the DMA fetch what comes in, and asks for interrupts when the line goes idle and on errors.
pub(crate) fn start_receiving() {
    UART.cr3().modify(|w| {
        w.set_eie(true);
        w.set_dmar(true);
    });
    UART.cr1().modify(|w| {
        w.set_idleie(true);
        w.set_peie(w.pce());
    });
}

/// Takes back all that [`start_receiving`] and [`set_byte_interrupt`] asked for.
pub(crate) fn stop_receiving() {
    UART.cr1().modify(|w| {
        w.set_rxneie(false);
        w.set_idleie(false);
        w.set_peie(false);
    });
    UART.cr3().modify(|w| {
        w.set_eie(false);
        w.set_dmar(false);
    });
}

/// Asks for no more interrupts on errors until [`start_receiving`].
pub(crate) fn mute_errors() {
    UART.cr3().modify(|w| w.set_eie(false));
    UART.cr1().modify(|w| w.set_peie(false));
}

/// Whether there is to be an interrupt when a byte comes.
pub(crate) fn set_byte_interrupt(on: bool) {
    UART.cr1().modify(|w| w.set_rxneie(on));
}

/// Whether a byte waits for the DMA.
pub(crate) fn is_byte_waiting() -> bool {
    UART.sr().read().rxne()
}

/// Whether the DMA has gone through both halves of the receive ring since its interrupt handler last ran. To be asked
/// there, before the flags are cleared.
pub(crate) fn rx_went_round() -> bool {
    let flags = pac::DMA1.isr(super::RX_STREAM / 4).read();
    flags.htif(super::RX_STREAM % 4) && flags.tcif(super::RX_STREAM % 4)
}

/// Where the DMA fetches what came in.
pub(crate) fn rx_data() -> *mut u8 {
    UART.dr().as_ptr().cast()
}

/// How many bytes the DMA has left in its round of the receive ring.
pub(crate) fn rx_remaining() -> usize {
    pac::DMA1.st(super::RX_STREAM).ndtr().read().ndt().into()
}

/// Lets the DMA bring what goes out.
pub(crate) fn start_transmitting() {
    UART.cr3().modify(|w| w.set_dmat(true));
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
    UART.sr().read().tc()
}

/// Whether there is to be an interrupt when the last bit of what was sent is out.
pub(crate) fn set_transmitted_interrupt(on: bool) {
    UART.cr1().modify(|w| w.set_tcie(on));
}

/// One wire for both ways, on PA2, or two (RM0090 30.3.10).
///
/// What goes out on one wire also comes in, unless the receiver is off meanwhile: [`set_receiver`].
pub(crate) fn set_half_duplex(on: bool) {
    // Nobody drives the wire between bytes: a pull-up keeps it high.
    let (output, pull) = match on {
        true => (Ot::OPEN_DRAIN, Pupdr::PULL_UP),
        false => (Ot::PUSH_PULL, Pupdr::FLOATING),
    };
    pac::GPIOA.otyper().modify(|w| w.set_ot(TX_PIN, output));
    pac::GPIOA.pupdr().modify(|w| w.set_pupdr(TX_PIN, pull));
    UART.cr3().modify(|w| w.set_hdsel(on));
}

/// Switches the receiver on or off.
pub(crate) fn set_receiver(on: bool) {
    UART.cr1().modify(|w| w.set_re(on));
}
