//! The decoder, and the framing under it.

use core::hint::black_box;

use armwire::ling::{Frame, Ling, MAX_FRAME, checksum};
use armwire::{Decoder, Framing};

use crate::bytes;

pub(crate) fn call_all() {
    let mut decoder = Decoder::<Ling, MAX_FRAME>::new();
    let decoder = black_box(&mut decoder);
    black_box(decoder.push(bytes(&mut [0; 300])));
    black_box(decoder.space());
    black_box(&mut *decoder).commit(black_box(0));
    black_box(black_box(&mut *decoder).next(()));
    black_box(black_box(&mut *decoder).idle(()));
    black_box(black_box(&*decoder).need(()));
    black_box(black_box(&*decoder).pending());

    let mut window = [0; 300];
    let window = bytes(&mut window);
    black_box(Ling::scan(window, ()));
    black_box(Ling::view(window));
    black_box(checksum(window));
    let frame = Frame {
        command: black_box(0),
        function: black_box(0),
        data: window,
    };
    black_box(frame.encode(bytes(&mut [0; 300])).is_ok());
}
