//! The control interface: a vendor-specific one with a bulk endpoint each way.
//!
//! It is no second serial port, for the F405 has too few endpoints for two of them (RM0090 34.1).

use armwire_bridge::PACKET;
use embassy_futures::select::{Either, select};
use embassy_usb::driver::{Driver, Endpoint, EndpointIn, EndpointOut};

use crate::adapter::{Adapter, now};
use crate::board::UsbDriver;
use crate::watchdog::{Task, rest};

type ToHost = <UsbDriver as Driver<'static>>::EndpointIn;
type FromHost = <UsbDriver as Driver<'static>>::EndpointOut;

/// Its two endpoints.
pub(crate) struct Interface {
    pub(crate) to_host: ToHost,
    pub(crate) from_host: FromHost,
}

/// Sends the host replies and events.
#[embassy_executor::task]
pub(crate) async fn to_host(adapter: &'static Adapter, mut endpoint: ToHost) {
    let mut packet = [0; PACKET];
    loop {
        let resting = rest(Task::ControlToHost);
        endpoint.wait_enabled().await;
        drop(resting);
        loop {
            adapter.control_session.reset();
            let Some(n) = adapter.take(|bridge| bridge.control_transmit(&mut packet, now())) else {
                let resting = rest(Task::ControlToHost);
                adapter.control_packet.wait().await;
                drop(resting);
                continue;
            };
            // A packet that waits for the host to fetch the one before it is not for the next host.
            let sending = select(endpoint.write(&packet[..n]), adapter.control_session.wait());
            let resting = rest(Task::ControlToHost);
            let sent = sending.await;
            drop(resting);
            adapter.taken();
            if matches!(sent, Either::First(Err(_))) {
                break;
            }
        }
    }
}

/// Takes the host's requests.
#[embassy_executor::task]
pub(crate) async fn from_host(adapter: &'static Adapter, mut endpoint: FromHost) {
    let mut packet = [0; PACKET];
    loop {
        let resting = rest(Task::ControlFromHost);
        endpoint.wait_enabled().await;
        drop(resting);
        loop {
            // Until a packet is read, USB holds the host back.
            while !adapter.look(|bridge| bridge.control_room()) {
                let resting = rest(Task::ControlFromHost);
                adapter.control_room.wait().await;
                drop(resting);
            }
            let resting = rest(Task::ControlFromHost);
            let read = endpoint.read(&mut packet).await;
            drop(resting);
            let Ok(n) = read else { break };
            adapter.with(|bridge| bridge.control_received(&packet[..n], now()));
        }
    }
}
