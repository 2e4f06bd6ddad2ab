//! The control port's messages.

use core::hint::black_box;

use armwire_bridge::Duration;
use armwire_bridge::control::{
    FromAdapter, FromHost, Histogram, MAX_MESSAGE, Message, Reader, Reply, Request, decode, encode, encode_cobs,
};

use crate::bytes::bytes;

pub(crate) fn call_all() {
    codec(FromHost {
        sequence: 0,
        request: Request::Identify,
    });
    codec(FromAdapter::Reply {
        sequence: 0,
        reply: Reply::Done,
    });

    let mut histogram = black_box(Histogram::default());
    black_box(&mut histogram).add(black_box(Duration::ZERO));
    black_box(Histogram::limit(black_box(0)));
}

fn codec<T: Message>(message: T) {
    let message = black_box(message);
    black_box(encode(&message, bytes(&mut [0; 300])).is_ok());
    black_box(encode_cobs(&message, bytes(&mut [0; 300])).is_ok());
    black_box(decode::<T>(bytes(&mut [0; 300])).is_ok());
    black_box(T::sequence(bytes(&mut [0; 300])));

    let mut reader = Reader::<MAX_MESSAGE>::new();
    let reader = black_box(&mut reader);
    black_box(reader.push(bytes(&mut [0; 300])));
    black_box(black_box(&mut *reader).next::<T>().is_some());
    black_box(&mut *reader).clear();
}
