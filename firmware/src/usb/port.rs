//! The arm's serial port: one CDC-ACM function.

use armwire_bridge::PACKET;
use embassy_futures::select::{Either, select};
use embassy_usb::class::cdc_acm::{Receiver, Sender};

use crate::adapter::{Adapter, now};
use crate::board::UsbDriver;
use crate::watchdog::{Task, rest};

/// Sends the host what the arm said.
#[embassy_executor::task]
pub(crate) async fn to_host(adapter: &'static Adapter, mut sender: Sender<'static, UsbDriver>) {
    let mut packet = [0; PACKET];
    loop {
        let resting = rest(Task::PortToHost);
        sender.wait_connection().await;
        drop(resting);
        loop {
            adapter.session.reset();
            let Some(n) = adapter.take(|bridge| bridge.usb_transmit(&mut packet)) else {
                let resting = rest(Task::PortToHost);
                adapter.packet.wait().await;
                drop(resting);
                continue;
            };
            // A packet that waits for the host to fetch the one before it is not for the next host.
            let sending = select(sender.write_packet(&packet[..n]), adapter.session.wait());
            let resting = rest(Task::PortToHost);
            let sent = sending.await;
            drop(resting);
            if !matches!(sent, Either::First(Ok(()))) {
                adapter.with(|bridge| bridge.usb_lost(n));
            }
            if matches!(sent, Either::First(Err(_))) {
                break;
            }
        }
    }
}

/// Takes from the host what is for the arm.
#[embassy_executor::task]
pub(crate) async fn from_host(adapter: &'static Adapter, mut receiver: Receiver<'static, UsbDriver>) {
    let mut packet = [0; PACKET];
    loop {
        let resting = rest(Task::PortFromHost);
        receiver.wait_connection().await;
        drop(resting);
        loop {
            // Until a packet is read, USB holds the host back.
            while !adapter.look(|bridge| bridge.usb_room()) {
                let resting = rest(Task::PortFromHost);
                adapter.room.wait().await;
                drop(resting);
            }
            let resting = rest(Task::PortFromHost);
            let read = receiver.read_packet(&mut packet).await;
            drop(resting);
            let Ok(n) = read else { break };
            adapter.with(|bridge| bridge.usb_received(&packet[..n], now()));
        }
    }
}
