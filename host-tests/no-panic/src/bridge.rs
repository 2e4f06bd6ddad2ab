//! The adapter.

use core::hint::black_box;

use armwire::Micros;
use armwire_bridge::{Bridge, LineCoding, PACKET, UartErrors};

use crate::bytes;

pub(crate) fn call_all() {
    let now = black_box(Micros(0));

    let mut bridge = Bridge::<2048, 512>::new();
    let bridge = black_box(&mut bridge);
    bridge.usb_configured(black_box(true));
    black_box(&mut *bridge).usb_dtr(black_box(true));
    black_box(&mut *bridge).usb_reset();
    black_box(&mut *bridge).usb_suspended();
    black_box(black_box(&*bridge).usb_room());
    black_box(&mut *bridge).usb_received(bytes(&mut [0; 300]), now);
    black_box(black_box(&*bridge).usb_due());
    black_box(black_box(&mut *bridge).usb_transmit(&mut [0; PACKET]));
    black_box(&mut *bridge).usb_lost(black_box(0));
    black_box(black_box(&*bridge).is_attached());

    black_box(&mut *bridge).uart_received(bytes(&mut [0; 300]), now);
    black_box(&mut *bridge).uart_idle();
    black_box(&mut *bridge).uart_errors(black_box(UartErrors::default()));
    black_box(&mut *bridge).uart_ring_overrun();
    black_box(black_box(&mut *bridge).uart_transmit(bytes(&mut [0; 300]), now));
    black_box(black_box(&*bridge).need());
    black_box(black_box(&*bridge).wake());

    black_box(
        black_box(&mut *bridge)
            .request_line_coding(black_box([0; 7]), now)
            .is_ok(),
    );
    black_box(black_box(&*bridge).line_coding_change());
    black_box(&mut *bridge).line_coding_changed(black_box(LineCoding::LING));
    black_box(black_box(&*bridge).line_coding());
    black_box(black_box(LineCoding::LING).to_cdc());
    black_box(black_box(LineCoding::LING).micros(black_box(0)));

    black_box(black_box(&*bridge).is_stuck(now));
    black_box(black_box(&*bridge).counters());
}
