//! The USB device: the arm's serial port and the control interface.

pub(crate) mod pipe;

use core::future::{Future as _, poll_fn};
use core::pin::pin;

use armwire_bridge::{Bridge, Counters, PACKET, UsbEvent};
use embassy_usb::control::{InResponse, OutResponse, Recipient, Request, RequestType};
use embassy_usb::driver::Endpoint;
use embassy_usb::msos::{
    CompatibleIdFeatureDescriptor, PropertyData, RegistryPropertyFeatureDescriptor, windows_version,
};
use embassy_usb::types::StringIndex;
use embassy_usb::{Builder, Config, FunctionBuilder, Handler, UsbDevice};
use static_cell::StaticCell;

use crate::adapter::{Adapter, Work};
use crate::board::{self, UsbDriver};
use crate::ceiling::{SERVICE, mask};
use crate::clock::now;
use crate::progress::{Task, rest};
use crate::usb::pipe::{Endpoints, FromHost, SharedEndpoint, ToHost};

/// The pid.codes test id for private use: a product needs an id of its own.
const VENDOR_AND_PRODUCT: (u16, u16) = (0x1209, 0x0001);

/// Class codes: communications devices (CDC 1.2, section 4), abstract control model without AT commands (PSTN 1.2),
/// data.
const COMMUNICATIONS: u8 = 0x02;
const ABSTRACT_CONTROL_MODEL: u8 = 0x02;
const DATA: u8 = 0x0A;

/// Functional descriptors (CDC 1.2, section 5.2.3, and PSTN 1.2, section 5.3): version 1.10, line coding and control
/// lines, and the two interfaces.
const CS_INTERFACE: u8 = 0x24;
const HEADER: [u8; 3] = [0x00, 0x10, 0x01];
const ABSTRACT_CONTROL: [u8; 2] = [0x02, 0x02];
const UNION: [u8; 3] = [0x06, PORT_INTERFACE, PORT_INTERFACE + 1];

/// Requests of CDC 1.2, section 6.2, and PSTN 1.2, section 6.3.
const SEND_ENCAPSULATED_COMMAND: u8 = 0x00;
const SET_LINE_CODING: u8 = 0x20;
const GET_LINE_CODING: u8 = 0x21;
const SET_CONTROL_LINE_STATE: u8 = 0x22;

/// The interface of these requests: the first of the serial port's two.
const PORT_INTERFACE: u8 = 0;

/// The vendor-specific interface class.
const VENDOR_SPECIFIC: u8 = 0xFF;

/// The name by which hosts find the control interface.
const CONTROL_NAME: &str = "armwire control";

/// The device interface class of the control interface, by which programs on Windows find it.
const CONTROL_GUID: &str = "{4C757248-7066-47AD-9A38-E3D4ADFA1B0A}";

/// The vendor request by which Windows reads the Microsoft OS 2.0 descriptors. embassy-usb answers it.
const READ_MSOS_DESCRIPTORS: u8 = 0x20;

const _: () = assert!(READ_MSOS_DESCRIPTORS != Counters::READ_REQUEST.1);

/// The device and its two functions.
pub(crate) struct Usb {
    pub(crate) device: UsbDevice<'static, UsbDriver>,
    pub(crate) port: Endpoints,
    pub(crate) control: Endpoints,
}

