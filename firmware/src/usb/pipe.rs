//! The two pipes between hosts and the bridge: the arm's serial port and the control interface. Each has a bulk endpoint
//! each way.

use armwire_bridge::{Bridge, PACKET};
use embassy_futures::select::{Either, select};
use embassy_futures::yield_now;
use embassy_usb::driver::{Driver, Endpoint, EndpointIn, EndpointOut};

use crate::adapter::{Adapter, Notice, now};
use crate::board::UsbDriver;
use crate::watchdog::{Task, rest};

type ToHost = <UsbDriver as Driver<'static>>::EndpointIn;
type FromHost = <UsbDriver as Driver<'static>>::EndpointOut;

/// The endpoints of a pipe.
pub(crate) struct Endpoints {
    pub(crate) to_host: ToHost,
    pub(crate) from_host: FromHost,
}

/// Which pipe.
#[derive(Clone, Copy)]
pub(crate) enum Pipe {
    Port,
    Control,
}

impl Pipe {
    /// Makes a part of what is to be transmitted, and returns whether it did.
    fn prepare(self, bridge: &mut Bridge) -> bool {
        match self {
            Self::Port => false,
            Self::Control => bridge.control_prepare(),
        }
    }

    fn transmit(self, bridge: &mut Bridge, packet: &mut [u8; PACKET]) -> Option<usize> {
        match self {
            Self::Port => bridge.usb_transmit(packet),
            Self::Control => bridge.control_transmit(packet, now()),
        }
    }

    /// A packet of `len` bytes waits for the host to fetch it.
    fn sent(self, adapter: &Adapter, len: usize) {
        match self {
            Self::Port => adapter.last_packet.set(len),
            Self::Control => {}
        }
    }

    /// A packet of `len` bytes could not be sent.
    fn lost(self, bridge: &mut Bridge, len: usize) {
        match self {
            Self::Port => bridge.usb_lost(len),
            Self::Control => {}
        }
    }

    /// A packet was sent, or lost.
    fn taken(self, adapter: &Adapter) {
        match self {
            // Nobody waits for room there.
            Self::Port => {}
            Self::Control => adapter.taken(),
        }
    }

    fn has_room(self, bridge: &Bridge) -> bool {
        match self {
            Self::Port => bridge.usb_room(),
            Self::Control => bridge.control_room(),
        }
    }

    fn received(self, bridge: &mut Bridge, packet: &[u8]) {
        match self {
            Self::Port => bridge.usb_received(packet, now()),
            Self::Control => bridge.control_received(packet, now()),
        }
    }

    fn packet(self, adapter: &Adapter) -> &Notice {
        match self {
            Self::Port => &adapter.packet,
            Self::Control => &adapter.control_packet,
        }
    }

    fn room(self, adapter: &Adapter) -> &Notice {
        match self {
            Self::Port => &adapter.room,
            Self::Control => &adapter.control_room,
        }
    }

    fn session(self, adapter: &Adapter) -> &Notice {
        match self {
            Self::Port => &adapter.session,
            Self::Control => &adapter.control_session,
        }
    }
}

/// Sends the host what the bridge has for it.
#[embassy_executor::task(pool_size = 2)]
pub(crate) async fn to_host(adapter: &'static Adapter, pipe: Pipe, mut endpoint: ToHost) {
    let task = match pipe {
        Pipe::Port => Task::PortToHost,
        Pipe::Control => Task::ControlToHost,
    };
    let session = pipe.session(adapter);
    let mut packet = [0; PACKET];
    loop {
        let resting = rest(task);
        endpoint.wait_enabled().await;
        drop(resting);
        loop {
            while adapter.take(|bridge| pipe.prepare(bridge)) {
                yield_now().await;
            }
            session.reset();
            let Some(n) = adapter.take(|bridge| pipe.transmit(bridge, &mut packet)) else {
                let resting = rest(task);
                pipe.packet(adapter).wait().await;
                drop(resting);
                continue;
            };
            // A packet that waits for the host to fetch the one before it is not for the next host. Nor may it go when that
            // one was taken back: the end of the session comes first.
            let sending = select(session.wait(), endpoint.write(&packet[..n]));
            let resting = rest(task);
            let sent = sending.await;
            drop(resting);
            match sent {
                Either::Second(Ok(())) => pipe.sent(adapter, n),
                _ => adapter.take(|bridge| pipe.lost(bridge, n)),
            }
            pipe.taken(adapter);
            if matches!(sent, Either::Second(Err(_))) {
                break;
            }
        }
    }
}

/// Takes what the host sends.
#[embassy_executor::task(pool_size = 2)]
pub(crate) async fn from_host(adapter: &'static Adapter, pipe: Pipe, mut endpoint: FromHost) {
    let task = match pipe {
        Pipe::Port => Task::PortFromHost,
        Pipe::Control => Task::ControlFromHost,
    };
    let mut packet = [0; PACKET];
    loop {
        let resting = rest(task);
        endpoint.wait_enabled().await;
        drop(resting);
        loop {
            // Until a packet is read, USB holds the host back.
            while !adapter.look(|bridge| pipe.has_room(bridge)) {
                let resting = rest(task);
                pipe.room(adapter).wait().await;
                drop(resting);
            }
            let resting = rest(task);
            let read = endpoint.read(&mut packet).await;
            drop(resting);
            let Ok(n) = read else { break };
            adapter.with(|bridge| pipe.received(bridge, &packet[..n]));
        }
    }
}
