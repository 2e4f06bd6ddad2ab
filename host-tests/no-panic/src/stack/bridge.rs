//! The public entry points of the adapter, each a function of its own with a name to read.
//!
//! `cargo xtask stack` links it and adds up, from the machine code, what each takes of the stack at worst. It is not run.
//!
//! What an entry point returns lies on its caller's stack, and so does what it is given by value and does not fit in
//! registers: neither is counted.
#![no_std]
#![no_main]

use core::panic::PanicInfo;

use armwire::Micros;
use armwire_bridge::can::Frame;
use armwire_bridge::config::Config;
use armwire_bridge::control::{Failure, Identity};
use armwire_bridge::{Bridge, Burst, Line, PACKET, Refused};

#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    loop {}
}

#[unsafe(export_name = "Bridge::new")]
fn new(identity: Identity, config: Config) -> Bridge {
    Bridge::new(identity, config)
}

#[unsafe(export_name = "Bridge::usb_reset")]
fn usb_reset(bridge: &mut Bridge) {
    bridge.usb_reset();
}

#[unsafe(export_name = "Bridge::usb_received")]
fn usb_received(bridge: &mut Bridge, packet: &[u8], now: Micros) {
    bridge.usb_received(packet, now);
}

#[unsafe(export_name = "Bridge::usb_transmit")]
fn usb_transmit(bridge: &mut Bridge, packet: &mut [u8; PACKET]) -> Option<usize> {
    bridge.usb_transmit(packet)
}

#[unsafe(export_name = "Bridge::uart_received")]
fn uart_received(bridge: &mut Bridge, bytes: &[u8], now: Micros) {
    bridge.uart_received(bytes, now);
}

#[unsafe(export_name = "Bridge::uart_idle")]
fn uart_idle(bridge: &mut Bridge, now: Micros) {
    bridge.uart_idle(now);
}

#[unsafe(export_name = "Bridge::uart_transmit")]
fn uart_transmit(bridge: &mut Bridge, out: &mut [u8], now: Micros) -> Option<Burst> {
    bridge.uart_transmit(out, now)
}

#[unsafe(export_name = "Bridge::request_line_coding")]
fn request_line_coding(bridge: &mut Bridge, bytes: [u8; 7], now: Micros) -> Result<(), Refused> {
    bridge.request_line_coding(bytes, now)
}

#[unsafe(export_name = "Bridge::line_changed")]
fn line_changed(bridge: &mut Bridge, line: Line) {
    bridge.line_changed(line);
}

#[unsafe(export_name = "Bridge::control_received")]
fn control_received(bridge: &mut Bridge, packet: &[u8], now: Micros) {
    bridge.control_received(packet, now);
}

#[unsafe(export_name = "Bridge::share")]
fn share(bridge: &mut Bridge) {
    bridge.share();
}

#[unsafe(export_name = "Bridge::control_prepare")]
fn control_prepare(bridge: &mut Bridge) -> bool {
    bridge.control_prepare()
}

#[unsafe(export_name = "Bridge::control_transmit")]
fn control_transmit(bridge: &mut Bridge, packet: &mut [u8; PACKET], now: Micros) -> Option<usize> {
    bridge.control_transmit(packet, now)
}

#[unsafe(export_name = "Bridge::can_received")]
fn can_received(bridge: &mut Bridge, frame: &Frame, now: Micros) {
    bridge.can_received(frame, now);
}

#[unsafe(export_name = "Bridge::can_transmit")]
fn can_transmit(bridge: &mut Bridge, now: Micros) -> Option<Frame> {
    bridge.can_transmit(now)
}

#[unsafe(export_name = "Bridge::can_bus_off")]
fn can_bus_off(bridge: &mut Bridge, off: bool, now: Micros) {
    bridge.can_bus_off(off, now);
}

#[unsafe(export_name = "Bridge::timeout")]
fn timeout(bridge: &Bridge) -> Option<Micros> {
    bridge.timeout()
}

#[unsafe(export_name = "Bridge::tick")]
fn tick(bridge: &mut Bridge, now: Micros) {
    bridge.tick(now);
}

#[unsafe(export_name = "Bridge::saved")]
fn saved(bridge: &mut Bridge, result: Result<(), Failure>, now: Micros) {
    bridge.saved(result, now);
}
