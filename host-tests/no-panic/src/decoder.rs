//! The decoder, and the framing under it.

use core::hint::black_box;

use armwire::{Decoder, Framing};

use crate::bytes;

pub(crate) fn call_all<F: Framing, const N: usize>(expect: F::Expect) {
    let mut decoder = Decoder::<F, N>::new();
    let decoder = black_box(&mut decoder);
    black_box(decoder.push(bytes(&mut [0; 300])));
    black_box(decoder.space());
    black_box(black_box(&mut *decoder).commit(black_box(0)).is_ok());
    black_box(black_box(&mut *decoder).next(expect).is_some());
    let mut line = [0; 300];
    let mut line = &*bytes(&mut line);
    black_box(black_box(&mut *decoder).decode(&mut line, expect).is_some());
    black_box(black_box(&mut *decoder).idle(expect));
    black_box(black_box(&*decoder).need(expect));
    black_box(black_box(&*decoder).pending());
    black_box(black_box(&*decoder).broken());

    let mut window = [0; 300];
    let window = bytes(&mut window);
    black_box(F::scan(window, expect));
    black_box(F::view(window).is_some());
}
