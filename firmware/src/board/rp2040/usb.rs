//! The registers of the USB peripheral, behind [`usb_driver`](crate::board::usb_driver) and
//! [`usb_control`](crate::board::usb_control).

use core::future::{Future, poll_fn};
use core::pin::pin;
use core::sync::atomic::{AtomicBool, Ordering};
use core::task::{Context, Poll};

use embassy_rp::interrupt::typelevel::{Handler, USBCTRL_IRQ};
use embassy_rp::pac::common::{RW, Reg};
use embassy_rp::pac::usb_dpram::regs::EpBufferControl;
use embassy_rp::pac::{SYSINFO, USB, USB_DPRAM};
use embassy_rp::{peripherals, usb};
use embassy_sync::waitqueue::AtomicWaker;
use embassy_usb::driver::{
    self, Bus as _, ControlPipe as _, Direction, Endpoint as _, EndpointAddress, EndpointError, EndpointIn as _,
    EndpointOut as _, Event,
};

use super::connect::connect;
use super::frame;
use crate::board::usb_stage::{soon, wake_stage};

/// The HAL's driver and its parts.
pub(in crate::board) type Hal = usb::Driver<'static, peripherals::USB>;
pub(in crate::board) type HalBus = <Hal as driver::Driver<'static>>::Bus;
pub(in crate::board) type HalControlPipe = <Hal as driver::Driver<'static>>::ControlPipe;
pub(in crate::board) type HalIn = <Hal as driver::Driver<'static>>::EndpointIn;
pub(in crate::board) type HalOut = <Hal as driver::Driver<'static>>::EndpointOut;

/// Number of endpoints in each direction.
pub(in crate::board) const ENDPOINTS: usize = 16;

/// The revision B2 in CHIP_ID (2.20.2).
const REVISION_B2: u8 = 2;

/// A task waits, or has waited since the last frame.
static WAITS_FOR_FRAME: AtomicBool = AtomicBool::new(false);

/// The tasks that wait for the next frame with a packet, by their endpoints.
static FRAME_STARTED: [AtomicWaker; ENDPOINTS] = [const { AtomicWaker::new() }; ENDPOINTS];

/// The bus was reset since the last wait for an event.
static WAS_RESET: AtomicBool = AtomicBool::new(false);

/// Time of a packet on the wire in microseconds, with a margin.
const PACKET_MICROS: u32 = 70;

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
        if frame::note_start() {
            // A wake costs time even without a task.
            if WAITS_FOR_FRAME.load(Ordering::Relaxed) {
                WAITS_FOR_FRAME.store(false, Ordering::Relaxed);
                FRAME_STARTED.iter().for_each(AtomicWaker::wake);
            }
        }
        if is_over() {
            withdraw_answer();
            wake_stage();
        }
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
    if pin!(pipe.setup()).poll(cx).is_pending() {
        return Poll::Pending;
    }
    // The HAL enables it only for a task that waits for a request.
    USB.inte().modify(|w| w.set_setup_req(true));
    // The packet is read again: another may have come while the HAL read it and cleared its flag.
    let low = USB_DPRAM.setup_packet_low().read().0;
    let high = USB_DPRAM.setup_packet_high().read().0;
    if USB.sie_status().read().setup_rec() {
        // One has come since, possibly during this read.
        cx.waker().wake_by_ref();
        return Poll::Pending;
    }
    Poll::Ready((u64::from(high) << 32 | u64::from(low)).to_le_bytes())
}

/// Withdraws the packets in endpoints that the host will not fetch.
pub(crate) fn cancel_unfetched_packets() {
    for endpoint in 1..ENDPOINTS {
        cancel_unfetched_packet(endpoint);
    }
}

/// Withdraws the packet in an IN endpoint. Returns true if it was still unfetched.
pub(crate) fn cancel_unfetched_packet(endpoint: usize) -> bool {
    held(
        EndpointAddress::from_parts(endpoint, Direction::In),
        |buffer, is_unfetched| {
            if is_unfetched {
                let mut control = buffer.read();
                // The next packet has the toggle of this one: the HAL changes it before each.
                control.set_pid(0, !control.pid(0));
                control.set_available(0, false);
                buffer.write_value(control);
            }
            is_unfetched
        },
    )
}

/// Resets an endpoint's data toggle to DATA0 (USB 2.0, 9.1.1.5, 9.4.5, 9.4.10), and halts it or ends its halt. A packet
/// that waits there stays.
fn restart(bus: &mut HalBus, endpoint: EndpointAddress, halted: bool) {
    if endpoint.is_in() && buffer(endpoint).read().available(0) {
        // The packet may be on the wire.
        frame::wait_for_time(PACKET_MICROS);
    }
    held(endpoint, |buffer, is_armed| {
        bus.endpoint_set_stalled(endpoint, halted);
        let mut control = buffer.read();
        // The HAL changes the toggle before it arms the endpoint.
        control.set_pid(0, !is_armed);
        control.set_available(0, false);
        buffer.write_value(control);
        if is_armed {
            cortex_m::asm::delay(SETTLE_CYCLES);
            control.set_available(0, true);
            buffer.write_value(control);
        }
    });
}

/// The control of an endpoint's buffer.
fn buffer(endpoint: EndpointAddress) -> Reg<EpBufferControl, RW> {
    match endpoint.direction() {
        Direction::In => USB_DPRAM.ep_in_buffer_control(endpoint.index()),
        Direction::Out => USB_DPRAM.ep_out_buffer_control(endpoint.index()),
    }
}

