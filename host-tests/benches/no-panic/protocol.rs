//! Every layer of a protocol: framing, decoder, exchange, client and device.

use core::hint::black_box;

use armwire::correlation::Correlation;
use armwire::decoder::Decoder;
use armwire::exchange::{Exchange, FirstByte, Handover};
use armwire::messages::Messages;
use armwire::time::{Duration, Instant};
use armwire::{Client, Config, Device, DeviceEvent, Output};

use crate::bytes::bytes;

/// Calls all layers. `request` is `None` for a protocol without requests.
pub(crate) fn call_all<M: Messages + Copy, const N: usize>(
    messages: M,
    request: Option<M::Request<'_>>,
    response: M::Response<'_>,
    expect: M::Expect,
) {
    let messages = black_box(messages);
    let response = black_box(response);
    let expect = black_box(expect);
    call_correlation::<M, N>(&messages, expect);
    client::<M, N>(messages, black_box(request));
    device::<M, N>(messages, &response);

    let mut out = [0; 300];
    let out = bytes(&mut out);
    if let Some(request) = black_box(request) {
        black_box(messages.encode_request(&request, out).is_ok());
    }
    messages.stamp(out, black_box(0));
    black_box(messages.parse_request(out).is_ok());
    let key = black_box(messages.request(out)).map(|info| info.key);
    black_box(messages.encode_response(&response, key, out).is_ok());
    black_box((messages.parse_response(out, expect).is_ok(), messages.extra(out)));
    if let Some(key) = key {
        black_box(messages.is_response_to(key, out));
    }
    black_box((messages.is_request(out), messages.echoes()));
}

/// Calls the layers that need no messages.
pub(crate) fn call_correlation<D: Correlation, const N: usize>(correlation: &D, expect: D::Expect) {
    let correlation = black_box(correlation);
    framing(correlation, expect);
    decoder::<D, N>(correlation, expect);
    exchange(correlation);
}

fn framing<D: Correlation>(framing: &D, expect: D::Expect) {
    let mut window = [0; 300];
    let window = bytes(&mut window);
    black_box(framing.scan(window, expect));
    black_box(framing.scan_idle(window, expect));
    black_box((framing.terminator(expect), framing.shortest(expect)));
    black_box((framing.requests(), framing.unsolicited()));
}

fn decoder<D: Correlation, const N: usize>(framing: &D, expect: D::Expect) {
    let mut decoder = Decoder::<_, N>::new();
    let decoder = black_box(&mut decoder);
    black_box(decoder.push(bytes(&mut [0; 300])));
    black_box(decoder.space());
    black_box(black_box(&mut *decoder).commit(black_box(0)).is_ok());
    black_box(black_box(&mut *decoder).next(framing, expect).is_some());
    if let Some(span) = black_box(&mut *decoder).advance(framing, expect) {
        black_box(black_box(&*decoder).item(black_box(span)));
        black_box(black_box(&*decoder).candidate(black_box(span), framing, expect));
        black_box((span.len(), span.is_empty()));
    }
    black_box(&mut *decoder).idle();
    black_box(black_box(&*decoder).need(framing, expect));
    let decoder = black_box(&*decoder);
    black_box((
        decoder.pending(),
        decoder.offset(),
        decoder.received(),
        decoder.skipping(),
    ));
    black_box((decoder.window(), decoder.broken()));
}

fn exchange<D: Correlation>(correlation: &D) {
    let now = || black_box(Instant::ZERO);
    let who = || black_box(1_u8);
    let mut frame = [0; 300];
    let frame = bytes(&mut frame);
    let mut exchange = Exchange::<D, u8, 8>::new(black_box(Duration::ZERO));
    let exchange = black_box(&mut exchange);
    let handover = black_box(Handover {
        offset: 0,
        at: now(),
        due: now(),
    });
    if let Some(info) = correlation.request(frame) {
        black_box(exchange.can_send(&black_box(info), who()));
        exchange.begin(black_box(info), who(), handover);
        exchange.repeat(black_box(info), who(), handover);
    }
    let exchange = black_box(exchange);
    let first = black_box(FirstByte { offset: 0, at: None });
    black_box(exchange.on_frame(correlation, frame, first, now()));
    black_box(&mut *exchange).give_up(who());
    black_box(&mut *exchange).expire(now());
    black_box(black_box(&mut *exchange).on_timeout(now()).is_some());
    let exchange = black_box(exchange);
    black_box((exchange.timeout(), exchange.due(who()), exchange.is_idle()));
    black_box((
        exchange.expect(correlation),
        exchange.open_initiator(),
        exchange.is_saturated(),
    ));
    black_box(exchange.clear());
}

fn client<M: Messages, const N: usize>(messages: M, request: Option<M::Request<'_>>) {
    let now = || black_box(Instant::ZERO);
    let mut client = Client::<M, N>::new(messages, black_box(Config::DEFAULT));
    let client = black_box(&mut client);
    if let Some(request) = request {
        black_box(client.submit(&request).is_ok());
    }
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
    black_box((client.is_idle(), client.expects_answer(), client.frame()));
    black_box(client.messages_mut());
    black_box(client.messages());
    black_box(&mut *client).cancel();
}

fn device<M: Messages, const N: usize>(messages: M, response: &M::Response<'_>) {
    let mut device = Device::<M, N>::new(messages);
    let device = black_box(&mut device);
    black_box(device.receive(bytes(&mut [0; 300])));
    black_box(device.space());
    black_box(black_box(&mut *device).received(black_box(0)).is_ok());
    black_box(&mut *device).idle();
    let mut to = None;
    while let Some(event) = black_box(&mut *device).poll() {
        if let DeviceEvent::Request { key, .. } = black_box(event) {
            to = key;
        }
    }
    black_box(device.respond(response, to, bytes(&mut [0; 300])).is_ok());
}
