//! The panic handler: counts the panic and restarts the chip.
//!
//! A restart interrupts the adapter for a millisecond, a halt permanently. To inspect a panic, set a breakpoint on
//! `rust_begin_unwind`, or build with feature `defmt`.

use core::panic::PanicInfo;

#[cfg(feature = "defmt")]
use portable_atomic::{AtomicBool, Ordering};

#[cfg(feature = "defmt")]
use crate::board;
use crate::restart;

#[cfg_attr(not(feature = "defmt"), allow(unused_variables))]
#[cfg_attr(target_os = "none", panic_handler)]
#[cfg_attr(not(target_os = "none"), expect(dead_code))]
fn panic(info: &PanicInfo<'_>) -> ! {
    cortex_m::interrupt::disable();
    restart::panicked();
    #[cfg(feature = "defmt")]
    log(info);
    restart::restart()
}

/// Logs the panic, unless the log itself panicked.
#[cfg(feature = "defmt")]
fn log(info: &PanicInfo<'_>) {
    static IS_LOGGING: AtomicBool = AtomicBool::new(false);
    if IS_LOGGING.swap(true, Ordering::Relaxed) {
        board::reset();
    }
    if let Some(place) = info.location() {
        defmt::error!(
            "panicked at {=str}:{=u32}:{=u32}",
            place.file(),
            place.line(),
            place.column()
        );
    }
}
