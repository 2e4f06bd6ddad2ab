//! The registers of the arm's UART, a PL011 (4.2), and of its DMA channels (2.5).
//!
//! Interrupt handlers write them, too: every read-modify-write must be in a critical section.

use core::sync::atomic::{AtomicBool, AtomicU32, Ordering, fence};

use armwire_bridge::{Duration, LineCoding, Parity, StopBits};
use embassy_rp::clocks::clk_peri_freq;
use embassy_rp::pac::dma::regs::CtrlTrig;
use embassy_rp::pac::dma::vals::{DataSize, TreqSel};
use embassy_rp::pac::io::vals::{Gpio0ctrlFuncsel, Oeover};
use embassy_rp::pac::{DMA, IO_BANK0, PADS_BANK0, SIO, TIMER, UART1};

use super::time::set_end_alarm;
use crate::clock::now;

/// The pins to and from the arm.
const TX: usize = 4;
const RX: usize = 5;

/// The DMA channels: received bytes, their stamps, and bytes to send.
const BYTES: usize = 0;
const STAMPS: usize = 1;
const SENT: usize = 2;

/// Bytes in the transmit FIFO.
const FIFO: u32 = 32;

/// Cycles within which the DMA has written a byte and its stamp.
const STAMP_CYCLES: u32 = 64;

/// The line coding at the start.
const START: LineCoding = LineCoding {
    baud: 1_000_000,
    parity: Parity::None,
    stop_bits: StopBits::One,
};

/// The errors since the last call.
pub(crate) struct Errors {
    /// A byte without a stop bit, or a break.
    pub(crate) framing: bool,
    /// A byte with wrong parity.
    pub(crate) parity: bool,
    /// Lost bytes: the FIFO was full.
    pub(crate) overrun: bool,
}

/// Reads and clears the errors.
pub(crate) fn take_errors() -> Errors {
    let shown = UART1.uartris().read();
    // One that has come since the read stays for the next call.
    UART1.uarticr().write(|w| {
        w.set_feic(shown.feris());
        w.set_peic(shown.peris());
        w.set_beic(shown.beris());
        w.set_oeic(shown.oeris());
    });
    Errors {
        framing: shown.feris() || shown.beris(),
        parity: shown.peris(),
        overrun: shown.oeris(),
    }
}

/// Starts the DMA into a ring of bytes and a ring of stamps, each aligned to its size. `log2` is the number of bytes as
/// a power of two.
///
/// A transfer of one byte starts that of its stamp, which starts the next: the chip stamps each byte as it arrives,
/// however long an interrupt waits.
pub(crate) fn start_receiving(bytes: u32, stamps: u32, log2: u8) {
    let (byte, stamp) = (DMA.ch(BYTES), DMA.ch(STAMPS));
    byte.read_addr().write_value(UART1.uartdr().as_ptr() as u32);
    byte.write_addr().write_value(bytes);
    byte.trans_count().write_value(1);
    stamp.read_addr().write_value(TIMER.timerawl().as_ptr() as u32);
    stamp.write_addr().write_value(stamps);
    stamp.trans_count().write_value(1);
    let mut ring = CtrlTrig(0);
    ring.set_en(true);
    ring.set_high_priority(true);
    ring.set_incr_write(true);
    ring.set_ring_sel(true);
    let mut control = ring;
    control.set_data_size(DataSize::SIZE_WORD);
    control.set_ring_size(log2 + 2);
    control.set_chain_to(BYTES as u8);
    control.set_treq_sel(TreqSel::PERMANENT);
    stamp.al1_ctrl().write_value(control.0);
    let mut control = ring;
    control.set_data_size(DataSize::SIZE_BYTE);
    control.set_ring_size(log2);
    control.set_chain_to(STAMPS as u8);
    control.set_treq_sel(TreqSel::UART1_RX);
    control.set_irq_quiet(true);
    byte.ctrl_trig().write_value(control);
    set_requests(|w| w.set_rxdmae(true));
}

/// Stops the DMA into the ring. The UART keeps further bytes.
pub(crate) fn stop_receiving() {
    set_requests(|w| w.set_rxdmae(false));
    // The DMA completes the byte that it has fetched.
    cortex_m::asm::delay(STAMP_CYCLES);
    set_byte_interrupt(false);
    abort(&[BYTES, STAMPS]);
}

/// The address after the last stamp.
pub(crate) fn next_stamp() -> u32 {
    DMA.ch(STAMPS).write_addr().read()
}

