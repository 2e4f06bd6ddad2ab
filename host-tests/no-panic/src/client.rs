//! The host's side.

use core::hint::black_box;

use armwire::messages::Messages;
use armwire::time::Instant;
use armwire::{Client, Config, Output};

use crate::bytes;

pub(crate) fn call_all<M: Messages + Copy, const N: usize>(
    messages: M,
    request: M::Request<'_>,
    response: M::Response<'_>,
    expect: M::Expect,
) {
    let messages = black_box(messages);
    let request = black_box(request);
    let expect = black_box(expect);
    let mut client = Client::<M, N>::new(messages, black_box(Config::DEFAULT));
    let client = black_box(&mut client);
    black_box(client.submit(&request).is_ok());
    drive(client);
    black_box(black_box(&*client).expects_answer());
    black_box(&mut *client).cancel();

    let mut out = [0; 300];
    let out = bytes(&mut out);
    black_box(messages.encode_request(&request, out).is_ok());
    messages.stamp(out, black_box(0));
    black_box(messages.parse_request(out).is_ok());
    let key = black_box(messages.request(out)).map(|info| info.key);
    black_box(messages.encode_response(&black_box(response), key, out).is_ok());
    black_box(messages.parse_response(out, expect).is_ok());
    if let Some(key) = key {
        black_box(messages.is_response_to(key, out));
    }
    black_box(messages.unsolicited());
}

/// Drives the client with bytes, silence and time, and handles its events.
pub(crate) fn drive<M: Messages, const N: usize>(client: &mut Client<M, N>) {
    let now = || black_box(Instant::ZERO);
    let mut received = [0; 300];
    black_box(client.receive(now(), bytes(&mut received)));
    black_box(client.space());
    black_box(black_box(&mut *client).received(now(), black_box(0)).is_ok());
    black_box(&mut *client).idle();
    for _ in 0..black_box(2) {
        let taken = match black_box(&mut *client).poll(now()) {
            Output::Transmit(bytes) => black_box(bytes).len(),
            output => {
                black_box(output);
                0
            }
        };
        black_box(client.transmitted(now(), black_box(taken)).is_ok());
    }
    black_box(black_box(&*client).is_idle());
    black_box(client.messages_mut());
    black_box(client.messages());
}