/// Describes the device to the driver.
pub(crate) fn new(driver: UsbDriver, adapter: &'static Adapter) -> Usb {
    static CONFIG_DESCRIPTOR: StaticCell<[u8; 104]> = StaticCell::new();
    static BOS_DESCRIPTOR: StaticCell<[u8; 40]> = StaticCell::new();
    static MSOS_DESCRIPTORS: StaticCell<[u8; 178]> = StaticCell::new();
    static CONTROL_BUFFER: StaticCell<[u8; Counters::MAX_LEN]> = StaticCell::new();
    static REQUESTS: StaticCell<Requests> = StaticCell::new();
    static PORT_TO_HOST: StaticCell<SharedEndpoint> = StaticCell::new();
    static CONTROL_TO_HOST: StaticCell<SharedEndpoint> = StaticCell::new();

    let (vendor, product) = VENDOR_AND_PRODUCT;
    let mut config = Config::new(vendor, product);
    config.manufacturer = Some("armwire");
    config.product = Some("armwire adapter");
    config.serial_number = Some(board::serial_number());
    config.max_power = 250;

    let mut builder = Builder::new(
        driver,
        config,
        CONFIG_DESCRIPTOR.init([0; 104]),
        BOS_DESCRIPTOR.init([0; 40]),
        MSOS_DESCRIPTORS.init([0; 178]),
        CONTROL_BUFFER.init([0; Counters::MAX_LEN]),
    );
    // Windows 8.1 is the first version that reads these descriptors.
    builder.msos_descriptor(windows_version::WIN8_1, READ_MSOS_DESCRIPTORS);
    let control_name = builder.string();
    let (to_host, from_host) = serial_port(builder.function(COMMUNICATIONS, ABSTRACT_CONTROL_MODEL, 0));
    builder.handler(REQUESTS.init(Requests {
        adapter,
        control_name,
        to_host: to_host.info().addr.index(),
    }));
    let port = Endpoints {
        to_host: PORT_TO_HOST.init(SharedEndpoint::new(to_host)),
        from_host,
    };
    let (to_host, from_host) = control_interface(builder.function(VENDOR_SPECIFIC, 0, 0), control_name);
    let control = Endpoints {
        to_host: CONTROL_TO_HOST.init(SharedEndpoint::new(to_host)),
        from_host,
    };
    Usb {
        device: builder.build(),
        port,
        control,
    }
}

/// Two interfaces: one for requests, and one for data.
fn serial_port(mut function: FunctionBuilder<'_, 'static, UsbDriver>) -> (ToHost, FromHost) {
    let mut interface = function.interface();
    let mut requests = interface.alt_setting(COMMUNICATIONS, ABSTRACT_CONTROL_MODEL, 0, None);
    for descriptor in [&HEADER[..], &ABSTRACT_CONTROL, &UNION] {
        requests.descriptor(CS_INTERFACE, descriptor);
    }
    // Hosts expect this endpoint. It is never used.
    requests.endpoint_interrupt_in(None, 8, 255);
    let mut interface = function.interface();
    let mut data = interface.alt_setting(DATA, 0, 0, None);
    let from_host = data.endpoint_bulk_out(None, PACKET as u16);
    (data.endpoint_bulk_in(None, PACKET as u16), from_host)
}

/// A vendor-specific interface. The F405 has too few endpoints for a second serial port (RM0090 34.1).
fn control_interface(mut function: FunctionBuilder<'_, 'static, UsbDriver>, name: StringIndex) -> (ToHost, FromHost) {
    // Windows binds its own driver, WinUSB, automatically.
    function.msos_feature(CompatibleIdFeatureDescriptor::new("WINUSB", ""));
    function.msos_feature(RegistryPropertyFeatureDescriptor::new(
        "DeviceInterfaceGUIDs",
        PropertyData::RegMultiSz(&[CONTROL_GUID]),
    ));
    let mut interface = function.interface();
    let mut data = interface.alt_setting(VENDOR_SPECIFIC, 0, 0, Some(name));
    let to_host = data.endpoint_bulk_in(None, PACKET as u16);
    (to_host, data.endpoint_bulk_out(None, PACKET as u16))
}

/// Passes the host's requests to the bridge, and returns the UART's actual line coding.
struct Requests {
    adapter: &'static Adapter,
    control_name: StringIndex,
    /// The IN endpoint of the serial port.
    to_host: usize,
}

impl Requests {
    /// Withdraws the packet in the serial port's endpoint, which was for another session. The service must not put the
    /// next one there before the bridge knows the event.
    fn cancel_unfetched_packet(&self, bridge: &mut Bridge) {
        if board::cancel_unfetched_packet(self.to_host) {
            bridge.usb_event(UsbEvent::Lost(pipe::last_packet()), now());
        }
    }

