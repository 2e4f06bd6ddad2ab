//! The first instructions of the firmware.

use core::arch::global_asm;

// Runs before the memory is initialised: a handler of an interrupt that was left enabled would find none.
global_asm!(
    ".section .text.__pre_init,\"ax\",%progbits",
    ".global __pre_init",
    ".type __pre_init,%function",
    ".thumb_func",
    "__pre_init:",
    "cpsid i",
    "bx lr",
    ".size __pre_init, . - __pre_init",
);
