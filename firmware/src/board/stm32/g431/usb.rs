//! The registers of the USB peripheral, behind [`usb_driver`](crate::board::usb_driver) and
//! [`usb_control`](crate::board::usb_control).
//!
//! The HAL's driver clears a halt in a loop that never ends at NAK, and does not reset data toggles. It calls `memcpy` for
//! each half-word of a packet: the bulk endpoints access the packet memory here.
//!
//! Bits of USB_EPnR toggle if a one is written, or are cleared by a zero (RM0440 45.6.2). The controller changes them,
//! too: a write must be correct for any change since the read.

use core::future::{Future as _, poll_fn};
use core::pin::pin;
use core::sync::atomic::{AtomicBool, AtomicU8, Ordering};
use core::task::{Context, Poll};

use embassy_stm32::interrupt::typelevel::{Handler, USB_LP};
use embassy_stm32::pac::usb::regs::Epr;
use embassy_stm32::pac::usb::vals::Stat;
use embassy_stm32::pac::{USB, USBRAM};
use embassy_stm32::{peripherals, usb};
use embassy_usb::driver::{
    self, Bus as _, ControlPipe as _, Direction, Endpoint as _, EndpointAddress, EndpointError, EndpointInfo, Event,
};

use crate::board::usb_stage::{SETUP_ARRIVED, soon, wake_stage};

/// The HAL's driver and its parts.
pub(in crate::board) type Hal = usb::Driver<'static, peripherals::USB>;
pub(in crate::board) type HalBus = <Hal as driver::Driver<'static>>::Bus;
pub(in crate::board) type HalControlPipe = <Hal as driver::Driver<'static>>::ControlPipe;
pub(in crate::board) type HalIn = <Hal as driver::Driver<'static>>::EndpointIn;
pub(in crate::board) type HalOut = <Hal as driver::Driver<'static>>::EndpointOut;

/// The endpoint registers of the controller.
pub(in crate::board) const ENDPOINTS: usize = 8;

/// The bus was reset or suspended, and the HAL has not been notified.
static BUS_EVENT_PENDING: AtomicBool = AtomicBool::new(false);
/// Endpoints with a packet that the host has not fetched, as a bit mask.
static ARMED: AtomicU8 = AtomicU8::new(0);
/// Endpoints with an unread packet of the host, as a bit mask.
static UNREAD: AtomicU8 = AtomicU8::new(0);

/// Records the events that the HAL's handler clears. It runs ahead of that handler.
pub(super) struct EventHandler;

impl Handler<USB_LP> for EventHandler {
    unsafe fn on_interrupt() {
        let events = USB.istr().read();
        if events.reset() || events.susp() {
            BUS_EVENT_PENDING.store(true, Ordering::Relaxed);
        }
        if events.ctr() {
            let index = usize::from(events.ep_id());
            let endpoint = USB.epr(index).read();
            if endpoint.ctr_rx() && index == 0 && endpoint.setup() {
                SETUP_ARRIVED.store(true, Ordering::Relaxed);
            } else if endpoint.ctr_rx() {
                UNREAD.fetch_or(1 << index, Ordering::Relaxed);
            }
            if endpoint.ctr_tx() {
                ARMED.fetch_and(!(1 << index), Ordering::Relaxed);
                if index == 0 {
                    wake_stage();
                }
            }
        }
        if is_over() {
            wake_stage();
        }
    }
}

/// Returns true if a SETUP packet arrived that no interrupt handler has processed.
fn is_setup_waiting() -> bool {
    let endpoint = USB.epr(0).read();
    endpoint.ctr_rx() && endpoint.setup()
}

/// Returns true if the host has ended the current request: by another request, a bus reset or a suspend.
pub(in crate::board) fn is_over() -> bool {
    let events = USB.istr().read();
    SETUP_ARRIVED.load(Ordering::Relaxed)
        || BUS_EVENT_PENDING.load(Ordering::Relaxed)
        || is_setup_waiting()
        || events.reset()
        || events.susp()
}

/// The value whose write leaves USB_EPnR unchanged.
fn unchanged(mut register: Epr) -> Epr {
    register.set_ctr_rx(true);
    register.set_ctr_tx(true);
    register.set_dtog_rx(false);
    register.set_dtog_tx(false);
    register.set_stat_rx(Stat::from_bits(0));
    register.set_stat_tx(Stat::from_bits(0));
    register
}

