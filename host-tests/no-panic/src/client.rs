//! The host's side.

use core::hint::black_box;

use armwire::ling::{Ling, MAX_FRAME, Request};
use armwire::{Client, Config, Input, Micros, Protocol};

use crate::bytes;

pub(crate) fn call_all() {
    let request = black_box(Request::SelfCheck);
    let now = black_box(Micros(0));

    let mut client = Client::<Ling, MAX_FRAME>::new(black_box(Config::DEFAULT));
    let client = black_box(&mut client);
    let _ = black_box(client.submit(request));
    black_box(black_box(&mut *client).poll_transmit(now));
    black_box(&mut *client).transmitted(now, black_box(0));
    black_box(black_box(&*client).poll_timeout());
    black_box(black_box(&*client).is_idle());
    let mut received = [0; 300];
    let inputs = [Input::Bytes(bytes(&mut received)), Input::Idle, Input::Tick];
    for mut input in black_box(inputs) {
        while let Some(event) = black_box(&mut *client).handle(now, &mut input) {
            black_box(event);
        }
    }
    black_box(&mut *client).cancel(now);

    let _ = black_box(Ling::encode_request(&request, bytes(&mut [0; 300])));
    black_box(Ling::reply(&request));
    black_box(Ling::repeatable(&request));
}
