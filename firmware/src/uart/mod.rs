//! The arm's UART: circular DMA for reception, DMA for transmission.
//!
//! The bridge gives the last byte of the next frame or, once known, the number of bytes before anything can be due. The
//! chip's part finds the byte that completes the frame, records the time of its arrival, and wakes the service.

mod change;
mod receive;
#[cfg(feature = "board-rp2040")]
mod rp2040;
#[cfg(feature = "stm32")]
mod stm32;
mod transmit;

use core::cell::{Cell, RefCell};
// Loads and stores only: on the RP2040 those of `portable_atomic` take a critical section each.
use core::sync::atomic::{AtomicU32, Ordering};

use armwire_bridge::{RxRing, UartErrors};
use critical_section::Mutex;
use portable_atomic::AtomicBool;

use crate::board::usart;
use crate::pend::pend;

#[cfg(feature = "board-rp2040")]
use rp2040 as chip;
#[cfg(feature = "stm32")]
use stm32 as chip;

pub(crate) use change::change;
#[cfg(feature = "stm32")]
pub(crate) use chip::SleepHandler;
pub(crate) use chip::{Dma, InterruptHandler, RingHandler, Uart};
#[cfg(feature = "board-rp2040")]
pub(crate) use chip::{IdleHandler, burst_ended, stall};
pub(crate) use receive::{Reader, wait};
pub(crate) use transmit::{Sender, SentHandler};

/// Size of the receive ring in bytes. Half of it may be unread: 2.5 ms at 2 Mbaud.
const SIZE: usize = 1024;

/// Number of bytes in a word of the ring.
const WORD: usize = size_of::<u32>();

/// The bytes of a ring, which are read by words. The DMA of the RP2040 wraps at an address that is a multiple of its size.
#[cfg_attr(feature = "board-rp2040", repr(align(1024)))]
struct Bytes([AtomicU32; SIZE / WORD]);

/// The bytes of the receive ring, written by the DMA.
static BYTES: Bytes = Bytes([const { AtomicU32::new(0) }; SIZE / WORD]);
/// The positions in it, and the events of the interrupt handlers.
static RING: Mutex<RefCell<RxRing<SIZE>>> = Mutex::new(RefCell::new(RxRing::new()));
/// Errors that were not reported to the bridge yet.
static ERRORS: Mutex<Cell<Option<UartErrors>>> = Mutex::new(Cell::new(None));
static RING_OVERRUN: AtomicBool = AtomicBool::new(false);
/// The service must read the ring.
static EVENT: AtomicBool = AtomicBool::new(false);

/// Makes the service read the ring.
pub(crate) fn wake() {
    EVENT.store(true, Ordering::Relaxed);
    pend();
}

/// Returns true if the service must read the ring. It reads for no other reason: after a read inside a frame, each further
/// threshold up to its end needs the service in time, or the frame has no stamp.
pub(crate) fn take_event() -> bool {
    EVENT.swap(false, Ordering::Relaxed)
}

/// The word with the byte at a position in the ring.
fn word_at(position: usize) -> [u8; WORD] {
    let word = &BYTES.0[position / WORD % BYTES.0.len()];
    word.load(Ordering::Relaxed).to_le_bytes()
}

/// The byte at a position in the ring.
fn byte_at(position: usize) -> u8 {
    word_at(position)[position % WORD]
}

/// The last bit of a burst was sent, or as much of it as the next burst waits for.
#[cold]
fn transmission_complete() {
    usart::set_receiver(true);
    usart::set_transmitted_interrupt(false);
    transmit::sent();
}

/// Calls the ring. Interrupt handlers wait meanwhile.
fn with_ring<R>(f: impl FnOnce(&mut RxRing<SIZE>) -> R) -> R {
    critical_section::with(|cs| f(&mut RING.borrow_ref_mut(cs)))
}