fn status(endpoint: EndpointAddress) -> Stat {
    let register = USB.epr(endpoint.index()).read();
    match endpoint.direction() {
        Direction::In => register.stat_tx(),
        Direction::Out => register.stat_rx(),
    }
}

/// Sets the status of an endpoint. If the controller changes it between the read and the write, which it does at VALID
/// only, the result is another.
fn set_status(endpoint: EndpointAddress, status: Stat) {
    let register = USB.epr(endpoint.index());
    let now = register.read();
    let mut change = unchanged(now);
    match endpoint.direction() {
        Direction::In => change.set_stat_tx(Stat::from_bits(now.stat_tx().to_bits() ^ status.to_bits())),
        Direction::Out => change.set_stat_rx(Stat::from_bits(now.stat_rx().to_bits() ^ status.to_bits())),
    }
    register.write_value(change);
}

/// Resets an endpoint's data toggle to DATA0 (USB 2.0, 9.1.1.5, 9.4.5, 9.4.10).
fn reset_data_toggle(endpoint: EndpointAddress) {
    critical_section::with(|_| {
        let register = USB.epr(endpoint.index());
        let now = register.read();
        let mut change = unchanged(now);
        match endpoint.direction() {
            Direction::In => change.set_dtog_tx(now.dtog_tx()),
            Direction::Out => change.set_dtog_rx(now.dtog_rx()),
        }
        register.write_value(change);
    });
}

/// Sets endpoint 0 to NAK in both directions, the state after a SETUP packet, which the HAL assumes.
pub(in crate::board) fn withdraw_answer() {
    const TRIES: usize = 4;
    let ways = [Direction::In, Direction::Out].map(|way| EndpointAddress::from_parts(0, way));
    // Another SETUP packet may arrive in between with the same effect.
    for _ in 0..TRIES {
        for way in ways {
            if status(way) != Stat::NAK {
                set_status(way, Stat::NAK);
            }
        }
    }
}

/// Arms a packet of an answer once the host has fetched the one before.
///
/// The HAL's stage arms a packet even if the next request arrived while the packet was copied, which takes longer than the
/// host needs for its next token: the host would fetch it as the answer to that request.
pub(in crate::board) async fn data_in(
    _: &mut HalControlPipe,
    data: &[u8],
    first: bool,
    last: bool,
) -> Result<(), EndpointError> {
    let address = EndpointAddress::from_parts(0, Direction::In);
    poll_fn(|_| match status(address) {
        Stat::NAK => Poll::Ready(()),
        _ => Poll::Pending,
    })
    .await;
    store(0, data);
    if is_over() {
        return Err(EndpointError::Disabled);
    }
    // A SETUP packet leaves OUT at NAK. It is at STALL until the last packet, which a status stage follows.
    let before = if first { Stat::NAK } else { Stat::STALL };
    let after = if last { Stat::VALID } else { Stat::STALL };
    let register = USB.epr(0);
    let mut change = unchanged(register.read());
    change.set_stat_rx(Stat::from_bits(before.to_bits() ^ after.to_bits()));
    change.set_stat_tx(Stat::from_bits(Stat::NAK.to_bits() ^ Stat::VALID.to_bits()));
    change.set_ep_kind(last);
    register.write_value(change);
    Ok(())
}

/// Withdraws the packet in an IN endpoint. Returns true if it was still unfetched.
pub(crate) fn cancel_unfetched_packet(endpoint: usize) -> bool {
    let bit = 1 << endpoint;
    let address = EndpointAddress::from_parts(endpoint, Direction::In);
    let is_armed = || ARMED.load(Ordering::Relaxed) & bit != 0;
    if !is_armed() {
        return false;
    }
    let before = critical_section::with(|_| {
        let before = status(address);
        if before == Stat::VALID {
            // The host's acknowledgement sets NAK. An acknowledgement between the read and the write of the register makes
            // this write set STALL, until the loop below: the host's next token comes later.
            set_status(address, Stat::DISABLED);
            // An acknowledgement here makes a write set DISABLED, which the loop repeats.
            while status(address) != Stat::NAK {
                set_status(address, Stat::NAK);
            }
        }
        before
    });
    match before {
        // A packet on the wire is completed, and counts as fetched.
        Stat::VALID => drop(soon(|| !is_armed())),
        Stat::NAK => forget_fetched(address),
        _ => {}
    }
    ARMED.fetch_and(!bit, Ordering::Relaxed) & bit != 0
}

