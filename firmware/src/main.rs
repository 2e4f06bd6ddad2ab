//! The armwire adapter: a USB serial port to a robot arm's UART.
//!
//! Wiring only: clocks, pins, peripherals and tasks. The adapter's logic is in `armwire-bridge`, which is tested on a
//! desktop.
//!
//! ```text
//!  host ── USB ── usb::pipe::from_host ───→ ┌────────┐ ←→ service ────── UART ── arm
//!  host ── USB ── usb::pipe::to_host   ←─── │        │ ←→ uart::change ─ UART
//!                 usb::run             ──── │ bridge │
//!  hosts ─ CAN ── can::run             ←──→ └────────┘ ←→ time::tick, action::run
//! ```
// With `std` a check of the workspace, and an editor, reads it on a computer, too.
#![cfg_attr(target_os = "none", no_std)]
#![no_main]

// Before the others, which use its macros.
mod fmt;

mod action;
mod adapter;
mod board;
#[cfg(feature = "can")]
mod can;
mod ceiling;
mod clock;
mod fault;
mod identity;
mod led;
mod panic;
mod pend;
mod priority;
mod progress;
mod restart;
mod service;
mod time;
mod uart;
mod usb;
mod watchdog;

use armwire_bridge::config::Config;
use armwire_bridge::{Instant, Start};
use embassy_executor::Spawner;
use static_cell::StaticCell;

#[cfg(feature = "defmt")]
use defmt_rtt as _;

use crate::adapter::Adapter;
use crate::priority::Priority;
use crate::usb::pipe::{self, Pipe};

#[embassy_executor::main]
async fn main(spawner: Spawner) {
    board::restore_reset_state();
    if restart::is_into_boot_loader() {
        board::enter_boot_loader();
    }
    let mut starts = restart::begin(board::take_reset());
    let mut watchdog = watchdog::start();
    let board = board::init(&mut watchdog);
    identity::log();
    let mut store = action::store(board.flash);
    let (config, is_lost) = match starts.recovery() {
        Some(_) => (starts.config(), false),
        None => {
            restart::keep(starts.loading());
            action::load(&mut store)
        }
    };
    if let Some(words) = starts.running(Instant::ZERO, &config) {
        restart::keep(words);
    }
    // Torque-off that is due does not wait for an erase.
    if starts.recovery().is_none() && !restart::was_armed() {
        action::prepare(&mut store);
    }
    let start = starts.start(restart::was_armed(), is_lost);
    restart::log(&start);
    if starts.recovery().is_some() {
        warning!("recovery: factory settings after three crashed starts, without CAN");
    }
    match is_lost {
        true => warning!("the saved configuration is unreadable: factory settings"),
        false => info!("configuration: {}", config),
    }
    let adapter = adapter(config, start);
    let usb = usb::new(board.usb, adapter);

    service::start(adapter, usb.port.to_host);
    Priority::Line.start(spawner, uart::change(adapter, board.uart, board.rx_dma));
    for (pipe, endpoints) in [(Pipe::Port, usb.port), (Pipe::Control, usb.control)] {
        let (to_host, from_host) = match pipe {
            Pipe::Port => (Priority::ToHost, Priority::FromHost),
            Pipe::Control => (Priority::Control, Priority::Control),
        };
        to_host.start(spawner, pipe::to_host(adapter, pipe, endpoints.to_host));
        from_host.start(spawner, pipe::from_host(adapter, pipe, endpoints.from_host));
    }
    #[cfg(feature = "can")]
    Priority::Can.start(spawner, can::run(adapter, board.can));
    Priority::Background.start(spawner, action::run(adapter, store));
    Priority::Time.start(spawner, time::tick(adapter));
    Priority::Background.start(spawner, led::show(adapter, board.led));
    Priority::Background.start(spawner, watchdog::feed(adapter, watchdog, starts));
    Priority::UsbDevice.start(spawner, usb::run(usb.device));
}

/// Creates the adapter. It is built on the stack, which has no room for it besides the frame of `main`.
#[inline(never)]
fn adapter(config: Config, start: Start) -> &'static Adapter {
    static ADAPTER: StaticCell<Adapter> = StaticCell::new();
    let adapter = ADAPTER.init_with(|| Adapter::new(identity::identity(), config, start));
    adapter.take(|bridge| bridge.set_poll_lead_time(board::POLL_LEAD_TIME));
    adapter
}
