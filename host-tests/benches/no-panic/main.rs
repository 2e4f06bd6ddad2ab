//! Links only if `armwire` and `armwire-bridge` have no path to a panic, and allocate nothing.
//!
//! It calls everything public of the two crates, with values and in states that are unknown to the compiler. The panic
//! handler calls a symbol that does not exist: if the optimiser leaves a path to it, the linker reports the symbol.
//! There is no allocator: the compiler refuses a program with the `alloc` crate.
//!
//! Three parts are excluded because their panics are not in the two crates: formatting, which panics in `core`; the async
//! driver, since every `async fn` panics if it is polled after its end; and the store, which is async and uses a crate
//! with assertions.
#![no_std]
#![no_main]

#[cfg(feature = "prove-alloc")]
extern crate alloc;

#[cfg(feature = "alpha1")]
mod alpha1;
#[cfg(feature = "bridge")]
mod bridge;
mod bytes;
#[cfg(feature = "bridge")]
mod control;
#[cfg(feature = "bridge")]
mod cyclic;
#[cfg(feature = "bridge")]
mod isotp;
#[cfg(feature = "ling-legacy")]
mod legacy;
#[cfg(feature = "ling")]
mod ling;
mod protocol;
#[cfg(feature = "bridge")]
mod slcan;
#[cfg(feature = "xarm")]
mod xarm;

use core::hint::black_box;
use core::panic::PanicInfo;

use armwire::time::{Duration, Instant};

unsafe extern "C" {
    /// Does not exist.
    safe fn a_path_to_a_panic_is_left() -> !;
}

#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    a_path_to_a_panic_is_left()
}

/// The root of the linker's search for used code.
#[unsafe(no_mangle)]
extern "C" fn _start() {
    #[cfg(feature = "ling")]
    ling::call_all();
    #[cfg(feature = "ling-legacy")]
    legacy::call_all();
    #[cfg(feature = "xarm")]
    xarm::call_all();
    #[cfg(feature = "alpha1")]
    alpha1::call_all();
    #[cfg(feature = "bridge")]
    {
        bridge::call_all();
        control::call_all();
        cyclic::call_all();
        isotp::call_all();
        slcan::call_all();
    }
    black_box(black_box(Instant::ZERO) + black_box(Duration::from_millis(black_box(0))));
    black_box(black_box(Instant::from_millis(black_box(0))) - black_box(Duration::ZERO));
    let duration = core::time::Duration::from(black_box(Duration::ZERO));
    black_box(Duration::try_from(black_box(duration)).is_ok());
    black_box(black_box(Instant::ZERO).since(black_box(Instant::ZERO)) + black_box(Duration::ZERO));
    if cfg!(feature = "prove-panic") {
        black_box([1, 2, 3][black_box(3)]);
    }
    #[cfg(feature = "prove-alloc")]
    black_box(alloc::boxed::Box::new(black_box(0)));
}
