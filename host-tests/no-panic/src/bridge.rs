//! The adapter.

use core::hint::black_box;

use armwire_bridge::can::{Frame, Id};
use armwire_bridge::config::Config;
use armwire_bridge::control::Identity;
use armwire_bridge::{Bridge, CanErrors, Counters, Instant, Line, LineCoding, PACKET, UartErrors};

use crate::bytes;

pub(crate) fn call_all() {
    let now = black_box(Instant::ZERO);

    let mut bridge = Bridge::new(black_box(Identity::default()), black_box(Config::default()));
    let bridge = black_box(&mut bridge);
    bridge.usb_configured(black_box(true));
    black_box(&mut *bridge).usb_dtr(black_box(true), now);
    black_box(&mut *bridge).usb_reset();
    black_box(&mut *bridge).usb_suspended();
    black_box(black_box(&*bridge).usb_room());
    black_box(&mut *bridge).usb_received(bytes(&mut [0; 300]), now);
    black_box(black_box(&*bridge).usb_due());
    black_box(black_box(&mut *bridge).usb_transmit(&mut [0; PACKET]));
    black_box(&mut *bridge).usb_lost(black_box(0));
    black_box(black_box(&*bridge).is_attached());

    black_box(&mut *bridge).uart_received(bytes(&mut [0; 300]), now);
    black_box(&mut *bridge).uart_idle(now);
    black_box(&mut *bridge).uart_errors(black_box(UartErrors::default()));
    black_box(&mut *bridge).uart_ring_overrun();
    black_box(&mut *bridge).share();
    black_box(black_box(&*bridge).uart_due(now));
    black_box(black_box(&mut *bridge).uart_transmit(bytes(&mut [0; 300]), now));
    black_box(black_box(black_box(&*bridge).rx_threshold()).is_met(black_box(7), black_box(0xFF)));

    black_box(
        black_box(&mut *bridge)
            .request_line_coding(black_box([0; 7]), now)
            .is_ok(),
    );
    black_box(black_box(&*bridge).line_change());
    black_box(&mut *bridge).line_changed(black_box(Line::default()));
    black_box(black_box(&*bridge).line_coding());
    black_box(black_box(&*bridge).uart_cut());
    black_box(black_box(LineCoding::LING).to_cdc());
    black_box(black_box(LineCoding::LING).micros(black_box(0)));

    black_box(black_box(&*bridge).control_room());
    black_box(&mut *bridge).control_received(bytes(&mut [0; 300]), now);
    black_box(black_box(&*bridge).control_due());
    black_box(black_box(&mut *bridge).control_prepare());
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
    black_box(black_box(&*bridge).can_due(now));
    black_box(black_box(&mut *bridge).can_transmit(now));
    black_box(black_box(&mut *bridge).can_sent(black_box(1), now));
    black_box(&mut *bridge).can_errors(black_box(CanErrors::default()));
    black_box(&mut *bridge).can_bus_off(black_box(true), now);
    black_box(black_box(&*bridge).can_config());

    black_box(black_box(&*bridge).timeout());
    black_box(&mut *bridge).tick(now);
    black_box(black_box(&mut *bridge).action());
    black_box(&mut *bridge).saved(black_box(Ok(())), now);
    black_box(black_box(&*bridge).config());
    black_box(black_box(&*bridge).identity());

    black_box(&mut *bridge).started_after(black_box(0), black_box(0), black_box(0));
    black_box(black_box(&*bridge).is_stuck(now));
    let counters = black_box(black_box(&*bridge).counters());
    black_box(counters.to_bytes(bytes(&mut [0; 300])).is_ok());
    black_box(Counters::from_bytes(bytes(&mut [0; 300])).is_ok());
}