/// Clears the record of a packet that the host has fetched. Its event is not recorded if it comes between the reads of
/// the register by [`EventHandler`] and by the HAL's handler.
fn forget_fetched(endpoint: EndpointAddress) {
    if endpoint.direction() == Direction::In && status(endpoint) == Stat::NAK {
        ARMED.fetch_and(!(1 << endpoint.index()), Ordering::Relaxed);
    }
}

/// Clears the record of unfetched packets: a bus reset has disabled the endpoints.
pub(crate) fn cancel_unfetched_packets() {
    ARMED.store(0, Ordering::Relaxed);
}

/// Writes a packet for the host.
pub(in crate::board) async fn write(endpoint: &mut HalIn, packet: &[u8]) -> Result<(), EndpointError> {
    let &EndpointInfo {
        addr: address,
        max_packet_size,
        ..
    } = endpoint.info();
    if packet.len() > max_packet_size.into() {
        return Err(EndpointError::BufferOverflow);
    }
    wait_for_nak(endpoint, address).await?;
    store(address.index(), packet);
    set_status(address, Stat::VALID);
    critical_section::with(|_| {
        // The host may have fetched it already. Or a bus reset occurred just now, and it will not be fetched.
        if status(address) != Stat::NAK {
            ARMED.fetch_or(1 << address.index(), Ordering::Relaxed);
        }
    });
    Ok(())
}

/// Reads a packet of the host.
pub(in crate::board) async fn read(endpoint: &mut HalOut, packet: &mut [u8]) -> Result<usize, EndpointError> {
    let address = endpoint.info().addr;
    match wait_for_nak(endpoint, address).await {
        // The packet was acknowledged: the host will not repeat it.
        Err(EndpointError::Disabled) if take_unread(address) => return fetch(address.index(), packet),
        waited => waited?,
    }
    let len = fetch(address.index(), packet)?;
    set_status(address, Stat::VALID);
    critical_section::with(|_| {
        // The host's next packet may have arrived.
        if status(address) == Stat::VALID {
            UNREAD.fetch_and(!(1 << address.index()), Ordering::Relaxed);
        }
    });
    Ok(len)
}

/// Marks an endpoint's packet as read. Returns true if there was one.
fn take_unread(endpoint: EndpointAddress) -> bool {
    let bit = 1 << endpoint.index();
    UNREAD.fetch_and(!bit, Ordering::Relaxed) & bit != 0
}

/// Waits until the controller has no access to the endpoint's packet. An error if the endpoint is disabled.
async fn wait_for_nak(endpoint: &mut impl driver::Endpoint, address: EndpointAddress) -> Result<(), EndpointError> {
    poll_fn(|cx| {
        // This registers the waker that the HAL's handler wakes after a packet and after a reset.
        let _ = pin!(endpoint.wait_enabled()).poll(cx);
        match status(address) {
            Stat::NAK => Poll::Ready(Ok(())),
            Stat::DISABLED => Poll::Ready(Err(EndpointError::Disabled)),
            _ => Poll::Pending,
        }
    })
    .await
}

/// Writes a packet for the host to an endpoint's buffer, whose address is in its descriptor (RM0440 45.6.3).
fn store(endpoint: usize, packet: &[u8]) {
    let descriptor = 4 * endpoint;
    let start = usize::from(USBRAM.mem(descriptor).read()) / 2;
    let (pairs, last) = packet.as_chunks();
    for (place, pair) in (start..).zip(pairs) {
        USBRAM.mem(place).write_value(u16::from_le_bytes(*pair));
    }
    if let [last] = last {
        USBRAM.mem(start + pairs.len()).write_value((*last).into());
    }
    USBRAM.mem(descriptor + 1).write_value(packet.len() as u16);
}

