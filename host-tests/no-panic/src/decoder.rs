//! The decoder, and the framing under it.

use core::hint::black_box;

use armwire::decoder::Decoder;
use armwire::framing::Framing;

use crate::bytes;

pub(crate) fn call_all<F: Framing, const N: usize>(framing: &F, expect: F::Expect) {
    let framing = black_box(framing);
    let mut decoder = Decoder::<N>::new();
    let decoder = black_box(&mut decoder);
    black_box(decoder.push(bytes(&mut [0; 300])));
    black_box(decoder.space());
    black_box(black_box(&mut *decoder).commit(black_box(0)).is_ok());
    black_box(black_box(&mut *decoder).next(framing, expect).is_some());
    if let Some(span) = black_box(&mut *decoder).advance(framing, expect) {
        black_box(black_box(&*decoder).item(black_box(span)));
        black_box((span.len(), span.is_empty()));
    }
    black_box(&mut *decoder).idle();
    black_box(black_box(&*decoder).need(framing, expect));
    let decoder = black_box(&*decoder);
    black_box((decoder.pending(), decoder.offset(), decoder.received()));
    black_box((decoder.window(), decoder.broken()));

    let mut window = [0; 300];
    let window = bytes(&mut window);
    black_box(framing.scan(window, expect));
    black_box(framing.scan_idle(window, expect));
    black_box((framing.terminator(expect), framing.shortest(expect)));
    black_box((framing.requests(), framing.unsolicited()));
}
