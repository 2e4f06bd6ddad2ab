//! The adapter.

use core::hint::black_box;

use armwire_bridge::can::{Frame, Id};
use armwire_bridge::config::Config;
use armwire_bridge::control::{Identity, MAX_FRAME};
use armwire_bridge::start::{Cause, StartLog};
use armwire_bridge::store::Saved;
use armwire_bridge::{Bridge, CanEvent, Counters, Instant, LineCoding, PACKET, RxRing, Start, UartEvent, UsbEvent};

use crate::bytes::bytes;

pub(crate) fn call_all() {
    let now = black_box(Instant::ZERO);

    let mut starts = StartLog::begin(black_box([0; StartLog::WORDS]), black_box(Cause::Panic));
    black_box(starts.running(now, black_box(&Config::default())));
    black_box((starts.loading(), starts.to_words()));
    black_box((starts.config(), starts.recovery(), starts.start(true, true)));

    let mut bridge = Bridge::new(
        black_box(Identity::default()),
        black_box(Config::default()),
        black_box(Start::default()),
    );
    let bridge = black_box(&mut bridge);
    black_box(&mut *bridge).usb_event(black_box(UsbEvent::Reset), now);
    black_box(&mut *bridge).usb_received(bytes(&mut [0; 300]), now);
    black_box(black_box(&mut *bridge).usb_transmit(&mut [0; PACKET]));

    black_box(black_box(&mut *bridge).uart_received(bytes(&mut [0; 300]), now));
    black_box(black_box(&mut *bridge).uart_event(black_box(UartEvent::Idle), now));
    black_box(black_box(&mut *bridge).has_delivery());
    black_box(
        black_box(&mut *bridge).uart_transmit(&mut [0; MAX_FRAME], now, |bytes, start| {
            black_box((bytes, start));
        }),
    );
    black_box(
        black_box(&mut *bridge).uart_transmit_ahead(&mut [0; MAX_FRAME], |bytes| {
            black_box(bytes);
            now
        }),
    );
    black_box(black_box(black_box(&mut *bridge).rx_wait().threshold).is_met(black_box(7), black_box(0xFF)));
    rx_ring(bridge, now);

    black_box(black_box(&mut *bridge).set_line_coding(black_box([0; 7]), now).is_ok());
    black_box(black_box(&*bridge).line_coding());
    black_box(black_box(LineCoding::LING).to_cdc());
    black_box(black_box(LineCoding::LING).micros(black_box(0)));

    black_box(&mut *bridge).control_received(bytes(&mut [0; 300]), now);
    black_box(black_box(&mut *bridge).control_transmit(&mut [0; PACKET], now));

    let id = black_box(Id::new(black_box(0))).unwrap_or(Id::MAX);
    if let Ok(frame) = black_box(Frame::new_fd(id, bytes(&mut [0; 64]))) {
        black_box(&mut *bridge).can_received(&frame, now);
    }
    black_box(black_box(&mut *bridge).can_transmit(now));
    black_box(black_box(&mut *bridge).can_event(black_box(CanEvent::BusOff), now));

    black_box(black_box(&mut *bridge).update(now));
    black_box(black_box(&mut *bridge).timeout());
    black_box(&mut *bridge).tick(now);
    black_box(black_box(&mut *bridge).action(now));
    black_box(&mut *bridge).saved(black_box(Ok(())), now);
    black_box(&mut *bridge).loaded(black_box(Ok(Saved::Nothing)), now);
    black_box(black_box(&*bridge).can_config());
    black_box(black_box(&*bridge).config());

    let counters = black_box(black_box(&mut *bridge).counters());
    black_box(counters.to_bytes(bytes(&mut [0; 300])).is_ok());
    black_box(Counters::from_bytes(bytes(&mut [0; 300])).is_ok());
}

fn rx_ring(bridge: &mut Bridge, now: Instant) {
    let mut ring = RxRing::<1024>::new();
    let ring = black_box(&mut ring);
    black_box(&mut *ring).set(black_box(bridge).rx_wait());
    black_box(black_box(&*ring).is_waiting());
    black_box(black_box(&mut *ring).quiet(black_box(7), |at| black_box(at) as u8));
    black_box(black_box(&*ring).is_overdue(black_box(7)));
    black_box(black_box(&mut *ring).arrived(black_box(7), black_box(0xFF), || now));
    black_box(black_box(&mut *ring).idle(black_box(7), now));
    black_box(black_box(&*ring).has_mark());
    black_box(black_box(&mut *ring).take_mark(black_box(7)));
    black_box(black_box(&*ring).unread(black_box(7)));
    black_box(black_box(&mut *ring).take(black_box(7), black_box(64)));
    black_box(&mut *ring).discard(black_box(7));
    black_box(&mut *ring).restart();
}
