//! The public entry points of decoder, client, device and adapter, each a function of its own with a name to read.
//!
//! `cargo xtask stack` links it and adds up, from the machine code, what each takes of the stack at worst. It is not run.
//!
//! What an entry point returns lies on its caller's stack, and so does what it is given by value and does not fit in
//! registers: neither is counted.
#![no_std]
#![no_main]

mod protocol;

use core::panic::PanicInfo;

#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    loop {}
}
