//! The cases on a bare Cortex-M, to be run in the emulator.
#![no_std]
#![no_main]

use core::panic::PanicInfo;

/// Then it stands still, which the emulator is told to look for.
#[cortex_m_rt::entry]
fn main() -> ! {
    armwire_counts::run();
    loop {
        core::hint::spin_loop();
    }
}

#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    loop {}
}
