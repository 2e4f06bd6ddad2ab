//! What the interrupt handlers of the UART share with the service and the tasks.

use core::cell::{Cell, RefCell};
// Loads and stores only: on the RP2040 those of `portable_atomic` take a critical section each.
use core::sync::atomic::{AtomicU32, Ordering};

use armwire_bridge::{RxRing, UartErrors};
use critical_section::Mutex;
use portable_atomic::AtomicBool;

use crate::pend::pend;

/// Size of the receive ring in bytes. Half of it may be unread: 2.5 ms at 2 Mbaud.
pub(super) const SIZE: usize = 1024;

/// Number of bytes in a word of the ring.
pub(super) const WORD: usize = size_of::<u32>();

/// The bytes of a ring, which are read by words. The DMA of the RP2040 wraps at an address that is a multiple of its size.
#[cfg_attr(feature = "board-rp2040", repr(align(1024)))]
pub(super) struct Bytes(pub(super) [AtomicU32; SIZE / WORD]);

/// The bytes of the receive ring, written by the DMA.
pub(super) static BYTES: Bytes = Bytes([const { AtomicU32::new(0) }; SIZE / WORD]);
/// The positions in it, and the events of the interrupt handlers.
static RING: Mutex<RefCell<RxRing<SIZE>>> = Mutex::new(RefCell::new(RxRing::new()));
/// Errors that were not reported to the bridge yet.
pub(super) static ERRORS: Mutex<Cell<Option<UartErrors>>> = Mutex::new(Cell::new(None));
pub(super) static RING_OVERRUN: AtomicBool = AtomicBool::new(false);
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
pub(super) fn word_at(position: usize) -> [u8; WORD] {
    let word = &BYTES.0[position / WORD % BYTES.0.len()];
    word.load(Ordering::Relaxed).to_le_bytes()
}

/// The byte at a position in the ring.
pub(super) fn byte_at(position: usize) -> u8 {
    word_at(position)[position % WORD]
}

/// Calls the ring. Interrupt handlers wait meanwhile.
pub(super) fn with_ring<R>(f: impl FnOnce(&mut RxRing<SIZE>) -> R) -> R {
    critical_section::with(|cs| f(&mut RING.borrow_ref_mut(cs)))
}
