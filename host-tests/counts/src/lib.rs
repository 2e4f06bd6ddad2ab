//! What is counted: one function for each case, with a name for the linker that begins with `count_`.
//!
//! [`run`] calls each once and calls [`done`] after it. From the outside, by callgrind or by the emulator, one
//! sees when a case begins and when it is done, and so how many instructions it took. What `count_nothing` takes is taken
//! off the others.
#![no_std]
#![cfg(all(feature = "ling", feature = "xarm", feature = "alpha1"))]

mod alpha1;
mod ling;
mod xarm;

use armwire::{Decoder, Framing};

/// How many frames a clean stream has, and how they come.
const FRAMES: usize = 64;
const CHUNK: usize = 64;

/// How many bytes a hostile stream has.
const HOSTILE: usize = 1400;

/// Runs every case.
pub fn run() {
    ends(count_nothing(&[], 0), &0);
    ling::run();
    xarm::run();
    alpha1::run();
}

#[unsafe(no_mangle)]
#[inline(never)]
fn count_nothing(_: &[u8], result: u32) -> u32 {
    core::hint::black_box(result)
}

/// A case is done.
#[unsafe(no_mangle)]
#[inline(never)]
extern "C" fn done() {
    core::hint::black_box(());
}

/// Ends a case. What comes out of it must be right, or its count means nothing.
#[inline(always)]
fn ends<T: PartialEq>(result: T, expected: &T) {
    done();
    assert!(result == *expected, "a case came to another result");
}

/// Hands in bytes as they come, and takes out what comes of them: frames, and bytes of noise.
fn decode<F: Framing, const N: usize>(
    decoder: &mut Decoder<F, N>,
    expect: F::Expect,
    line: &[u8],
    chunk: usize,
) -> [usize; 2] {
    let [mut frames, mut noise] = [0, 0];
    for mut bytes in line.chunks(chunk) {
        while let Some(next) = decoder.decode(&mut bytes, expect) {
            match next {
                Ok(_) => frames += 1,
                Err(dropped) => noise += dropped.len,
            }
        }
    }
    [frames, noise]
}

/// A pattern again and again.
const fn repeated<const N: usize>(pattern: &[u8]) -> [u8; N] {
    let mut bytes = [0; N];
    let mut i = 0;
    while i < N {
        bytes[i] = pattern[i % pattern.len()];
        i += 1;
    }
    bytes
}