/// Calls `change` with the control of an endpoint's buffer, and with true if a packet waits there. The endpoint answers with
/// NAK meanwhile (4.1.2.9, EP_ABORT).
///
/// Before revision B2 all endpoints would answer with NAK from then on (RP2040-E2): there a packet on the wire is waited for
/// without it.
fn held<R>(endpoint: EndpointAddress, change: impl FnOnce(Reg<EpBufferControl, RW>, bool) -> R) -> R {
    let (buffer, index) = (buffer(endpoint), endpoint.index());
    // The service and the tasks arm endpoints.
    critical_section::with(|_| {
        if is_before_b2() {
            let is_waiting = take_back(endpoint);
            return change(buffer, is_waiting);
        }
        match endpoint.direction() {
            Direction::In => {
                USB.ep_abort().write(|w| w.set_ep_in(index, true));
                soon(|| USB.ep_abort_done().read().ep_in(index));
            }
            Direction::Out => {
                USB.ep_abort().write(|w| w.set_ep_out(index, true));
                soon(|| USB.ep_abort_done().read().ep_out(index));
            }
        }
        let result = change(buffer, buffer.read().available(0));
        USB.ep_abort().write(|_| {});
        USB.ep_abort_done().write(|w| w.0 = u32::MAX);
        result
    })
}

/// Returns true if the chip has the errata of the revisions before B2.
fn is_before_b2() -> bool {
    SYSINFO.chip_id().read().revision() < REVISION_B2
}

/// Takes the packet of an endpoint from the controller, and waits for its end if it is on the wire. Returns true if it waits.
fn take_back(endpoint: EndpointAddress) -> bool {
    let (buffer, index) = (buffer(endpoint), endpoint.index());
    let mut control = buffer.read();
    if !control.available(0) {
        return false;
    }
    control.set_available(0, false);
    buffer.write_value(control);
    let has_ended = soon(|| {
        let status = USB.buff_status().read();
        match endpoint.direction() {
            Direction::In => status.ep_in(index),
            Direction::Out => status.ep_out(index),
        }
    });
    !has_ended
}

/// Returns true if an endpoint is in use.
fn is_active(endpoint: EndpointAddress) -> bool {
    let control = endpoint.index() - 1;
    match endpoint.direction() {
        Direction::In => USB_DPRAM.ep_in_control(control).read().enable(),
        Direction::Out => USB_DPRAM.ep_out_control(control).read().enable(),
    }
}

/// Writes a packet for the host.
pub(in crate::board) async fn write(endpoint: &mut HalIn, packet: &[u8]) -> Result<(), EndpointError> {
    wait_for_buffer(endpoint).await;
    let index = endpoint.info().addr.index();
    poll_fn(|cx| {
        // No handler comes between the check of the time and the packet.
        critical_section::with(|_| {
            // This comes before the check: the frame may start in between.
            FRAME_STARTED[index].register(cx.waker());
            WAITS_FOR_FRAME.store(true, Ordering::Relaxed);
            if !frame::has_time() {
                return Poll::Pending;
            }
            pin!(endpoint.write(packet)).poll(cx)
        })
    })
    .await
}

/// Reads a packet of the host.
pub(in crate::board) async fn read(endpoint: &mut HalOut, packet: &mut [u8]) -> Result<usize, EndpointError> {
    wait_for_buffer(endpoint).await;
    endpoint.read(packet).await
}

/// Waits until the controller has no access to an endpoint's packet, and the endpoint is not halted. The HAL would end
/// the halt with the next packet.
async fn wait_for_buffer(endpoint: &mut impl driver::Endpoint) {
    let buffer = buffer(endpoint.info().addr);
    poll_fn(|cx| {
        // This registers the waker that the HAL wakes after a packet and at the end of a halt.
        let _ = pin!(endpoint.wait_enabled()).poll(cx);
        let control = buffer.read();
        match control.available(0) || control.stall() {
            true => Poll::Pending,
            false => Poll::Ready(()),
        }
    })
    .await;
}

/// Waits for an event of the bus. After a reset it ends that first.
pub(in crate::board) async fn poll(bus: &mut HalBus) -> Event {
    if WAS_RESET.load(Ordering::Relaxed) && is_before_b2() {
        // A request ends the wait, and another one begins.
        connect().await;
    }
    WAS_RESET.store(false, Ordering::Relaxed);
    let event = bus.poll().await;
    if event == Event::Reset {
        WAS_RESET.store(true, Ordering::Relaxed);
        frame::enable_interrupt();
    }
    event
}

/// Enables or disables an endpoint. Its next packet has DATA0.
pub(in crate::board) fn set_enabled(bus: &mut HalBus, endpoint: EndpointAddress, enabled: bool) {
    if endpoint.index() == 0 {
        return;
    }
    // The HAL would lose the packet that waits in an active endpoint.
    if !enabled || !is_active(endpoint) {
        bus.endpoint_set_enabled(endpoint, enabled);
    } else {
        restart(bus, endpoint, false);
    }
}

/// Halts an endpoint, or ends its halt. Its next packet then has DATA0.
pub(in crate::board) fn set_stalled(bus: &mut HalBus, endpoint: EndpointAddress, stalled: bool) {
    match endpoint.index() {
        0 => bus.endpoint_set_stalled(endpoint, stalled),
        _ => restart(bus, endpoint, stalled),
    }
}
