//! The panic handler of the static library. No function leads to it: `cargo xtask c` checks that.

use core::panic::PanicInfo;

#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    armwire_panicked()
}

/// Stops here for ever. A symbol that can be looked for in a linked program.
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
