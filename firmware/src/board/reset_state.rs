//! The reset state of the core. A boot loader, a debugger or another firmware may start this one by a jump.

use cortex_m::peripheral::{NVIC, SCB, SYST};

use crate::board::INTERRUPTS;

/// Pending bits of SysTick and of PendSV in ICSR (ARMv7-M, B3.2.4; ARMv6-M, B3.2.4).
const PENDSTCLR: u32 = 1 << 25;
const PENDSVCLR: u32 = 1 << 27;

/// Turns off the interrupts that another program has left on, and lets the core take interrupts.
pub(super) fn reset_core() {
    const WORDS: usize = INTERRUPTS.div_ceil(32);
    // SAFETY: nothing else uses these registers yet.
    unsafe {
        (*SYST::PTR).csr.write(0);
        (*SCB::PTR).icsr.write(PENDSTCLR | PENDSVCLR);
        for word in 0..WORDS {
            (*NVIC::PTR).icer[word].write(u32::MAX);
            (*NVIC::PTR).icpr[word].write(u32::MAX);
        }
        cortex_m::asm::dsb();
        cortex_m::asm::isb();
        cortex_m::interrupt::enable();
    }
}