    /// The packets in flight have lost their receiver.
    fn end_sessions(&self) {
        self.adapter.wake(Work::PortSession);
        self.adapter.wake(Work::ControlSession);
    }
}

impl Handler for Requests {
    fn reset(&mut self) {
        self.adapter.with(|bridge| {
            self.cancel_unfetched_packet(bridge);
            board::cancel_unfetched_packets();
            bridge.usb_event(UsbEvent::Reset, now());
        });
        self.end_sessions();
    }

    fn configured(&mut self, configured: bool) {
        info!("USB: configured by a host: {=bool}", configured);
        self.adapter.with(|bridge| {
            self.cancel_unfetched_packet(bridge);
            bridge.usb_event(UsbEvent::Configured(configured), now());
        });
        self.end_sessions();
    }

    fn suspended(&mut self, suspended: bool) {
        info!("USB: suspended: {=bool}", suspended);
        if suspended {
            self.adapter.with(|bridge| bridge.usb_event(UsbEvent::Suspended, now()));
        }
    }

    fn control_out(&mut self, request: Request, data: &[u8]) -> Option<OutResponse> {
        if !is_for_the_port(&request) {
            return None;
        }
        match request.request {
            // Some hosts send one. The adapter has no commands to encapsulate.
            SEND_ENCAPSULATED_COMMAND => Some(OutResponse::Accepted),
            SET_LINE_CODING => {
                let coding = data.try_into().ok()?;
                let result = self.adapter.with(|bridge| bridge.set_line_coding(coding, now()));
                Some(result.map_or(OutResponse::Rejected, |()| OutResponse::Accepted))
            }
            SET_CONTROL_LINE_STATE => {
                let dtr = request.value & 1 != 0;
                info!("USB: port open: {=bool}", dtr);
                let is_new = self.adapter.with(|bridge| {
                    let is_new = bridge.usb_event(UsbEvent::Dtr(dtr), now());
                    if is_new {
                        self.cancel_unfetched_packet(bridge);
                    }
                    is_new
                });
                if is_new {
                    self.adapter.wake(Work::PortSession);
                }
                Some(OutResponse::Accepted)
            }
            _ => None,
        }
    }

    fn control_in<'a>(&'a mut self, request: Request, buf: &'a mut [u8]) -> Option<InResponse<'a>> {
        if is_for_the_port(&request) && request.request == GET_LINE_CODING {
            let coding = self.adapter.take(|bridge| bridge.line_coding()).to_cdc();
            let buf = buf.get_mut(..coding.len())?;
            buf.copy_from_slice(&coding);
            Some(InResponse::Accepted(buf))
        } else if is_for_the_adapter(&request) && request.request == Counters::READ_REQUEST.1 {
            let counters = self.adapter.take(|bridge| bridge.counters());
            counters.to_bytes(buf).ok().map(InResponse::Accepted)
        } else {
            None
        }
    }

    fn get_string(&mut self, index: StringIndex, _: u16) -> Option<&str> {
        (index == self.control_name).then_some(CONTROL_NAME)
    }
}

fn is_for_the_port(request: &Request) -> bool {
    request.request_type == RequestType::Class
        && request.recipient == Recipient::Interface
        && request.index == u16::from(PORT_INTERFACE)
}

fn is_for_the_adapter(request: &Request) -> bool {
    request.request_type == RequestType::Vendor
        && request.recipient == Recipient::Device
        && (request.value, request.index) == (0, 0)
}

/// Answers the host's requests.
#[embassy_executor::task]
pub(crate) async fn run(mut device: UsbDevice<'static, UsbDriver>) {
    // The task always counts as idle: it waits for the host almost all the time.
    let _resting = rest(Task::Usb);
    let mut running = pin!(device.run());
    // It enables, disables and resets endpoints, one of which the service uses.
    poll_fn(|cx| {
        let _masked = mask(SERVICE);
        running.as_mut().poll(cx)
    })
    .await
}
