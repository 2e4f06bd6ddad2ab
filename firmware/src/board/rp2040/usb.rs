//! The driver of the USB peripheral, and the withdrawal of packets from its endpoints.

use embassy_rp::pac::{USB, USB_DPRAM};
use embassy_rp::{peripherals, usb};

pub(crate) type UsbDriver = usb::Driver<'static, peripherals::USB>;

/// Number of endpoints in each direction.
const ENDPOINTS: usize = 16;

/// Withdraws the packets in endpoints that the host will not fetch.
pub(crate) fn cancel_unfetched_packets() {
    for endpoint in 1..ENDPOINTS {
        cancel_unfetched_packet(endpoint);
    }
}

/// Withdraws the packet in an IN endpoint. Returns true if it was still unfetched (4.1.2.9, EP_ABORT).
///
/// Chips before revision B2 ignore the request (RP2040-E2). The endpoint is then read and written without it: a packet that
/// is on the wire meanwhile counts as unfetched, and the host receives it, too.
pub(crate) fn cancel_unfetched_packet(endpoint: usize) -> bool {
    let buffer = USB_DPRAM.ep_in_buffer_control(endpoint);
    // The service and the tasks arm endpoints.
    critical_section::with(|_| {
        if !buffer.read().available(0) {
            return false;
        }
        USB.ep_abort().modify(|w| w.set_ep_in(endpoint, true));
        soon(|| USB.ep_abort_done().read().ep_in(endpoint));
        let is_unfetched = buffer.read().available(0);
        if is_unfetched {
            // The next packet has the number of this one: the HAL changes it before each.
            let number = !buffer.read().pid(0);
            buffer.write(|w| w.set_pid(0, number));
        }
        USB.ep_abort_done().write(|w| w.set_ep_in(endpoint, true));
        USB.ep_abort().modify(|w| w.set_ep_in(endpoint, false));
        is_unfetched
    })
}

/// Waits up to 50 µs for a condition.
fn soon(has_come: impl Fn() -> bool) {
    const TRIES: usize = 1_000;
    let _ = (0..TRIES).any(|_| has_come());
}
