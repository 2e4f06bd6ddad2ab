//! The handler of hard faults, for example an access to unmapped memory or a stack overflow: counts the fault and
//! restarts the chip.

use cortex_m_rt::exception;

use crate::restart;

/// Without a trampoline, whose stack may be invalid.
#[exception(trampoline = false)]
unsafe fn HardFault() -> ! {
    restart::faulted();
    restart::restart()
}
