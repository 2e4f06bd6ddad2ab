//! A program for a Cortex-M4 whose cases are counted from the outside: instructions, and bytes of stack.
//!
//! [`mark`] is called before and after each case, and after the last one. The first case is empty: what it takes, all take.
//! Each protocol then has four: a reply decoded that is in the decoder's space, a reply decoded byte by byte, the request
//! encoded, a whole call.
#![no_std]
#![no_main]

use core::hint::black_box;
use core::panic::PanicInfo;

#[cortex_m_rt::entry]
fn main() -> ! {
    count(&mut 0_u8, |_| true);
    #[cfg(feature = "ling")]
    protocol(&armwire_benches::LING);
    #[cfg(feature = "xarm")]
    protocol(&armwire_benches::xarm());
    #[cfg(feature = "alpha1")]
    protocol(&armwire_benches::ALPHA1);
    mark(0);
    panic!()
}

#[cfg(any(feature = "ling", feature = "xarm", feature = "alpha1"))]
fn protocol<M: armwire::messages::Messages + Copy, const N: usize>(arm: &armwire_benches::Arm<M, N>) {
    let arm = black_box(arm);
    let decoder = &mut arm.decoder();
    arm.fill(decoder);
    count(decoder, |decoder| arm.reply(decoder));
    count(decoder, |decoder| arm.stream(decoder, black_box(arm.reply), 1) == 1);
    count(&mut [0; N], |room| arm.encode(room) > 0);
    count(&mut arm.client(), |client| arm.call(client));
}

/// Runs a case on its state. The case must succeed for its count to be valid.
fn count<S>(state: &mut S, case: impl FnOnce(&mut S) -> bool) {
    mark(size_of::<S>());
    let good = run(black_box(state), case);
    mark(size_of::<S>());
    assert!(black_box(good));
}

#[inline(never)]
fn run<S>(state: &mut S, case: impl FnOnce(&mut S) -> bool) -> bool {
    black_box(case(state))
}

/// Marks the start or end of a case with this state size in bytes. Zero marks the end of all cases.
#[unsafe(no_mangle)]
#[inline(never)]
extern "C" fn mark(state: usize) {
    black_box(state);
}

#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    loop {
        black_box(());
    }
}
