//! The driver of the USB peripheral: the HAL's, extended for hosts that clear a halt or repeat SET_CONFIGURATION.
//! [`usb_control`](crate::board::usb_control) handles hosts that abandon a request.
//!
//! The HAL's driver does not reset data toggles.

use core::future::Future;
use core::pin::pin;
use core::sync::atomic::Ordering;
use core::task::{Context, Poll};

use embassy_stm32::interrupt::typelevel::{Handler, OTG_FS};
use embassy_stm32::pac::USB_OTG_FS;
use embassy_stm32::pac::otg::vals::Pktstsd;
use embassy_stm32::{peripherals, usb};
use embassy_usb::driver::{
    self, ControlPipe as _, Direction, EndpointAddress, EndpointAllocError, EndpointError, EndpointType, Event,
    Unsupported,
};

use super::{USB_ENDPOINTS, flush, soon};
use crate::board::usb_control::{ControlPipe, SETUP_ARRIVED, wake_if_over};

/// The HAL's driver and its parts.
type Hal = usb::Driver<'static, peripherals::USB_OTG_FS>;
type HalBus = <Hal as driver::Driver<'static>>::Bus;
pub(in crate::board) type HalControlPipe = <Hal as driver::Driver<'static>>::ControlPipe;

/// Number of SETUP packets that the HAL makes room for. The controller counts down with each (RM0090 34.17.5).
const SETUP_PACKETS: u8 = 3;

/// Maximum packet size of endpoint 0.
const CONTROL_PACKET: usize = 64;

/// Wakes the task that waits for a stage of a request that the host has ended. It runs ahead of the HAL's handler.
pub(super) struct SetupHandler;

impl Handler<OTG_FS> for SetupHandler {
    unsafe fn on_interrupt() {
        if has_setup_arrived() || is_setup_waiting() {
            SETUP_ARRIVED.store(true, Ordering::Relaxed);
        }
        wake_if_over();
    }
}

/// Returns true if a SETUP packet arrived since the last request was taken. A bus reset clears the controller's count,
/// but not the flag.
fn has_setup_arrived() -> bool {
    SETUP_ARRIVED.load(Ordering::Relaxed) || USB_OTG_FS.doeptsiz(0).read().rxdpid_stupcnt() != SETUP_PACKETS
}

/// Returns true if the next FIFO entry for the HAL is a SETUP packet (RM0090 34.16.2, OTG_FS_GRXSTSR).
fn is_setup_waiting() -> bool {
    USB_OTG_FS.gintsts().read().rxflvl() && USB_OTG_FS.grxstsr().read().pktstsd() == Pktstsd::SETUP_DATA_RX
}

/// Returns true if the host has ended the current request: by another request, a bus reset or a suspend.
pub(in crate::board) fn is_over() -> bool {
    let events = USB_OTG_FS.gintsts().read();
    has_setup_arrived() || events.usbrst() || events.enumdne() || events.usbsusp()
}

/// Arms a packet of an answer.
pub(in crate::board) fn data_in(
    pipe: &mut HalControlPipe,
    data: &[u8],
    first: bool,
    last: bool,
) -> impl Future<Output = Result<(), EndpointError>> {
    pipe.data_in(data, first, last)
}

/// Ends the current request after the host began another one: withdraws its answer, and accepts no more data. A stage may
/// have cleared the NAK that the new SETUP packet had set.
pub(in crate::board) fn withdraw_answer() {
    hold_data();
    withdraw_packet();
}

/// Accepts no data in endpoint 0 before the next request is taken.
fn hold_data() {
    USB_OTG_FS.doepctl(0).modify(|w| w.set_snak(true));
}

/// Withdraws the packet in endpoint 0 after a SETUP packet, which has set the endpoint's NAK (RM0090 34.17.6, "IN
/// endpoint disable").
fn withdraw_packet() {
    let control = USB_OTG_FS.diepctl(0);
    if control.read().epena() {
        control.modify(|w| {
            w.set_snak(true);
            w.set_epdis(true);
        });
        soon(|| !control.read().epena());
        flush(0);
    }
}

/// Resets an endpoint's data toggle to DATA0 (USB 2.0, 9.1.1.5, 9.4.5, 9.4.10).
fn reset_data_toggle(endpoint: EndpointAddress) {
    let index = endpoint.index();
    // Writing back a one would restart a transfer that ended in between.
    critical_section::with(|_| match endpoint.direction() {
        Direction::In => USB_OTG_FS.diepctl(index).modify(|w| {
            w.set_epena(false);
            w.set_sd0pid_sevnfrm(true);
        }),
        Direction::Out => USB_OTG_FS.doepctl(index).modify(|w| {
            w.set_epena(false);
            w.set_sd0pid_sevnfrm(true);
        }),
    });
}

