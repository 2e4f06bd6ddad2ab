//! The driver of the USB peripheral: the HAL's, which here also gets over a host that gives up a request, clears a halt or
//! configures again, and which can take back a packet.
//!
//! The HAL's waits for the end of each stage of a request, though the host may begin another request at any time (USB 2.0,
//! 8.5.3) or reset the bus; it clears a halt in a loop that never ends at NAK; and it leaves data toggles as they are.
//!
//! Bits of USB_EPnR toggle when a one is written, or are cleared by a zero (RM0440 45.6.2). The controller changes them, too:
//! what is written must be right whatever it has done since they were read.

use core::future::{Future, poll_fn};
use core::pin::pin;
use core::sync::atomic::{AtomicBool, AtomicU8, Ordering};
use core::task::Poll;

use embassy_stm32::interrupt::typelevel::{Handler, USB_LP};
use embassy_stm32::pac::usb::regs::Epr;
use embassy_stm32::pac::usb::vals::Stat;
use embassy_stm32::pac::{USB, USBRAM};
use embassy_stm32::{peripherals, usb};
use embassy_sync::waitqueue::AtomicWaker;
use embassy_time::{Duration, Instant};
use embassy_usb::driver::{
    self, Direction, Endpoint as _, EndpointAddress, EndpointAllocError, EndpointError, EndpointInfo, EndpointType,
    Event, Unsupported,
};

/// The HAL's driver and what it consists of.
type Hal = usb::Driver<'static, peripherals::USB>;
type HalBus = <Hal as driver::Driver<'static>>::Bus;
type HalControlPipe = <Hal as driver::Driver<'static>>::ControlPipe;
type HalIn = <Hal as driver::Driver<'static>>::EndpointIn;
type HalOut = <Hal as driver::Driver<'static>>::EndpointOut;

/// The endpoint registers of the controller.
const ENDPOINTS: usize = 8;

/// The time of a packet of 64 bytes and its handshake on the wire, with some to spare.
const PACKET_TIME: Duration = Duration::from_micros(60);

/// A SETUP packet came since the last request was taken.
static IS_SET_UP: AtomicBool = AtomicBool::new(false);
/// The bus was reset or suspended, and the HAL has not been told.
static IS_LEFT: AtomicBool = AtomicBool::new(false);
/// The task that waits for the end of a stage.
static WAITING: AtomicWaker = AtomicWaker::new();
/// The endpoints in which a packet waits for the host to fetch it, by bits.
static ARMED: AtomicU8 = AtomicU8::new(0);
/// The endpoints in which a packet of the host waits to be read, by bits.
static UNREAD: AtomicU8 = AtomicU8::new(0);

/// Notes what the HAL's handler, which comes behind it, clears.
pub(super) struct EventHandler;

impl Handler<USB_LP> for EventHandler {
    unsafe fn on_interrupt() {
        let events = USB.istr().read();
        if events.reset() || events.susp() {
            IS_LEFT.store(true, Ordering::Relaxed);
        }
        if events.ctr() {
            let index = usize::from(events.ep_id());
            let endpoint = USB.epr(index).read();
            if endpoint.ctr_rx() && index == 0 && endpoint.setup() {
                IS_SET_UP.store(true, Ordering::Relaxed);
            } else if endpoint.ctr_rx() {
                UNREAD.fetch_or(1 << index, Ordering::Relaxed);
            }
            if endpoint.ctr_tx() {
                ARMED.fetch_and(!(1 << index), Ordering::Relaxed);
            }
        }
        if is_over() {
            WAITING.wake();
        }
    }
}

/// Whether a SETUP packet came that no interrupt handler has seen yet.
fn setup_waits() -> bool {
    let endpoint = USB.epr(0).read();
    endpoint.ctr_rx() && endpoint.setup()
}

/// Whether the request under way is over for the host: it began another, or the bus was reset or suspended.
fn is_over() -> bool {
    let events = USB.istr().read();
    IS_SET_UP.load(Ordering::Relaxed)
        || IS_LEFT.load(Ordering::Relaxed)
        || setup_waits()
        || events.reset()
        || events.susp()
}

/// The value that changes nothing when it is written to USB_EPnR.
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

/// Changes the status of an endpoint that the controller leaves as it is: one that is disabled, at STALL or at NAK.
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