/// Stops channels, which have no more access to memory then (2.5.5.3). Their interrupts are disabled, and each chains to
/// itself, which is none: an abort may raise an interrupt and start the next channel (RP2040-E13).
fn abort(channels: &[usize]) {
    for &channel in channels {
        let mut control = CtrlTrig(0);
        control.set_chain_to(channel as u8);
        DMA.ch(channel).al1_ctrl().write_value(control.0);
    }
    let bits = channels.iter().fold(0, |bits, channel| bits | 1 << channel);
    DMA.chan_abort().write(|w| w.set_chan_abort(bits));
    while DMA.chan_abort().read().chan_abort() & bits != 0 {}
    DMA.intr(0).write_value(bits.into());
}

/// Changes the DMA requests.
fn set_requests(change: impl FnOnce(&mut embassy_rp::pac::uart::regs::Uartdmacr)) {
    critical_section::with(|_| UART1.uartdmacr().modify(change));
}

/// Enables or disables the interrupt for each byte.
pub(crate) fn set_byte_interrupt(on: bool) {
    DMA.inte(0).write_value(if on { 1 << STAMPS } else { 0 });
}

/// Clears the interrupt for each byte.
pub(crate) fn clear_received() {
    DMA.ints(0).write_value(1 << STAMPS);
}

/// Enables or disables the transmit DMA requests.
pub(crate) fn set_transmit_requests(on: bool) {
    set_requests(|w| w.set_txdmae(on));
}

/// Returns true if the transmit DMA requests are enabled.
pub(crate) fn has_transmit_requests() -> bool {
    UART1.uartdmacr().read().txdmae()
}

/// Clears the interrupt of the transmit DMA.
pub(crate) fn clear_sent() {
    DMA.ints(1).write_value(1 << SENT);
}

/// Does nothing: [`Usart::is_transmitted`] is a state.
pub(crate) fn clear_transmitted() {}

/// Drives the TX pin high, independent of the UART.
pub(crate) fn hold_tx_high() {
    SIO.gpio_out(0).value_set().write_value(1 << TX);
    SIO.gpio_oe(0).value_set().write_value(1 << TX);
    set_function(Gpio0ctrlFuncsel::SIO_0);
}

/// Returns the TX pin to the UART.
pub(crate) fn release_tx() {
    // The functions of all pins have the same numbers: that of UART0 and UART1, too.
    set_function(Gpio0ctrlFuncsel::UART0_TX);
}

fn set_function(function: Gpio0ctrlFuncsel) {
    critical_section::with(|_| IO_BANK0.gpio(TX).ctrl().modify(|w| w.set_funcsel(function.to_bits())));
}

/// Lets the TX pin drive the wire, or not.
fn drive_tx(on: bool) {
    let over = match on {
        true => Oeover::NORMAL,
        false => Oeover::DISABLE,
    };
    critical_section::with(|_| IO_BANK0.gpio(TX).ctrl().modify(|w| w.set_oeover(over)));
}

/// The arm's UART: its registers, and what these do not show.
pub(crate) struct Usart {
    /// Time of a byte on the line in microseconds, rounded down.
    byte_micros: AtomicU32,
    /// One wire for both directions.
    is_half_duplex: AtomicBool,
    /// The DMA has handed over the last byte of a burst.
    is_ending: AtomicBool,
    /// The length of the burst.
    len: AtomicU32,
}

impl Usart {
    pub(crate) const fn new() -> Self {
        Self {
            byte_micros: AtomicU32::new(10),
            is_half_duplex: AtomicBool::new(false),
            is_ending: AtomicBool::new(false),
            len: AtomicU32::new(0),
        }
    }

    /// Enables the UART and the interrupt for errors.
    pub(super) fn start(&self) {
        PADS_BANK0.gpio(RX).modify(|w| {
            // Without an arm the line must look idle.
            w.set_pue(true);
            w.set_pde(false);
            w.set_ie(true);
        });
        IO_BANK0
            .gpio(RX)
            .ctrl()
            .write(|w| w.set_funcsel(Gpio0ctrlFuncsel::UART0_TX.to_bits()));
        self.enable(START);
        UART1.uartimsc().write(|w| {
            w.set_feim(true);
            w.set_peim(true);
            w.set_beim(true);
            w.set_oeim(true);
        });
        release_tx();
    }

    /// Disables the UART, which completes the byte that it is sending or receiving (4.2.8, UARTCR). Its FIFOs keep their
    /// bytes.
    pub(crate) fn disable(&self) {
        UART1.uartcr().write(|_| {});
    }

