//! The two pipes between hosts and the bridge: the arm's serial port and the control interface. Each has a bulk
//! endpoint in each direction.

use core::sync::atomic::{AtomicUsize, Ordering};
use core::task::Poll;

use armwire_bridge::{Bridge, PACKET, UsbEvent};
use embassy_futures::poll_once;
use embassy_futures::select::{Either, select};
use embassy_futures::yield_now;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::mutex::Mutex;
use embassy_usb::driver::{Driver, Endpoint, EndpointIn, EndpointOut};

use crate::adapter::{Adapter, Work};
use crate::board::UsbDriver;
use crate::clock::now;
use crate::progress::{Task, rest};

pub(crate) type ToHost = <UsbDriver as Driver<'static>>::EndpointIn;
pub(crate) type FromHost = <UsbDriver as Driver<'static>>::EndpointOut;

/// An endpoint that a task locks from the choice of a packet until the packet is in the endpoint. The service uses that
/// of the serial port in between.
pub(crate) type SharedEndpoint = Mutex<CriticalSectionRawMutex, ToHost>;

/// Length of the last packet in the serial port's endpoint.
static LAST_PACKET: AtomicUsize = AtomicUsize::new(0);

/// The length of the last packet in the serial port's endpoint.
pub(crate) fn last_packet() -> usize {
    LAST_PACKET.load(Ordering::Relaxed)
}

pub(crate) struct Endpoints {
    pub(crate) to_host: &'static SharedEndpoint,
    pub(crate) from_host: FromHost,
}

/// The two pipes.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Pipe {
    Port,
    Control,
}

impl Pipe {
    const fn tasks(self) -> (Task, Task) {
        match self {
            Self::Port => (Task::PortToHost, Task::PortFromHost),
            Self::Control => (Task::ControlToHost, Task::ControlFromHost),
        }
    }

    /// The work of a pipe: a packet to the host, room for a packet from it, and a new session.
    const fn works(self) -> (Work, Work, Work) {
        match self {
            Self::Port => (Work::Port, Work::PortRoom, Work::PortSession),
            Self::Control => (Work::Control, Work::ControlRoom, Work::ControlSession),
        }
    }

    fn has_room(self, bridge: &mut Bridge) -> bool {
        let status = bridge.update(now());
        match self {
            Self::Port => status.usb_room,
            Self::Control => status.control_room,
        }
    }

    /// Passes a packet to the bridge. Returns true if the next one fits.
    fn received(self, bridge: &mut Bridge, packet: &[u8]) -> bool {
        match self {
            Self::Port => bridge.usb_received(packet, now()),
            Self::Control => bridge.control_received(packet, now()),
        }
    }

    fn transmit(self, bridge: &mut Bridge, packet: &mut [u8; PACKET]) -> Option<usize> {
        match self {
            Self::Port => bridge.usb_transmit(packet),
            Self::Control => bridge.control_transmit(packet, now()),
        }
    }

    /// A packet of `len` bytes waits for the host, or could not be sent.
    fn finish(self, adapter: &Adapter, len: usize, is_sent: bool) {
        match (self, is_sent) {
            (Self::Port, true) => LAST_PACKET.store(len, Ordering::Relaxed),
            (Self::Port, false) => {
                adapter.take(|bridge| bridge.usb_event(UsbEvent::Lost(len), now()));
            }
            // A reply may fit now.
            (Self::Control, _) => adapter.wake(Work::Dispatch),
        }
    }
}

/// Sends the bridge's packets to the host.
#[embassy_executor::task(pool_size = 2)]
pub(crate) async fn to_host(adapter: &'static Adapter, pipe: Pipe, shared: &'static SharedEndpoint) {
    let (task, _) = pipe.tasks();
    let (work, _, session) = pipe.works();
    let mut packet = [0; PACKET];
    loop {
        let mut endpoint = shared.lock().await;
        let resting = rest(task);
        endpoint.wait_enabled().await;
        drop(resting);
        loop {
            adapter.reset(session);
            let Some(n) = adapter.take(|bridge| pipe.transmit(bridge, &mut packet)) else {
                break;
            };
            // A packet that waits behind another is not for the next host. Nor may it go after the other was withdrawn:
            // the end of the session comes first.
            let sending = select(adapter.wait(session), endpoint.write(&packet[..n]));
            let resting = rest(task);
            let sent = sending.await;
            drop(resting);
            pipe.finish(adapter, n, matches!(sent, Either::Second(Ok(()))));
            if matches!(sent, Either::Second(Err(_))) {
                break;
            }
        }
        drop(endpoint);
        if pipe == Pipe::Control && adapter.take(|bridge| bridge.update(now()).control) {
            yield_now().await;
            continue;
        }
        let resting = rest(task);
        adapter.wait(work).await;
        drop(resting);
    }
}

/// Puts due packets of the serial port into its endpoint, or wakes the task, which waits for the endpoint. The service
/// calls this.
pub(crate) fn send(adapter: &Adapter, port: &SharedEndpoint, bridge: &mut Bridge) {
    let write = |packet: &[u8]| {
        let is_sent = port
            .try_lock()
            .is_ok_and(|mut endpoint| matches!(poll_once(endpoint.write(packet)), Poll::Ready(Ok(()))));
        if !is_sent {
            adapter.wake(Work::Port);
        }
        is_sent
    };
    while let Some(len) = bridge.usb_transmit_with(write) {
        LAST_PACKET.store(len, Ordering::Relaxed);
    }
}

/// Receives the host's packets.
#[embassy_executor::task(pool_size = 2)]
pub(crate) async fn from_host(adapter: &'static Adapter, pipe: Pipe, mut endpoint: FromHost) {
    let (_, task) = pipe.tasks();
    let (_, room, _) = pipe.works();
    let mut packet = [0; PACKET];
    let mut has_room = true;
    loop {
        let resting = rest(task);
        endpoint.wait_enabled().await;
        drop(resting);
        loop {
            // USB flow control holds the host back until a packet is read.
            while !has_room {
                let resting = rest(task);
                adapter.wait(room).await;
                drop(resting);
                has_room = adapter.take(|bridge| pipe.has_room(bridge));
            }
            let resting = rest(task);
            let read = endpoint.read(&mut packet).await;
            drop(resting);
            let Ok(n) = read else { break };
            has_room = adapter.with(|bridge| pipe.received(bridge, &packet[..n]));
        }
    }
}
