//! The adapter.

use core::hint::black_box;

use armwire_bridge::can::{Frame, Id};
use armwire_bridge::config::Config;
use armwire_bridge::control::Identity;
use armwire_bridge::{
    Bridge, CanErrors, CanEvent, Counters, Instant, LineCoding, PACKET, Start, UartConfig, UartErrors, UartEvent,
    UsbEvent,
};

use crate::bytes;

pub(crate) fn call_all() {
    let now = black_box(Instant::ZERO);

    let mut bridge = Bridge::new(
        black_box(Identity::default()),
        black_box(Config::default()),
        black_box(Start::default()),
    );
    let bridge = black_box(&mut bridge);
    for event in [
        UsbEvent::Reset,
        UsbEvent::Configured(true),
        UsbEvent::Suspended,
        UsbEvent::Dtr(true),
        UsbEvent::Lost(0),
    ] {
        black_box(black_box(&mut *bridge).usb_event(black_box(event), now));
    }
    black_box(&mut *bridge).usb_received(bytes(&mut [0; 300]), now);
    black_box(black_box(&mut *bridge).usb_transmit(&mut [0; PACKET]));

    black_box(black_box(&mut *bridge).uart_received(bytes(&mut [0; 300]), now));
    black_box(black_box(&mut *bridge).uart_event(UartEvent::Idle, now));
    black_box(black_box(&*bridge).has_delivery());
    black_box(&mut *bridge).uart_event(UartEvent::Errors(black_box(UartErrors::default())), now);
    black_box(black_box(&mut *bridge).uart_transmit(bytes(&mut [0; 300]), now));
    black_box(&mut *bridge).uart_transmitted(now);
    black_box(&mut *bridge).uart_event(UartEvent::Configured(black_box(UartConfig::default())), now);
    black_box(black_box(black_box(&*bridge).rx_threshold()).is_met(black_box(7), black_box(0xFF)));

    black_box(black_box(&mut *bridge).set_line_coding(black_box([0; 7]), now).is_ok());
    black_box(black_box(&*bridge).line_coding());
    black_box(black_box(LineCoding::LING).to_cdc());
    black_box(black_box(LineCoding::LING).micros(black_box(0)));

    black_box(&mut *bridge).control_received(bytes(&mut [0; 300]), now);
    black_box(black_box(&mut *bridge).control_transmit(&mut [0; PACKET], now));

    if let (Ok(id), Ok(fd_id)) = (Id::new(black_box(0)), Id::new(black_box(0))) {
        for frame in [
            Frame::new(id, bytes(&mut [0; 8])),
            Frame::new_fd(fd_id, bytes(&mut [0; 64])),
        ]
        .into_iter()
        .flatten()
        {
            black_box(&mut *bridge).can_received(black_box(&frame), now);
        }
    }
    black_box(black_box(&mut *bridge).can_transmit(now));
    for event in [
        CanEvent::Waiting(1),
        CanEvent::Errors(CanErrors::default()),
        CanEvent::BusOff,
        CanEvent::BusOn,
    ] {
        black_box(black_box(&mut *bridge).can_event(black_box(event), now));
    }

    black_box(black_box(&mut *bridge).update(now));
    black_box(black_box(&*bridge).timeout());
    black_box(&mut *bridge).tick(now);
    black_box(black_box(&mut *bridge).action(now));
    black_box(&mut *bridge).saved(black_box(Ok(())), now);
    black_box(black_box(&*bridge).config());

    let counters = black_box(black_box(&*bridge).counters());
    black_box(counters.to_bytes(bytes(&mut [0; 300])).is_ok());
    black_box(Counters::from_bytes(bytes(&mut [0; 300])).is_ok());
}