/// Returns true if an endpoint is in use.
fn is_active(endpoint: EndpointAddress) -> bool {
    match endpoint.direction() {
        Direction::In => USB_OTG_FS.diepctl(endpoint.index()).read().usbaep(),
        Direction::Out => USB_OTG_FS.doepctl(endpoint.index()).read().usbaep(),
    }
}

pub(crate) struct UsbDriver(pub(super) Hal);

impl driver::Driver<'static> for UsbDriver {
    type EndpointOut = <Hal as driver::Driver<'static>>::EndpointOut;
    type EndpointIn = <Hal as driver::Driver<'static>>::EndpointIn;
    type ControlPipe = ControlPipe;
    type Bus = Bus;

    fn alloc_endpoint_out(
        &mut self,
        kind: EndpointType,
        address: Option<EndpointAddress>,
        max_packet_size: u16,
        interval_ms: u8,
    ) -> Result<Self::EndpointOut, EndpointAllocError> {
        self.0.alloc_endpoint_out(kind, address, max_packet_size, interval_ms)
    }

    fn alloc_endpoint_in(
        &mut self,
        kind: EndpointType,
        address: Option<EndpointAddress>,
        max_packet_size: u16,
        interval_ms: u8,
    ) -> Result<Self::EndpointIn, EndpointAllocError> {
        self.0.alloc_endpoint_in(kind, address, max_packet_size, interval_ms)
    }

    fn start(self, control_max_packet_size: u16) -> (Bus, ControlPipe) {
        let (bus, control) = self.0.start(control_max_packet_size);
        (Bus(bus), ControlPipe(control))
    }
}

pub(crate) struct Bus(HalBus);

impl driver::Bus for Bus {
    async fn enable(&mut self) {
        self.0.enable().await;
    }

    async fn disable(&mut self) {
        self.0.disable().await;
    }

    async fn poll(&mut self) -> Event {
        self.0.poll().await
    }

    fn endpoint_set_enabled(&mut self, endpoint: EndpointAddress, enabled: bool) {
        // The HAL would let an active endpoint accept a packet for which it has no room, and lose the packet that waits
        // there.
        if !enabled || !is_active(endpoint) {
            self.0.endpoint_set_enabled(endpoint, enabled);
        }
        reset_data_toggle(endpoint);
    }

    fn endpoint_set_stalled(&mut self, endpoint: EndpointAddress, stalled: bool) {
        // The HAL panics for an endpoint that the controller does not have.
        if endpoint.index() >= USB_ENDPOINTS {
            return;
        }
        self.0.endpoint_set_stalled(endpoint, stalled);
        if !stalled && endpoint.index() != 0 {
            reset_data_toggle(endpoint);
        }
    }

    fn endpoint_is_stalled(&mut self, endpoint: EndpointAddress) -> bool {
        endpoint.index() < USB_ENDPOINTS && self.0.endpoint_is_stalled(endpoint)
    }

    async fn remote_wakeup(&mut self) -> Result<(), Unsupported> {
        self.0.remote_wakeup().await
    }
}

/// Takes the next request, unless it was already taken.
pub(in crate::board) fn poll_request(pipe: &mut HalControlPipe, cx: &mut Context<'_>) -> Poll<[u8; 8]> {
    if USB_OTG_FS.gintsts().read().rxflvl() {
        // Possibly another SETUP packet, which the HAL's interrupt handler fetches next.
        cx.waker().wake_by_ref();
        return Poll::Pending;
    }
    let is_new = has_setup_arrived();
    let Poll::Ready(request) = pin!(pipe.setup()).poll(cx) else {
        return Poll::Pending;
    };
    drop_data(pipe, cx);
    if is_setup_waiting() {
        // It arrived just now, and the HAL has reset the count.
        hold_data();
        SETUP_ARRIVED.store(true, Ordering::Relaxed);
        cx.waker().wake_by_ref();
        return Poll::Pending;
    }
    if !is_new {
        // The end of the SETUP stage of a request that was already taken.
        return Poll::Pending;
    }
    withdraw_packet();
    Poll::Ready(request)
}

/// Drops data of an earlier request, which the HAL would return as that of a request just taken. The controller accepts
/// none from a SETUP packet until the request is taken. To drop data sooner would make it accept some.
fn drop_data(pipe: &mut HalControlPipe, cx: &mut Context<'_>) {
    let mut data = [0; CONTROL_PACKET];
    let _ = pin!(pipe.data_out(&mut data, true, true)).poll(cx);
}