    /// Enables the disabled UART with a line coding.
    pub(crate) fn enable(&self, coding: LineCoding) {
        critical_section::with(|_| {
            // Divisor in 64ths (4.2.7.1), rounded.
            let divisor = (u64::from(clk_peri_freq()) * 8 / u64::from(coding.baud)).div_ceil(2) as u32;
            UART1.uartibrd().write(|w| w.set_baud_divint((divisor >> 6) as u16));
            UART1.uartfbrd().write(|w| w.set_baud_divfrac((divisor & 0x3F) as u8));
            UART1.uartlcr_h().write(|w| {
                w.set_wlen(0b11);
                w.set_fen(true);
                w.set_pen(coding.parity != Parity::None);
                w.set_eps(coding.parity == Parity::Even);
                w.set_stp2(coding.stop_bits == StopBits::Two);
            });
            UART1.uartcr().write(|w| {
                w.set_uarten(true);
                w.set_txe(true);
                w.set_rxe(true);
            });
        });
    }

    /// [`line_time`](Self::line_time) is that of this coding from now on.
    pub(crate) fn set_byte_time(&self, coding: LineCoding) {
        self.byte_micros.store(coding.micros(1) as u32, Ordering::Relaxed);
    }

    /// Time of this number of bytes on the line. That of one is rounded down to a microsecond.
    pub(crate) fn line_time(&self, bytes: u32) -> Duration {
        Duration::from_micros(u64::from(self.byte_micros.load(Ordering::Relaxed)) * u64::from(bytes))
    }

    /// Starts the transmit DMA, which must have stopped. `bytes` must stay unchanged until it has.
    pub(crate) fn start_sending(&self, bytes: &[u8]) {
        self.is_ending.store(false, Ordering::Relaxed);
        self.len.store(bytes.len() as u32, Ordering::Relaxed);
        let channel = DMA.ch(SENT);
        channel.read_addr().write_value(bytes.as_ptr() as u32);
        channel.write_addr().write_value(UART1.uartdr().as_ptr() as u32);
        channel.trans_count().write_value(bytes.len() as u32);
        // An abort may have raised it after its end (RP2040-E13).
        clear_sent();
        DMA.inte(1).write_value(1 << SENT);
        // The bytes are written before the DMA reads them.
        fence(Ordering::Release);
        channel.ctrl_trig().write(|w| {
            w.set_en(true);
            w.set_data_size(DataSize::SIZE_BYTE);
            w.set_incr_read(true);
            w.set_chain_to(SENT as u8);
            w.set_treq_sel(TreqSel::UART1_TX);
        });
    }

    /// Stops the transmit DMA. Bytes in the FIFO still go out.
    pub(crate) fn stop_sending(&self) {
        DMA.inte(1).write_value(0);
        abort(&[SENT]);
        // Their number is unknown: the alarm looks from now on.
        self.len.store(0, Ordering::Relaxed);
    }

    /// Returns true: the FIFO has bytes when the DMA ends.
    pub(crate) fn sends_after_dma(&self) -> bool {
        true
    }

    /// Waits for the end of the burst with the alarm. False stops waiting.
    pub(crate) fn set_transmitted_interrupt(&self, on: bool) {
        self.is_ending.store(on, Ordering::Relaxed);
        if on {
            let in_fifo = self.len.load(Ordering::Relaxed).min(FIFO);
            set_end_alarm(now() + self.line_time(in_fifo.saturating_sub(1)));
        }
    }

    /// Returns true between the end of the transmit DMA and that of the burst.
    pub(crate) fn is_waiting_for_end(&self) -> bool {
        self.is_ending.load(Ordering::Relaxed)
    }

    /// Returns true when the last byte of a burst is on the line; on one wire, when it was sent.
    pub(crate) fn has_burst_ended(&self) -> bool {
        let flags = UART1.uartfr().read();
        match self.is_half_duplex() {
            true => !flags.busy(),
            false => flags.txfe(),
        }
    }

    /// Returns true if the last bit has been sent.
    pub(crate) fn is_transmitted(&self) -> bool {
        !UART1.uartfr().read().busy()
    }

    /// Selects one wire for both directions, or two. Call this only on an idle line.
    ///
    /// The UART has no such mode. The wire is connected to both pins, and the TX pin drives it only while bytes go out.
    pub(crate) fn set_half_duplex(&self, on: bool) {
        self.is_half_duplex.store(on, Ordering::Relaxed);
        // The wire floats between bytes: a pull-up keeps it high.
        PADS_BANK0.gpio(TX).modify(|w| {
            w.set_pue(on);
            w.set_pde(false);
        });
        drive_tx(!on);
    }

    /// Returns true if one wire is selected: see [`set_half_duplex`](Self::set_half_duplex).
    pub(crate) fn is_half_duplex(&self) -> bool {
        self.is_half_duplex.load(Ordering::Relaxed)
    }

    /// Switches the receiver on or off. On one wire the TX pin drives it meanwhile.
    pub(crate) fn set_receiver(&self, on: bool) {
        critical_section::with(|_| UART1.uartcr().modify(|w| w.set_rxe(on)));
        drive_tx(!on || !self.is_half_duplex());
    }
}
