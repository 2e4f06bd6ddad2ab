//! The handler of hard faults, for example an access to unmapped memory or a stack overflow: counts the fault and
//! restarts the chip.

use core::arch::naked_asm;

use crate::{board, restart};

/// Takes a new stack, whatever was on the old one: that may be full, and a fault in this handler stops the core. It is
/// neither the runtime's trampoline nor Rust, which both begin with a push.
///
/// The core of an RP2040 stops before it gets here if its stack is full (ARMv6-M, B1.5.15). The watchdog then resets the
/// chip, and the start counts as its reset.
#[unsafe(naked)]
#[unsafe(no_mangle)]
unsafe extern "C" fn HardFault() -> ! {
    naked_asm!("ldr r0, =_stack_start", "mov sp, r0", "bl {}", sym restart_after_fault)
}

/// Logs nothing: the next start logs the count.
extern "C" fn restart_after_fault() -> ! {
    restart::faulted();
    board::reset()
}
