//! The registers of the USB peripheral, behind [`usb_driver`](crate::board::usb_driver) and
//! [`usb_control`](crate::board::usb_control).

use core::future::Future;
use core::pin::pin;
use core::task::{Context, Poll};

use embassy_rp::interrupt::typelevel::{Handler, USBCTRL_IRQ};
use embassy_rp::pac::usb_dpram::regs::EpBufferControl;
use embassy_rp::pac::{USB, USB_DPRAM};
use embassy_rp::{peripherals, usb};
use embassy_usb::driver::{self, Bus as _, ControlPipe as _, Direction, EndpointAddress, EndpointError, Event};

use crate::board::usb_control::wake_if_over;

/// The HAL's driver and its parts.
pub(in crate::board) type Hal = usb::Driver<'static, peripherals::USB>;
pub(in crate::board) type HalBus = <Hal as driver::Driver<'static>>::Bus;
pub(in crate::board) type HalControlPipe = <Hal as driver::Driver<'static>>::ControlPipe;
pub(in crate::board) type In = <Hal as driver::Driver<'static>>::EndpointIn;
pub(in crate::board) type Out = <Hal as driver::Driver<'static>>::EndpointOut;

/// Number of endpoints in each direction.
pub(in crate::board) const ENDPOINTS: usize = 16;

/// Cycles between the content of a buffer's control and AVAILABLE, which the controller reads with another clock
/// (4.1.2.5.1).
const SETTLE_CYCLES: u32 = 12;

/// Withdraws the answer to a request that the host has ended, and wakes the task that waits for a stage of it. It runs
/// ahead of the HAL's handler.
///
/// The controller leaves the answer in the endpoint, where the host would fetch it for the next request. The task may
/// come too late.
pub(super) struct SetupHandler;

impl Handler<USBCTRL_IRQ> for SetupHandler {
    unsafe fn on_interrupt() {
        if is_over() {
            withdraw_answer();
        }
        wake_if_over();
    }
}

/// Returns true if the host has ended the current request: by another request, a bus reset or a suspend.
pub(in crate::board) fn is_over() -> bool {
    let status = USB.sie_status().read();
    status.setup_rec() || status.bus_reset() || status.suspended()
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

/// Ends the current request after the host began another one: withdraws its answer, and accepts no more data.
pub(in crate::board) fn withdraw_answer() {
    USB_DPRAM.ep_in_buffer_control(0).write(|_| {});
    USB_DPRAM.ep_out_buffer_control(0).write(|_| {});
}

/// Takes the next request.
pub(in crate::board) fn poll_request(pipe: &mut HalControlPipe, cx: &mut Context<'_>) -> Poll<[u8; 8]> {
    let request = pin!(pipe.setup()).poll(cx);
    if request.is_ready() {
        // The HAL enables it only for a task that waits for a request.
        USB.inte().modify(|w| w.set_setup_req(true));
    }
    request
}

/// Withdraws the packets in endpoints that the host will not fetch.
pub(crate) fn cancel_unfetched_packets() {
    for endpoint in 1..ENDPOINTS {
        cancel_unfetched_packet(endpoint);
    }
}

/// Withdraws the packet in an IN endpoint. Returns true if it was still unfetched.
pub(crate) fn cancel_unfetched_packet(endpoint: usize) -> bool {
    // The service and the tasks arm endpoints.
    critical_section::with(|_| {
        let buffer = USB_DPRAM.ep_in_buffer_control(endpoint);
        let held = hold(EndpointAddress::from_parts(endpoint, Direction::In));
        let is_unfetched = held.available(0);
        if is_unfetched {
            // The next packet has the toggle of this one: the HAL changes it before each.
            buffer.write(|w| w.set_pid(0, !held.pid(0)));
        }
        release();
        is_unfetched
    })
}

/// Resets an endpoint's data toggle to DATA0 (USB 2.0, 9.1.1.5, 9.4.5, 9.4.10). A packet that waits there stays.
fn reset_data_toggle(endpoint: EndpointAddress) {
    let buffer = match endpoint.direction() {
        Direction::In => USB_DPRAM.ep_in_buffer_control(endpoint.index()),
        Direction::Out => USB_DPRAM.ep_out_buffer_control(endpoint.index()),
    };
    critical_section::with(|_| {
        let mut held = hold(endpoint);
        let is_armed = held.available(0);
        // The HAL changes the toggle before it arms the endpoint.
        held.set_pid(0, !is_armed);
        held.set_available(0, false);
        buffer.write_value(held);
        if is_armed {
            cortex_m::asm::delay(SETTLE_CYCLES);
            held.set_available(0, true);
            buffer.write_value(held);
        }
        release();
    });
}

/// Makes an endpoint answer with NAK until [`release`] (4.1.2.9, EP_ABORT). Returns its buffer's control.
///
/// Chips before revision B2 ignore the request (RP2040-E2): a packet that is on the wire meanwhile may count as
/// waiting.
fn hold(endpoint: EndpointAddress) -> EpBufferControl {
    let index = endpoint.index();
    match endpoint.direction() {
        Direction::In => {
            USB.ep_abort().write(|w| w.set_ep_in(index, true));
            soon(|| USB.ep_abort_done().read().ep_in(index));
            USB_DPRAM.ep_in_buffer_control(index).read()
        }
        Direction::Out => {
            USB.ep_abort().write(|w| w.set_ep_out(index, true));
            soon(|| USB.ep_abort_done().read().ep_out(index));
            USB_DPRAM.ep_out_buffer_control(index).read()
        }
    }
}

/// Ends [`hold`].
fn release() {
    USB.ep_abort().write(|_| {});
    USB.ep_abort_done().write(|w| w.0 = u32::MAX);
}

/// Waits up to 50 µs for a condition.
fn soon(has_come: impl Fn() -> bool) {
    const TRIES: usize = 1_000;
    let _ = (0..TRIES).any(|_| has_come());
}

/// Returns true if an endpoint is in use.
fn is_active(endpoint: EndpointAddress) -> bool {
    let control = endpoint.index() - 1;
    match endpoint.direction() {
        Direction::In => USB_DPRAM.ep_in_control(control).read().enable(),
        Direction::Out => USB_DPRAM.ep_out_control(control).read().enable(),
    }
}

/// The endpoints are the HAL's.
pub(in crate::board) fn endpoint_in(endpoint: In) -> In {
    endpoint
}

/// See [`endpoint_in`].
pub(in crate::board) fn endpoint_out(endpoint: Out) -> Out {
    endpoint
}

/// No state depends on events of the bus.
pub(in crate::board) fn on_event(_: Event) {}

/// Enables or disables an endpoint. Its next packet has DATA0.
pub(in crate::board) fn set_enabled(bus: &mut HalBus, endpoint: EndpointAddress, enabled: bool) {
    if endpoint.index() == 0 {
        return;
    }
    // The HAL would lose the packet that waits in an active endpoint.
    if !enabled || !is_active(endpoint) {
        bus.endpoint_set_enabled(endpoint, enabled);
    } else {
        reset_data_toggle(endpoint);
    }
}

/// Halts an endpoint, or clears its halt. Its next packet then has DATA0.
pub(in crate::board) fn set_stalled(bus: &mut HalBus, endpoint: EndpointAddress, stalled: bool) {
    bus.endpoint_set_stalled(endpoint, stalled);
    if !stalled && endpoint.index() != 0 {
        reset_data_toggle(endpoint);
    }
}
