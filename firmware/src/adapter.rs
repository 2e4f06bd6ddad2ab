//! What the tasks share: the bridge, and signals that say where there may be something to do.

use core::cell::RefCell;

use armwire::Micros;
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::signal::Signal;
use embassy_time::Instant;

/// Bytes from the arm that wait for the host: 20 ms of a saturated 1 Mbaud line.
const UP: usize = 2048;

/// Bytes from the host that wait for the arm: enough to keep a 2 Mbaud line busy while USB brings more.
const DOWN: usize = 512;

/// The bridge between USB and UART.
pub(crate) type Bridge = armwire_bridge::Bridge<UP, DOWN>;

/// The bridge and its signals. All tasks run on one executor, so nothing here needs an interrupt lock.
pub(crate) struct Adapter {
    bridge: RefCell<Bridge>,
    /// A packet for the host may be due.
    pub(crate) packet: Signal<NoopRawMutex, ()>,
    /// A host came, went, opened or closed the port.
    pub(crate) session: Signal<NoopRawMutex, ()>,
    /// There may be bytes for the arm, or a new line coding.
    pub(crate) bytes: Signal<NoopRawMutex, ()>,
    /// There may be room for a packet from the host.
    pub(crate) room: Signal<NoopRawMutex, ()>,
}

impl Adapter {
    /// An adapter that no host has found yet.
    pub(crate) fn new() -> Self {
        Self {
            bridge: RefCell::new(Bridge::default()),
            packet: Signal::new(),
            session: Signal::new(),
            bytes: Signal::new(),
            room: Signal::new(),
        }
    }

    /// Calls `f` with the bridge.
    pub(crate) fn with<R>(&self, f: impl FnOnce(&mut Bridge) -> R) -> R {
        f(&mut self.bridge.borrow_mut())
    }
}

/// Now, by the microsecond timer.
pub(crate) fn now() -> Micros {
    Micros(Instant::now().as_micros())
}