/// Lets an endpoint begin at DATA0 (USB 2.0, 9.1.1.5, 9.4.5, 9.4.10).
fn start_at_data0(endpoint: EndpointAddress) {
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

/// Lets endpoint 0 answer NAK both ways, as a SETUP packet leaves it and as the HAL takes it to be.
fn settle_endpoint_0() {
    const TRIES: usize = 4;
    let ways = [Direction::In, Direction::Out].map(|way| EndpointAddress::from_parts(0, way));
    // Another SETUP packet may come in between and do the same.
    for _ in 0..TRIES {
        for way in ways {
            if status(way) != Stat::NAK {
                set_status(way, Stat::NAK);
            }
        }
    }
}

/// Waits for the end of a stage of a request. `None` once the request is over for the host.
async fn unless_over<R>(stage: impl Future<Output = R>) -> Option<R> {
    let mut stage = pin!(stage);
    poll_fn(|cx| {
        WAITING.register(cx.waker());
        // A packet that is armed just as the host begins another request is taken back before the host fetches it.
        critical_section::with(|_| {
            if !is_over() {
                let polled = stage.as_mut().poll(cx).map(Some);
                if !is_over() {
                    return polled;
                }
            }
            settle_endpoint_0();
            Poll::Ready(None)
        })
    })
    .await
}

/// Takes back the packet that waits in an IN endpoint for the host to fetch it. Returns whether there was one.
pub(crate) fn cancel_unfetched_packet(endpoint: usize) -> bool {
    let bit = 1 << endpoint;
    let address = EndpointAddress::from_parts(endpoint, Direction::In);
    let is_armed = || ARMED.load(Ordering::Relaxed) & bit != 0;
    if !is_armed() {
        return false;
    }
    let was_valid = critical_section::with(|_| {
        let was_valid = status(address) == Stat::VALID;
        if was_valid {
            // If the host fetches it just now, the endpoint is at NAK, and this makes it STALL, until the next line: the
            // host takes longer than that for its next token.
            set_status(address, Stat::DISABLED);
            set_status(address, Stat::NAK);
        }
        was_valid
    });
    if was_valid {
        // A packet on the wire goes on to its end. Then it was fetched.
        let start = Instant::now();
        while is_armed() && start.elapsed() < PACKET_TIME {}
    }
    ARMED.fetch_and(!bit, Ordering::Relaxed) & bit != 0
}

/// Forgets what waits in an endpoint for a host that will not fetch it: a bus reset has disabled the endpoints.
pub(crate) fn cancel_unfetched_packets() {
    ARMED.store(0, Ordering::Relaxed);
}

/// The driver.
pub(crate) struct UsbDriver(pub(super) Hal);

impl driver::Driver<'static> for UsbDriver {
    type EndpointOut = Out;
    type EndpointIn = In;
    type ControlPipe = ControlPipe;
    type Bus = Bus;

    fn alloc_endpoint_out(
        &mut self,
        kind: EndpointType,
        address: Option<EndpointAddress>,
        max_packet_size: u16,
        interval_ms: u8,
    ) -> Result<Out, EndpointAllocError> {
        let endpoint = self.0.alloc_endpoint_out(kind, address, max_packet_size, interval_ms);
        endpoint.map(Out)
    }

    fn alloc_endpoint_in(
        &mut self,
        kind: EndpointType,
        address: Option<EndpointAddress>,
        max_packet_size: u16,
        interval_ms: u8,
    ) -> Result<In, EndpointAllocError> {
        let endpoint = self.0.alloc_endpoint_in(kind, address, max_packet_size, interval_ms);
        endpoint.map(In)
    }

    fn start(self, control_max_packet_size: u16) -> (Bus, ControlPipe) {
        let (bus, control) = self.0.start(control_max_packet_size);
        (Bus(bus), ControlPipe(control))
    }
}

/// An endpoint to the host.
pub(crate) struct In(HalIn);

impl driver::Endpoint for In {
    fn info(&self) -> &EndpointInfo {
        self.0.info()
    }

    async fn wait_enabled(&mut self) {
        self.0.wait_enabled().await;
    }
}

impl driver::EndpointIn for In {
    async fn write(&mut self, packet: &[u8]) -> Result<(), EndpointError> {
        self.0.write(packet).await?;
        let address = self.0.info().addr;
        critical_section::with(|_| {
            // The host may have fetched it already. Or a bus reset came just now, and nobody will.
            if status(address) != Stat::NAK {
                ARMED.fetch_or(1 << address.index(), Ordering::Relaxed);
            }
        });
        Ok(())
    }
}

/// An endpoint from the host.
pub(crate) struct Out(HalOut);

impl driver::Endpoint for Out {
    fn info(&self) -> &EndpointInfo {
        self.0.info()
    }

    async fn wait_enabled(&mut self) {
        self.0.wait_enabled().await;
    }
}

impl driver::EndpointOut for Out {
    async fn read(&mut self, packet: &mut [u8]) -> Result<usize, EndpointError> {
        let address = self.0.info().addr;
        let len = match self.0.read(packet).await {
            // The host knows that the packet has arrived, and sends it no more.
            Err(EndpointError::Disabled) if take_unread(address) => return fetch(address.index(), packet),
            read => read?,
        };
        critical_section::with(|_| {
            // The host's next packet may be there already.
            if status(address) == Stat::VALID {
                UNREAD.fetch_and(!(1 << address.index()), Ordering::Relaxed);
            }
        });
        Ok(len)
    }
}

/// Takes note that the packet that waits in an endpoint is read. Returns whether there was one.
fn take_unread(endpoint: EndpointAddress) -> bool {
    let bit = 1 << endpoint.index();
    UNREAD.fetch_and(!bit, Ordering::Relaxed) & bit != 0
}

