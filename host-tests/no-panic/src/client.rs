//! The host's side.

use core::hint::black_box;

use armwire::{Client, Config, Input, Micros, Protocol};

use crate::bytes;

pub(crate) fn call_all<P: Protocol, const N: usize>(request: P::Request, response: P::Response) {
    let request = black_box(request);
    let now = black_box(Micros(0));

    let mut client = Client::<P, N>::new(black_box(Config::DEFAULT));
    let client = black_box(&mut client);
    black_box(client.submit(request).is_ok());
    black_box(black_box(&mut *client).poll_transmit(now));
    let _ = black_box(&mut *client).transmitted(now, black_box(0));
    black_box(black_box(&*client).poll_timeout());
    black_box(black_box(&*client).is_idle());
    hear(client);
    black_box(&mut *client).cancel(now);

    black_box(P::encode_request(&request, bytes(&mut [0; 300])).is_ok());
    black_box(P::expect(Some(&request)));
    black_box(P::reply(&request));
    black_box(P::answers(&request, &P::response_ref(&black_box(response))));
    black_box(P::repeatable(&request));
}

/// Lets the client hear bytes, silence and time.
pub(crate) fn hear<P: Protocol, const N: usize>(client: &mut Client<P, N>) {
    let mut received = [0; 300];
    let inputs = [Input::Bytes(bytes(&mut received)), Input::Idle, Input::Tick];
    for mut input in black_box(inputs) {
        while let Some(event) = black_box(&mut *client).handle(black_box(Micros(0)), &mut input) {
            black_box(event);
        }
    }
}
