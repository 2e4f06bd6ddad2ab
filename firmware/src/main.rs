//! The armwire adapter: a USB serial port to a robot arm's UART.
//!
//! Wiring only: clocks, pins, peripherals and tasks. What the adapter does is decided in `armwire-bridge`, which a
//! desktop tests.
//!
//! ```text
//!  host ── USB ── usb::from_host ─→ ┌────────┐ ─→ uart::transmit ── UART ── arm
//!                 usb::run       ── │ bridge │
//!  host ── USB ── usb::to_host  ←── └────────┘ ←─ uart::receive  ── UART ── arm
//! ```
#![no_std]
#![no_main]

mod adapter;
mod board;
mod led;
mod panic;
mod restart;
mod uart;
mod usb;
mod watchdog;

use embassy_executor::Spawner;
use embassy_stm32::wdg::IndependentWatchdog;
use static_cell::StaticCell;

#[cfg(feature = "defmt")]
use defmt_rtt as _;

use crate::adapter::Adapter;

#[embassy_executor::main]
async fn main(spawner: Spawner) {
    static ADAPTER: StaticCell<Adapter> = StaticCell::new();

    let board = board::init();
    let adapter = ADAPTER.init_with(Adapter::new);
    let restarts = restart::started(board.reset_by_watchdog);
    adapter.with(|bridge| bridge.started_after(restarts.panics, restarts.watchdog));
    let (device, sender, receiver) = usb::new(board.usb, adapter);
    let watchdog = IndependentWatchdog::new(board.watchdog, watchdog::TIMEOUT_US);

    // Spawning fails only for a task that already runs.
    spawner.spawn(uart::receive(adapter, board.rx_dma).unwrap());
    spawner.spawn(uart::transmit(adapter, board.uart, board.tx_dma).unwrap());
    spawner.spawn(usb::to_host(adapter, sender).unwrap());
    spawner.spawn(usb::from_host(adapter, receiver).unwrap());
    spawner.spawn(led::show(adapter, board.led).unwrap());
    spawner.spawn(watchdog::feed(adapter, watchdog).unwrap());
    // The last one runs first: it switches on the USB peripheral that others look at.
    spawner.spawn(usb::run(device).unwrap());
}
