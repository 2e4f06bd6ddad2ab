//! What happens when the firmware finds itself broken: it is counted, and the chip starts again.
//!
//! An arm that lost its adapter for a millisecond is better off than one that lost it for good. To see a panic happen,
//! set a breakpoint on `rust_begin_unwind`, or build with feature `defmt`.

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
