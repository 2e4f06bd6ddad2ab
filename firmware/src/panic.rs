//! The panic handler: counts the panic and restarts the chip.
//!
//! A restart interrupts the adapter for a millisecond, a halt permanently. To inspect a panic, set a breakpoint on
//! `rust_begin_unwind`, or build with feature `defmt`.

use core::panic::PanicInfo;

use crate::restart;

#[cfg_attr(not(feature = "defmt"), allow(unused_variables))]
#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    cortex_m::interrupt::disable();
    #[cfg(feature = "defmt")]
    defmt::error!("{}", defmt::Display2Format(info));
    restart::panicked();
    restart::restart()
}
