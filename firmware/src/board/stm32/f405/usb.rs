//! The registers of the USB peripheral, behind [`usb_driver`](crate::board::usb_driver) and
//! [`usb_control`](crate::board::usb_control).
//!
//! The HAL's driver does not reset data toggles.

use core::future::Future;
use core::pin::pin;
use core::sync::atomic::Ordering;
use core::task::{Context, Poll};

use embassy_stm32::interrupt::typelevel::{Handler, OTG_FS};
use embassy_stm32::pac::USB_OTG_FS;
use embassy_stm32::pac::common::{RW, Reg};
use embassy_stm32::pac::otg::regs::Diepctl;
use embassy_stm32::pac::otg::vals::Pktstsd;
use embassy_stm32::{peripherals, usb};
use embassy_usb::driver::{
    self, Bus as _, ControlPipe as _, Direction, Endpoint as _, EndpointAddress, EndpointError, EndpointIn as _,
    EndpointOut as _, Event,
};

use crate::board::usb_stage::{SETUP_ARRIVED, soon, wake_stage};

/// The HAL's driver and its parts.
pub(in crate::board) type Hal = usb::Driver<'static, peripherals::USB_OTG_FS>;
pub(in crate::board) type HalBus = <Hal as driver::Driver<'static>>::Bus;
pub(in crate::board) type HalControlPipe = <Hal as driver::Driver<'static>>::ControlPipe;
pub(in crate::board) type HalIn = <Hal as driver::Driver<'static>>::EndpointIn;
pub(in crate::board) type HalOut = <Hal as driver::Driver<'static>>::EndpointOut;

/// Number of endpoints in each direction (RM0090 34.1).
pub(in crate::board) const ENDPOINTS: usize = 4;

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
            hold_answer();
        }
        if is_over() {
            wake_stage();
        }
    }
}

/// Returns true if a SETUP packet arrived since the last request was taken. A bus reset clears the controller's count,
/// but not the flag.
///
/// TinyUSB and ST's HAL go by DOEPINT.SETUP, which comes only after the FIFO entries before it are read: too late for
/// [`is_over`].
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
    // See `restart`.
    USB_OTG_FS.doepctl(0).modify(|w| {
        w.set_epena(false);
        w.set_snak(true);
    });
}

/// Sends no packet of endpoint 0, for the HAL flushes it as it fetches a SETUP packet, and a flush needs the NAK in force
/// (RM0090 34.16.2, OTG_FS_GRSTCTL). A stage may have cleared the NAK that the SETUP packet had set.
fn hold_answer() {
    let control = USB_OTG_FS.diepctl(0);
    let held = control.read();
    if held.epena() && !held.naksts() {
        control.modify(|w| {
            w.set_epena(false);
            w.set_snak(true);
        });
        soon(|| USB_OTG_FS.diepint(0).read().inepne());
    }
}

/// Withdraws the packet in endpoint 0 after a SETUP packet, which has set the endpoint's NAK (RM0090 34.17.6, "IN
/// endpoint disable").
fn withdraw_packet() {
    let control = USB_OTG_FS.diepctl(0);
    if control.read().epena() {
        disable(control);
        soon(|| !control.read().epena());
        flush(0);
    }
}

/// Withdraws the packets in endpoints that the host will not fetch.
///
/// A bus reset leaves these endpoints enabled, and the HAL would wait forever for their packets (RM0090 34.17.6, "IN
/// endpoint disable"). TinyUSB has the same order and waits (`dcd_dwc2.c`, `edpt_disable`).
pub(crate) fn cancel_unfetched_packets() {
    for endpoint in 1..ENDPOINTS {
        let (control, flags) = (USB_OTG_FS.diepctl(endpoint), USB_OTG_FS.diepint(endpoint));
        // The HAL's interrupt handler clears an endpoint's flags.
        critical_section::with(|_| {
            if control.read().epena() {
                control.modify(|w| {
                    w.set_epena(false);
                    w.set_snak(true);
                });
                soon(|| flags.read().inepne());
                disable(control);
                soon(|| !control.read().epena());
                flush(endpoint);
            }
        });
    }
}