/// Reads the host's packet from an endpoint's buffer (RM0440 45.6.3).
fn fetch(endpoint: usize, packet: &mut [u8]) -> Result<usize, EndpointError> {
    const COUNT: u16 = 0x3FF;
    let descriptor = 4 * endpoint;
    let start = usize::from(USBRAM.mem(descriptor + 2).read()) / 2;
    let len = usize::from(USBRAM.mem(descriptor + 3).read() & COUNT);
    let packet = packet.get_mut(..len).ok_or(EndpointError::BufferOverflow)?;
    let (pairs, last) = packet.as_chunks_mut();
    for (place, pair) in (start..).zip(&mut *pairs) {
        *pair = USBRAM.mem(place).read().to_le_bytes();
    }
    if let [last] = last {
        [*last, _] = USBRAM.mem(start + pairs.len()).read().to_le_bytes();
    }
    Ok(len)
}

/// Waits for an event of the bus, and ends what it ends.
pub(in crate::board) async fn poll(bus: &mut HalBus) -> Event {
    let event = bus.poll().await;
    match event {
        Event::Reset => {
            // A write in progress may have changed an endpoint after the reset.
            critical_section::with(|_| {
                withdraw_answer();
                disable_all();
            });
            BUS_EVENT_PENDING.store(false, Ordering::Relaxed);
            SETUP_ARRIVED.store(false, Ordering::Relaxed);
        }
        Event::Suspend => BUS_EVENT_PENDING.store(false, Ordering::Relaxed),
        _ => {}
    }
    event
}

/// Halts an endpoint, unless it is disabled. If the host's acknowledgement comes between a read and a write of the
/// register, the write sets DISABLED instead, and is repeated. The HAL's loop ends there.
fn halt(endpoint: EndpointAddress) {
    critical_section::with(|_| {
        if endpoint.index() != 0 && status(endpoint) != Stat::DISABLED {
            while status(endpoint) != Stat::STALL {
                set_status(endpoint, Stat::STALL);
            }
        }
    });
}

/// Disables all endpoints but 0.
fn disable_all() {
    for index in 1..ENDPOINTS {
        for way in [Direction::In, Direction::Out] {
            set_status(EndpointAddress::from_parts(index, way), Stat::DISABLED);
        }
    }
}

/// Enables or disables an endpoint. Its next packet has DATA0.
pub(in crate::board) fn set_enabled(bus: &mut HalBus, endpoint: EndpointAddress, enabled: bool) {
    // The HAL would let an active endpoint accept a packet for which it has no room, and lose the packet that waits
    // there.
    if !enabled || status(endpoint) == Stat::DISABLED {
        bus.endpoint_set_enabled(endpoint, enabled);
        if enabled {
            // This comes before the host's next packet: an unread packet stays.
            set_status(endpoint, idle_status(endpoint));
        }
        reset_data_toggle(endpoint);
    } else {
        set_stalled(bus, endpoint, false);
    }
}

/// Halts an endpoint, or ends its halt. Its next packet then has DATA0.
pub(in crate::board) fn set_stalled(bus: &mut HalBus, endpoint: EndpointAddress, stalled: bool) {
    let was_stalled = status(endpoint) == Stat::STALL;
    if stalled {
        forget_fetched(endpoint);
        halt(endpoint);
        // This wakes the task that waits for it.
        bus.endpoint_set_stalled(endpoint, true);
    } else if endpoint.index() != 0 {
        reset_data_toggle(endpoint);
        if was_stalled {
            // It is already stalled: this wakes the task that waits for it.
            bus.endpoint_set_stalled(endpoint, true);
            set_status(endpoint, idle_status(endpoint));
        }
    }
}

/// The status of an endpoint with or without a packet.
fn idle_status(endpoint: EndpointAddress) -> Stat {
    let waits = |packets: &AtomicU8| packets.load(Ordering::Relaxed) >> endpoint.index() & 1 != 0;
    let is_valid = match endpoint.direction() {
        Direction::In => waits(&ARMED),
        Direction::Out => !waits(&UNREAD),
    };
    if is_valid { Stat::VALID } else { Stat::NAK }
}

/// Takes the next request, if there is one.
pub(in crate::board) fn poll_request(pipe: &mut HalControlPipe, cx: &mut Context<'_>) -> Poll<[u8; 8]> {
    let Poll::Ready(request) = pin!(pipe.setup()).poll(cx) else {
        return Poll::Pending;
    };
    if is_setup_waiting() {
        // Another arrived while this one was read. The interrupt handlers have not processed it yet.
        cx.waker().wake_by_ref();
        return Poll::Pending;
    }
    Poll::Ready(request)
}
