//! The state of the arm's UART: what its interrupt handlers share with the service and the tasks.
//!
//! | Part | Written by |
//! |---|---|
//! | [`Usart`] | the functions of the registers |
//! | [`Rx`] | the handlers; the service takes what they report |
//! | [`Interrupt`] | the handlers of received bytes, and a start of their DMA |
//! | [`Tx`] | the service begins a burst, and the handlers end it |
//!
//! The memory that the DMA writes is separate: its alignment would pad the state.

use core::cell::{Cell, RefCell};
// Loads and stores only: on the RP2040 those of `portable_atomic` take a critical section each.
use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use armwire_bridge::{RxRing, UartConfig, UartErrors};
use critical_section::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;

#[cfg(feature = "board-rp2040")]
use super::rp2040::interrupt::Interrupt;
#[cfg(feature = "stm32")]
use super::stm32::interrupt::Interrupt;
use crate::board::usart::Usart;
use crate::pend::pend;

/// Size of the receive ring in bytes. Half of it may be unread: 2.5 ms at 2 Mbaud.
pub(super) const SIZE: usize = 1024;

/// Number of bytes in a word of the ring.
pub(super) const WORD: usize = size_of::<u32>();

/// The state of the arm's UART.
pub(crate) static STATE: State = State {
    usart: Usart::new(),
    rx: Rx {
        ring: Mutex::new(RefCell::new(RxRing::new())),
        errors: Mutex::new(Cell::new(None)),
        has_overrun: portable_atomic::AtomicBool::new(false),
        has_event: portable_atomic::AtomicBool::new(false),
    },
    interrupt: Interrupt::new(),
    tx: Tx {
        is_sending: AtomicBool::new(false),
        change: Signal::new(),
    },
};

/// The bytes of the receive ring, written by the DMA.
pub(super) static BYTES: Bytes = Bytes([const { AtomicU32::new(0) }; SIZE / WORD]);

/// The bytes of a ring, which are read by words. The DMA of the RP2040 wraps at an address that is a multiple of its size.
#[cfg_attr(feature = "board-rp2040", repr(align(1024)))]
pub(super) struct Bytes([AtomicU32; SIZE / WORD]);

/// See the [module](self).
pub(crate) struct State {
    /// The registers.
    pub(crate) usart: Usart,
    /// The receiving half.
    pub(super) rx: Rx,
    /// The handlers of received bytes.
    pub(super) interrupt: Interrupt,
    /// The transmitting half.
    pub(super) tx: Tx,
}

/// The receiving half: what the handlers report to the service.
pub(super) struct Rx {
    /// The positions in the ring, and the events there.
    ring: Mutex<RefCell<RxRing<SIZE>>>,
    /// The errors that the bridge does not know yet.
    errors: Mutex<Cell<Option<UartErrors>>>,
    /// Unread bytes were overwritten.
    has_overrun: portable_atomic::AtomicBool,
    /// The service must read the ring.
    has_event: portable_atomic::AtomicBool,
}

/// The transmitting half.
pub(super) struct Tx {
    /// A burst is going out.
    is_sending: AtomicBool,
    /// The configuration to change to. Nothing is sent until the change is done.
    pub(super) change: Signal<CriticalSectionRawMutex, UartConfig>,
}

/// Makes the service read the ring.
pub(crate) fn wake() {
    STATE.rx.has_event.store(true, Ordering::Relaxed);
    pend();
}

/// Returns true if the service must read the ring. It reads for no other reason: after a read inside a frame, each further
/// threshold up to its end needs the service in time, or the frame has no stamp.
pub(crate) fn take_event() -> bool {
    STATE.rx.has_event.swap(false, Ordering::Relaxed)
}

impl Bytes {
    /// The address of the first byte, for the DMA.
    pub(super) fn address(&self) -> *mut u8 {
        self.0.as_ptr().cast::<u8>().cast_mut()
    }
}

/// The word with the byte at a position in the ring.
pub(super) fn word_at(position: usize) -> [u8; WORD] {
    let word = &BYTES.0[position / WORD % BYTES.0.len()];
    word.load(Ordering::Relaxed).to_le_bytes()
}

/// The byte at a position in the ring.
pub(super) fn byte_at(position: usize) -> u8 {
    word_at(position)[position % WORD]
}

impl Rx {
    /// Calls the ring. Interrupt handlers wait meanwhile.
    pub(super) fn ring<R>(&self, f: impl FnOnce(&mut RxRing<SIZE>) -> R) -> R {
        critical_section::with(|cs| f(&mut self.ring.borrow_ref_mut(cs)))
    }

    /// Counts errors, which are reported to the bridge with the next bytes.
    pub(super) fn count_errors(&self, count: impl FnOnce(&mut UartErrors)) {
        critical_section::with(|cs| {
            let mut errors = self.errors.borrow(cs).get().unwrap_or_default();
            count(&mut errors);
            self.errors.borrow(cs).set(Some(errors));
        });
    }

    /// The errors since the last call.
    pub(super) fn take_errors(&self) -> Option<UartErrors> {
        critical_section::with(|cs| self.errors.borrow(cs).take())
    }

    /// Unread bytes were overwritten. The service drops all of them.
    pub(super) fn overrun(&self) {
        self.has_overrun.store(true, Ordering::Relaxed);
        wake();
    }

    /// Returns true if unread bytes were overwritten since the last call.
    pub(super) fn take_overrun(&self) -> bool {
        self.has_overrun.swap(false, Ordering::Relaxed)
    }
}

impl Tx {
    /// A burst goes out.
    pub(super) fn begin(&self) {
        self.is_sending.store(true, Ordering::Relaxed);
    }

    /// Returns true while a burst goes out.
    pub(super) fn is_sending(&self) -> bool {
        self.is_sending.load(Ordering::Relaxed)
    }

    /// The UART is ready for the next burst, which the service starts.
    pub(super) fn end(&self) {
        self.is_sending.store(false, Ordering::Relaxed);
        pend();
    }
}
