//! CAN frames, the identifier map, and ISO-TP.

use core::hint::black_box;

use armwire_bridge::Instant;
use armwire_bridge::can::{Frame, Function, Id, Node};
use armwire_bridge::isotp::{Config, Endpoint, Link, SeparationTime};

use crate::bytes::bytes;

pub(crate) fn call_all() {
    let id = black_box(Id::new(black_box(0))).unwrap_or(Id::MAX);
    let node = black_box(Node::new(black_box(0))).unwrap_or_default();
    black_box(id.get());
    black_box(node.get());
    black_box(black_box(Function::ArmAnswer).base());
    black_box(black_box(Function::ArmAnswer).id(node));
    black_box(Function::of(id));
    black_box(Frame::new(id, bytes(&mut [0; 100])).is_ok());
    if let Ok(frame) = black_box(Frame::new_fd(id, bytes(&mut [0; 100]))) {
        black_box((frame.data(), frame.id(), frame.is_fd()));
    }

    black_box(SeparationTime::from_millis(black_box(0)).is_ok());
    black_box(SeparationTime::from_hundreds_of_micros(black_box(1)).is_ok());
    let st_min = SeparationTime::from_byte(black_box(0));
    black_box((st_min.to_byte(), st_min.duration()));
    let config = black_box(Config::new(Link::Classic, id));
    call::<300, 300>(config);
    // The longest and the shortest.
    call::<4095, 1>(config);
}

fn call<const RX: usize, const TX: usize>(config: Config) {
    let now = black_box(Instant::ZERO);
    let mut endpoint = Endpoint::<RX, TX>::new(config);
    let endpoint = black_box(&mut endpoint);
    for event in endpoint.receive(bytes(&mut [0; 100]), now) {
        black_box(event);
    }
    black_box(black_box(&*endpoint).received());
    black_box(&mut *endpoint).release();
    black_box(black_box(&mut *endpoint).send(bytes(&mut [0; 5000])).is_ok());
    black_box(black_box(&*endpoint).is_sending());
    black_box(black_box(&*endpoint).transmit_at());
    black_box(black_box(&mut *endpoint).transmit(now));
    black_box(&mut *endpoint).transmitted(now);
    black_box(black_box(&*endpoint).timeout());
    for event in black_box(&mut *endpoint).tick(now) {
        black_box(event);
    }
    black_box(&mut *endpoint).abort();
}
