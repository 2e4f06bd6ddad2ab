//! The handler of hard faults, for example an access to unmapped memory or a stack overflow: counts the fault and
//! restarts the chip.

use cortex_m_rt::exception;

use crate::{board, restart};

/// Without a trampoline, and without a log: the stack may be invalid. The next start logs the count.
#[exception(trampoline = false)]
unsafe fn HardFault() -> ! {
    restart::faulted();
    board::reset()
}