/// Withdraws the packet in an IN endpoint. Returns true if it was still unfetched (RM0090 34.17.6, "IN endpoint
/// disable").
pub(crate) fn cancel_unfetched_packet(endpoint: usize) -> bool {
    let (control, flags) = (USB_OTG_FS.diepctl(endpoint), USB_OTG_FS.diepint(endpoint));
    // The HAL's interrupt handler clears an endpoint's flags.
    critical_section::with(|_| {
        if !control.read().epena() {
            return false;
        }
        // Writing back EPENA as a one would restart a transfer that ended in between.
        control.modify(|w| {
            w.set_epena(false);
            w.set_snak(true);
        });
        // A packet on the wire is completed. It then counts as fetched.
        if !soon(|| flags.read().inepne()) {
            control.modify(|w| {
                w.set_epena(false);
                w.set_cnak(true);
            });
            return false;
        }
        if !control.read().epena() {
            return false;
        }
        disable(control);
        let is_back = soon(|| !control.read().epena());
        flush(endpoint) && is_back
    })
}

/// Begins to disable an IN endpoint. It answers with NAK.
fn disable(endpoint: Reg<Diepctl, RW>) {
    endpoint.modify(|w| {
        w.set_epena(false);
        w.set_snak(true);
        w.set_epdis(true);
    });
}

/// Flushes the transmit FIFO of a disabled endpoint. Returns true if it is empty.
fn flush(endpoint: usize) -> bool {
    let resets = USB_OTG_FS.grstctl();
    resets.write(|w| {
        w.set_txfnum(endpoint as u8);
        w.set_txfflsh(true);
    });
    soon(|| !resets.read().txfflsh())
}

/// Resets an endpoint's data toggle to DATA0 (USB 2.0, 9.1.1.5, 9.4.5, 9.4.10), and halts it or ends its halt. A packet
/// that waits there stays.
///
/// ST's HAL sets the STALL of an OUT endpoint in the same way. TinyUSB sets the NAK of all OUT endpoints first: the packets
/// of the others would wait for this request.
fn restart(endpoint: EndpointAddress, halted: bool) {
    let index = endpoint.index();
    // Writing back a one would restart a transfer that ended in between.
    critical_section::with(|_| match endpoint.direction() {
        Direction::In => USB_OTG_FS.diepctl(index).modify(|w| {
            w.set_epena(false);
            w.set_sd0pid_sevnfrm(true);
            w.set_stall(halted);
        }),
        Direction::Out => USB_OTG_FS.doepctl(index).modify(|w| {
            w.set_epena(false);
            w.set_sd0pid_sevnfrm(true);
            w.set_stall(halted);
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

/// Writes a packet for the host.
pub(in crate::board) fn write(endpoint: &mut HalIn, packet: &[u8]) -> impl Future<Output = Result<(), EndpointError>> {
    endpoint.write(packet)
}

/// Reads a packet of the host, and lets the endpoint accept the next one.
///
/// By the manual the controller disables the endpoint after a packet (RM0090 34.17.5); the HAL only clears its NAK.
pub(in crate::board) async fn read(endpoint: &mut HalOut, packet: &mut [u8]) -> Result<usize, EndpointError> {
    let len = endpoint.read(packet).await?;
    let control = USB_OTG_FS.doepctl(endpoint.info().addr.index());
    critical_section::with(|_| control.modify(|w| w.set_epena(true)));
    Ok(len)
}

/// Waits for an event of the bus, on which no state here depends.
pub(in crate::board) fn poll(bus: &mut HalBus) -> impl Future<Output = Event> {
    bus.poll()
}

/// Enables or disables an endpoint. Its next packet has DATA0.
pub(in crate::board) fn set_enabled(bus: &mut HalBus, endpoint: EndpointAddress, enabled: bool) {
    // The HAL would let an active endpoint accept a packet for which it has no room, and lose the packet that waits
    // there.
    if !enabled || !is_active(endpoint) {
        bus.endpoint_set_enabled(endpoint, enabled);
    }
    restart(endpoint, false);
}

/// Halts an endpoint, or ends its halt. Its next packet then has DATA0.
pub(in crate::board) fn set_stalled(bus: &mut HalBus, endpoint: EndpointAddress, stalled: bool) {
    match endpoint.index() {
        0 => bus.endpoint_set_stalled(endpoint, stalled),
        _ => restart(endpoint, stalled),
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
