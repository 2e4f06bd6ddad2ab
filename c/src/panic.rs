//! The panic handler of the static library. No function reaches it: `cargo xtask c` checks this.

use core::panic::PanicInfo;

#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    armwire_panicked()
}

/// Loops forever. The check searches a linked program for its symbol.
#[unsafe(no_mangle)]
#[inline(never)]
extern "C" fn armwire_panicked() -> ! {
    loop {
        core::hint::spin_loop();
    }
}

// The tables for unwinding in Rust's own libraries refer to it on 32-bit Arm under Linux. Nothing unwinds. A program with
// Rust's standard library has it.
#[cfg(all(target_arch = "arm", target_os = "linux"))]
core::arch::global_asm!(".weak rust_eh_personality", ".set rust_eh_personality, 0");

/// Panics if `index` is over 2.
#[cfg(feature = "prove-panic")]
#[unsafe(no_mangle)]
extern "C" fn armwire_prove_panic(index: usize) -> u8 {
    [1, 2, 3][index]
}
