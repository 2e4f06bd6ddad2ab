//! The driver of the USB peripheral: the HAL's, extended for hosts that clear a halt or repeat SET_CONFIGURATION.
//! [`usb_control`](super::usb_control) handles hosts that abandon a request. The registers are in the chip's [`usb`].

use embassy_usb::driver::{
    self, EndpointAddress, EndpointAllocError, EndpointError, EndpointInfo, EndpointType, Event, Unsupported,
};

use super::usb::{self, ENDPOINTS, Hal, HalBus, HalIn, HalOut};
use super::usb_control::ControlPipe;

/// The driver.
pub(crate) struct UsbDriver(pub(super) Hal);

impl driver::Driver<'static> for UsbDriver {
    type EndpointOut = Endpoint<HalOut>;
    type EndpointIn = Endpoint<HalIn>;
    type ControlPipe = ControlPipe;
    type Bus = Bus;

    fn alloc_endpoint_out(
        &mut self,
        kind: EndpointType,
        address: Option<EndpointAddress>,
        max_packet_size: u16,
        interval_ms: u8,
    ) -> Result<Endpoint<HalOut>, EndpointAllocError> {
        let endpoint = self.0.alloc_endpoint_out(kind, address, max_packet_size, interval_ms);
        endpoint.map(Endpoint)
    }

    fn alloc_endpoint_in(
        &mut self,
        kind: EndpointType,
        address: Option<EndpointAddress>,
        max_packet_size: u16,
        interval_ms: u8,
    ) -> Result<Endpoint<HalIn>, EndpointAllocError> {
        let endpoint = self.0.alloc_endpoint_in(kind, address, max_packet_size, interval_ms);
        endpoint.map(Endpoint)
    }

    fn start(self, control_max_packet_size: u16) -> (Bus, ControlPipe) {
        let (bus, control) = self.0.start(control_max_packet_size);
        (Bus(bus), ControlPipe(control))
    }
}

/// An endpoint other than 0.
pub(crate) struct Endpoint<E>(E);

impl<E: driver::Endpoint> driver::Endpoint for Endpoint<E> {
    fn info(&self) -> &EndpointInfo {
        self.0.info()
    }

    fn wait_enabled(&mut self) -> impl Future<Output = ()> {
        self.0.wait_enabled()
    }
}

impl driver::EndpointIn for Endpoint<HalIn> {
    fn write(&mut self, packet: &[u8]) -> impl Future<Output = Result<(), EndpointError>> {
        usb::write(&mut self.0, packet)
    }
}

impl driver::EndpointOut for Endpoint<HalOut> {
    fn read(&mut self, packet: &mut [u8]) -> impl Future<Output = Result<usize, EndpointError>> {
        usb::read(&mut self.0, packet)
    }
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

    fn poll(&mut self) -> impl Future<Output = Event> {
        usb::poll(&mut self.0)
    }

    fn endpoint_set_enabled(&mut self, endpoint: EndpointAddress, enabled: bool) {
        usb::set_enabled(&mut self.0, endpoint, enabled);
    }

    fn endpoint_set_stalled(&mut self, endpoint: EndpointAddress, stalled: bool) {
        // The HALs panic for an endpoint that the controller does not have.
        if endpoint.index() < ENDPOINTS {
            usb::set_stalled(&mut self.0, endpoint, stalled);
        }
    }

    fn endpoint_is_stalled(&mut self, endpoint: EndpointAddress) -> bool {
        endpoint.index() < ENDPOINTS && self.0.endpoint_is_stalled(endpoint)
    }

    async fn remote_wakeup(&mut self) -> Result<(), Unsupported> {
        self.0.remote_wakeup().await
    }
}
