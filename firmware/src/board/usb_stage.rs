//! The events of USB, from the interrupt handlers to the driver.

use core::sync::atomic::AtomicBool;
use core::task::Waker;

use embassy_sync::waitqueue::AtomicWaker;
use embassy_time::{Duration, Instant};

/// A SETUP packet arrived since the last request was taken.
pub(super) static SETUP_ARRIVED: AtomicBool = AtomicBool::new(false);

/// The task that waits for the end of a stage.
static WAITING: AtomicWaker = AtomicWaker::new();

/// The duration of a 64-byte packet and its handshake on the wire, with a margin.
const PACKET_TIME: Duration = Duration::from_micros(60);

/// Registers the task that waits for a stage.
pub(super) fn wait_for_stage(waker: &Waker) {
    WAITING.register(waker);
}

/// Wakes the task that waits for a stage. The interrupt handler calls this.
pub(super) fn wake_stage() {
    WAITING.wake();
}

/// Waits for a condition that is met when a packet on the wire has ended. Returns false if that takes too long.
pub(super) fn soon(has_come: impl Fn() -> bool) -> bool {
    let start = Instant::now();
    loop {
        if has_come() {
            return true;
        }
        if start.elapsed() > PACKET_TIME {
            return false;
        }
    }
}
