//! The state that the handlers of received bytes keep from one to the next.

use core::cell::Cell;

use critical_section::Mutex;
use portable_atomic::{AtomicBool, AtomicU32};

use crate::board::usart::Status;

pub(in crate::uart) struct Interrupt {
    /// Errors already counted for a byte that the DMA did not fetch in time, and the byte's future position in the ring.
    pub(super) counted: Mutex<Cell<Option<(usize, Status)>>>,
    /// The duration of a byte, in microseconds, rounded down.
    pub(super) byte_time: AtomicU32,
    /// The interrupt for each byte is off until the timer enables it.
    pub(super) is_asleep: AtomicBool,
}

impl Interrupt {
    pub(in crate::uart) const fn new() -> Self {
        Self {
            counted: Mutex::new(Cell::new(None)),
            byte_time: AtomicU32::new(0),
            is_asleep: AtomicBool::new(false),
        }
    }
}
