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

/// Panics if `index` is over 2.
#[cfg(feature = "prove-panic")]
#[unsafe(no_mangle)]
extern "C" fn armwire_prove_panic(index: usize) -> u8 {
    [1, 2, 3][index]
}
