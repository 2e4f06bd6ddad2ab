//! The exchange, of several initiators.

use core::hint::black_box;

use armwire::dialect::Dialect;
use armwire::exchange::{Exchange, FirstByte, Handover};
use armwire::time::{Duration, Instant};

use crate::bytes;

pub(crate) fn call_all<D: Dialect>(dialect: &D) {
    let dialect = black_box(dialect);
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
    if let Some(info) = black_box(dialect).request(frame) {
        black_box(exchange.can_send(&black_box(info), who()));
        exchange.begin(black_box(info), who(), handover);
        exchange.repeat(black_box(info), who(), handover);
    }
    let exchange = black_box(exchange);
    let first = black_box(FirstByte { offset: 0, at: None });
    black_box(exchange.on_frame(dialect, frame, first, now()));
    black_box(&mut *exchange).give_up(who());
    black_box(&mut *exchange).expire(now());
    black_box(black_box(&mut *exchange).on_timeout(now()).is_some());
    let exchange = black_box(exchange);
    black_box((exchange.timeout(), exchange.due(who()), exchange.is_idle()));
    black_box((exchange.expect(dialect), exchange.holder(), exchange.is_saturated()));
    black_box(exchange.clear());
}
