//! The chip-specific registers of the arm's UART (RM0090 section 30.6) and of its DMA streams.

use core::sync::atomic::{AtomicBool, AtomicU32, Ordering, fence};

use embassy_stm32::interrupt::typelevel::Interrupt;
use embassy_stm32::pac;
use embassy_stm32::pac::dma::vals::Dir;
use embassy_stm32::pac::usart::regs::Sr;

use super::super::status::Status;
use super::{RX_STREAM, TX_REQUEST, TX_STREAM, UART, UartInterrupt};

/// PE, FE, NF, ORE and IDLE of SR.
const FLAGS: u32 = 0b1_1111;

/// Clears the flags of SR, which was read just before: reading SR and then DR clears them (RM0090 30.6.1).
///
/// While RXNE is set, the DMA must read DR, because the byte belongs to it. A byte that arrives between the two reads
/// would be lost for the DMA without notice. The reads are therefore a few cycles apart.
#[inline(always)]
fn clear_flags(sr: Sr) {
    if sr.0 & FLAGS != 0 && !sr.rxne() {
        UART.dr().read();
    }
}

/// The DMA's source for received bytes.
pub(crate) fn rx_data() -> *mut u8 {
    UART.dr().as_ptr().cast()
}

/// The number of bytes left in the DMA's pass over the receive ring.
pub(crate) fn rx_remaining() -> usize {
    pac::DMA1.st(RX_STREAM).ndtr().read().ndt().into()
}

/// Returns true if the DMA has passed both halves of the receive ring since its interrupt handler last ran. Call this
/// in the handler, before the flags are cleared.
pub(crate) fn rx_has_wrapped() -> bool {
    let flags = pac::DMA1.isr(RX_STREAM / 4).read();
    flags.htif(RX_STREAM % 4) && flags.tcif(RX_STREAM % 4)
}

/// Clears the interrupt of the transmit DMA.
pub(crate) fn clear_sent() {
    pac::DMA1.ifcr(TX_STREAM / 4).write(|w| {
        let stream = TX_STREAM % 4;
        w.set_tcif(stream, true);
        w.set_htif(stream, true);
        w.set_teif(stream, true);
        w.set_dmeif(stream, true);
        w.set_feif(stream, true);
    });
}

/// Makes [`Usart::is_transmitted`] refer to bytes sent from now on (RM0090 30.3.13).
pub(crate) fn clear_transmitted() {
    // Writing 1 leaves the other flags unchanged.
    UART.sr().write(|w| {
        w.0 = !0;
        w.set_tc(false);
    });
}

/// The arm's UART: its registers, and what these do not show.
pub(crate) struct Usart {
    /// The flags that the last read of SR showed.
    shown: AtomicU32,
    /// The flags from reads of SR that the interrupt handler has not processed.
    pending: AtomicU32,
    /// Bytes have a parity bit.
    has_parity: AtomicBool,
}

impl Usart {
    pub(crate) const fn new() -> Self {
        Self {
            shown: AtomicU32::new(0),
            pending: AtomicU32::new(0),
            has_parity: AtomicBool::new(false),
        }
    }

    /// Reads SR for other bits than its flags. The DMA's read of DR then clears a flag that this read returned (RM0090
    /// 30.6.1): the flags are passed on to the interrupt handler, which is triggered.
    fn read_status(&self) -> Sr {
        critical_section::with(|_| {
            let sr = UART.sr().read();
            self.keep_flags(sr);
            sr
        })
    }

    /// Keeps the flags of SR for the interrupt handler. Call this in the critical section of the read of SR.
    fn keep_flags(&self, sr: Sr) {
        let flags = sr.0 & FLAGS;
        let new = flags & !self.shown.load(Ordering::Relaxed);
        self.shown.store(flags, Ordering::Relaxed);
        if new != 0 {
            self.pending
                .store(self.pending.load(Ordering::Relaxed) | new, Ordering::Relaxed);
            UartInterrupt::pend();
        }
    }

    /// Reads and clears the UART's flags.
    ///
    /// A flag that is read while a byte waits stays set until the DMA has fetched that byte.
    pub(crate) fn take_status(&self) -> Status {
        let shown = critical_section::with(|_| {
            let sr = UART.sr().read();
            clear_flags(sr);
            self.shown.store(sr.0 & FLAGS, Ordering::Relaxed);
            let pending = self.pending.load(Ordering::Relaxed);
            self.pending.store(0, Ordering::Relaxed);
            Sr(sr.0 | pending)
        });
        Status {
            framing: shown.fe(),
            parity: shown.pe(),
            noise: shown.ne(),
            overrun: shown.ore(),
            idle: shown.idle(),
        }
    }

    /// Clears errors that remain after the DMA has fetched their byte: a byte received between the two reads breaks the
    /// sequence.
    pub(crate) fn clear_errors(&self) {
        critical_section::with(|_| {
            let sr = UART.sr().read();
            if !sr.rxne() {
                UART.dr().read();
            }
            self.keep_flags(sr);
        });
    }

    /// Keeps the parity error of the next byte. Call this in the interrupt handler, right after
    /// [`is_byte_waiting`](Self::is_byte_waiting) has returned false.
    ///
    /// After a read of SR, the DMA's next read or write of DR may clear a parity error that came in between, before the
    /// handler sees it (ES0182, "Parity Error (PE) flag can be cleared by writing to the data register"). A read of DR comes
    /// before the next byte.
    pub(crate) fn keep_parity_error(&self) {
        if self.must_keep_parity_errors() {
            UART.dr().read();
        }
    }

    /// Returns true if each byte needs [`keep_parity_error`](Self::keep_parity_error).
    pub(crate) fn must_keep_parity_errors(&self) -> bool {
        self.has_parity.load(Ordering::Relaxed)
    }

    /// Configures the disabled UART for one byte at a time. This UART has no FIFOs.
    pub(crate) fn configure_byte_mode(&self) {
        self.has_parity.store(UART.cr1().read().pce(), Ordering::Relaxed);
        // Tasks have read SR: see `keep_parity_error`.
        self.clear_errors();
    }

    /// Returns true if a byte waits for the DMA.
    pub(crate) fn is_byte_waiting(&self) -> bool {
        self.read_status().rxne()
    }

    /// Starts the transmit DMA, which must have stopped. `bytes` must stay unchanged until it has (RM0090 10.3.18).
    pub(crate) fn start_sending(&self, bytes: &[u8]) {
        clear_sent();
        let stream = pac::DMA1.st(TX_STREAM);
        stream.par().write_value(UART.dr().as_ptr() as u32);
        stream.m0ar().write_value(bytes.as_ptr() as u32);
        stream.ndtr().write(|w| w.set_ndt(bytes.len() as u16));
        stream.cr().write(|w| {
            w.set_chsel(TX_REQUEST);
            w.set_dir(Dir::MEMORY_TO_PERIPHERAL);
            w.set_minc(true);
            w.set_tcie(true);
        });
        // The bytes are written before the DMA reads them.
        fence(Ordering::Release);
        // Enabled last, in a store of its own (RM0090 10.3.17).
        stream.cr().modify(|w| w.set_en(true));
    }

    /// Stops the transmit DMA. Returns when it has no more access to the bytes.
    pub(crate) fn stop_sending(&self) {
        let stream = pac::DMA1.st(TX_STREAM);
        stream.cr().write(|w| w.set_en(false));
        while stream.cr().read().en() {}
        clear_sent();
    }

    /// Returns true if the last bit has been sent.
    pub(crate) fn is_transmitted(&self) -> bool {
        self.read_status().tc()
    }
}