/// Reads the packet that an endpoint had received when a bus reset disabled it, from where its descriptor says (RM0440
/// 45.6.3).
fn fetch(endpoint: usize, packet: &mut [u8]) -> Result<usize, EndpointError> {
    const COUNT: u16 = 0x3FF;
    let descriptor = 4 * endpoint;
    let start = usize::from(USBRAM.mem(descriptor + 2).read()) / 2;
    let len = usize::from(USBRAM.mem(descriptor + 3).read() & COUNT);
    let packet = packet.get_mut(..len).ok_or(EndpointError::BufferOverflow)?;
    for (place, bytes) in (start..).zip(packet.chunks_mut(2)) {
        for (byte, value) in bytes.iter_mut().zip(USBRAM.mem(place).read().to_le_bytes()) {
            *byte = value;
        }
    }
    Ok(len)
}

/// The bus.
pub(crate) struct Bus(HalBus);

impl driver::Bus for Bus {
    async fn enable(&mut self) {
        self.0.enable().await;
    }

    async fn disable(&mut self) {
        self.0.disable().await;
    }

    async fn poll(&mut self) -> Event {
        let event = self.0.poll().await;
        match event {
            Event::Reset => {
                // A stage that was under way may have changed endpoint 0 after the reset.
                critical_section::with(|_| settle_endpoint_0());
                IS_LEFT.store(false, Ordering::Relaxed);
                IS_SET_UP.store(false, Ordering::Relaxed);
            }
            Event::Suspend => IS_LEFT.store(false, Ordering::Relaxed),
            _ => {}
        }
        event
    }

    fn endpoint_set_enabled(&mut self, endpoint: EndpointAddress, enabled: bool) {
        // The HAL would let one that is in use take a packet for which it has no room, and lose the one that waits there.
        if !enabled || status(endpoint) == Stat::DISABLED {
            self.0.endpoint_set_enabled(endpoint, enabled);
            if enabled {
                // Before the host sends anything: a packet that waits to be read stays.
                set_status(endpoint, idle_status(endpoint));
            }
        }
        start_at_data0(endpoint);
    }

    fn endpoint_set_stalled(&mut self, endpoint: EndpointAddress, stalled: bool) {
        // The HAL panics at one that the controller does not have.
        if endpoint.index() >= ENDPOINTS {
            return;
        }
        let was_stalled = status(endpoint) == Stat::STALL;
        if stalled {
            self.0.endpoint_set_stalled(endpoint, true);
        } else if endpoint.index() != 0 {
            start_at_data0(endpoint);
            if was_stalled {
                // It is stalled already: this wakes the one that waits for it.
                self.0.endpoint_set_stalled(endpoint, true);
                set_status(endpoint, idle_status(endpoint));
            }
        }
    }

    fn endpoint_is_stalled(&mut self, endpoint: EndpointAddress) -> bool {
        endpoint.index() < ENDPOINTS && self.0.endpoint_is_stalled(endpoint)
    }

    async fn remote_wakeup(&mut self) -> Result<(), Unsupported> {
        self.0.remote_wakeup().await
    }
}

/// The status of an endpoint in which a packet waits, or does not.
fn idle_status(endpoint: EndpointAddress) -> Stat {
    let waits = |packets: &AtomicU8| packets.load(Ordering::Relaxed) >> endpoint.index() & 1 != 0;
    let is_valid = match endpoint.direction() {
        Direction::In => waits(&ARMED),
        Direction::Out => !waits(&UNREAD),
    };
    if is_valid { Stat::VALID } else { Stat::NAK }
}

/// Endpoint 0.
pub(crate) struct ControlPipe(HalControlPipe);

impl driver::ControlPipe for ControlPipe {
    fn max_packet_size(&self) -> usize {
        self.0.max_packet_size()
    }

    async fn setup(&mut self) -> [u8; 8] {
        poll_fn(|cx| {
            critical_section::with(|_| {
                let Poll::Ready(request) = pin!(self.0.setup()).poll(cx) else {
                    return Poll::Pending;
                };
                if setup_waits() {
                    // Another came while this one was read. The interrupt handlers are yet to see it.
                    cx.waker().wake_by_ref();
                    return Poll::Pending;
                }
                IS_SET_UP.store(false, Ordering::Relaxed);
                Poll::Ready(request)
            })
        })
        .await
    }

    async fn data_out(&mut self, buf: &mut [u8], first: bool, last: bool) -> Result<usize, EndpointError> {
        let stage = unless_over(self.0.data_out(buf, first, last)).await;
        stage.unwrap_or(Err(EndpointError::Disabled))
    }

    async fn data_in(&mut self, data: &[u8], first: bool, last: bool) -> Result<(), EndpointError> {
        let stage = unless_over(self.0.data_in(data, first, last)).await;
        stage.unwrap_or(Err(EndpointError::Disabled))
    }

    async fn accept(&mut self) {
        unless_over(self.0.accept()).await;
    }

    async fn reject(&mut self) {
        unless_over(self.0.reject()).await;
    }

    async fn accept_set_address(&mut self, address: u8) {
        unless_over(self.0.accept_set_address(address)).await;
    }
}
