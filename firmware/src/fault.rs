//! What happens at a hard fault, such as an access to nothing or a stack that overflowed: it is counted, and the chip starts
//! again.

use cortex_m_rt::exception;

use crate::restart;

/// Without a trampoline, which would use a stack that may be gone.
#[exception(trampoline = false)]
unsafe fn HardFault() -> ! {
    restart::faulted();
    restart::restart()
}
