//! `memcpy` for the Cortex-M4.
//!
//! Most copies have 7 to 64 bytes at odd addresses. The one of `compiler_builtins` moves the bytes of such a copy one by
//! one or assembles words from them. This core loads and stores words at any address in RAM and flash (PM0214 section
//! 3.3.5). The symbols of `compiler_builtins` are weak: these replace them.

use core::arch::global_asm;

global_asm!(
    ".section .text.memcpy,\"ax\",%progbits",
    ".global memcpy, __aeabi_memcpy, __aeabi_memcpy4, __aeabi_memcpy8",
    ".type memcpy,%function",
    ".type __aeabi_memcpy,%function",
    ".type __aeabi_memcpy4,%function",
    ".type __aeabi_memcpy8,%function",
    "memcpy:",
    "__aeabi_memcpy:",
    "__aeabi_memcpy4:",
    "__aeabi_memcpy8:",
    // The result is the target address. It stays in r0, and r12 runs.
    "    mov r12, r0",
    "    subs r2, #16",
    "    blo 2f",
    "    push {{r4}}",
    // 16 bytes at a time.
    "1:  ldr r3, [r1]",
    "    ldr r4, [r1, #4]",
    "    str r3, [r12]",
    "    str r4, [r12, #4]",
    "    ldr r3, [r1, #8]",
    "    ldr r4, [r1, #12]",
    "    str r3, [r12, #8]",
    "    str r4, [r12, #12]",
    "    adds r1, #16",
    "    add r12, #16",
    "    subs r2, #16",
    "    bhs 1b",
    "    pop {{r4}}",
    // Up to 15 bytes are left. Their number is in the low four bits of r2.
    "2:  lsls r3, r2, #29",
    "    bcc 3f",
    "    ldr r3, [r1], #4",
    "    str r3, [r12], #4",
    "    ldr r3, [r1], #4",
    "    str r3, [r12], #4",
    "3:  lsls r3, r2, #30",
    "    bcc 4f",
    "    ldr r3, [r1], #4",
    "    str r3, [r12], #4",
    "4:  lsls r2, r2, #31",
    "    bcc 5f",
    "    ldrh r3, [r1], #2",
    "    strh r3, [r12], #2",
    "5:  bpl 6f",
    "    ldrb r3, [r1]",
    "    strb r3, [r12]",
    "6:  bx lr",
    ".size memcpy, . - memcpy",
);
