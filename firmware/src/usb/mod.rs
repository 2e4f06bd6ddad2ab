//! The USB device: the arm's serial port and the control interface.

pub(crate) mod control;
pub(crate) mod port;

use armwire_bridge::{Counters, PACKET};
use embassy_usb::class::cdc_acm::{CdcAcmClass, State};
use embassy_usb::control::{InResponse, OutResponse, Recipient, Request, RequestType};
use embassy_usb::msos::{
    CompatibleIdFeatureDescriptor, PropertyData, RegistryPropertyFeatureDescriptor, windows_version,
};
use embassy_usb::types::StringIndex;
use embassy_usb::{Builder, Config, Handler, UsbDevice};
use static_cell::StaticCell;

use crate::adapter::{Adapter, now};
use crate::board::{self, UsbDriver};
use crate::watchdog::{Task, rest};

/// The pid.codes test id. It is for private use: a product needs an id of its own.
const VENDOR_AND_PRODUCT: (u16, u16) = (0x1209, 0x0001);

/// Requests of CDC PSTN 1.2, section 6.3.
const SET_LINE_CODING: u8 = 0x20;
const GET_LINE_CODING: u8 = 0x21;
const SET_CONTROL_LINE_STATE: u8 = 0x22;

/// The interface that they go to: the serial port's first.
const PORT_INTERFACE: u16 = 0;

/// The class of interfaces that are in no other.
const VENDOR_SPECIFIC: u8 = 0xFF;

/// What the control interface is called, for hosts to find it by.
const CONTROL_NAME: &str = "armwire control";

/// The vendor request by which Windows reads the descriptors of its own.
const WINDOWS_REQUEST: u8 = 0x20;

/// What Windows programs look for to find the control interface.
const WINDOWS_INTERFACE: &str = "{4C757248-7066-47AD-9A38-E3D4ADFA1B0A}";

const _: () = assert!(WINDOWS_REQUEST != Counters::READ_REQUEST.1);

/// The device, and the two things it is.
pub(crate) struct Usb {
    pub(crate) device: UsbDevice<'static, UsbDriver>,
    pub(crate) port: CdcAcmClass<'static, UsbDriver>,
    pub(crate) control: control::Interface,
}

/// Describes the device to the driver.
pub(crate) fn new(driver: UsbDriver, adapter: &'static Adapter) -> Usb {
    static CONFIG_DESCRIPTOR: StaticCell<[u8; 128]> = StaticCell::new();
    static BOS_DESCRIPTOR: StaticCell<[u8; 40]> = StaticCell::new();
    static WINDOWS_DESCRIPTOR: StaticCell<[u8; 180]> = StaticCell::new();
    static CONTROL_BUFFER: StaticCell<[u8; Counters::MAX_LEN]> = StaticCell::new();
    static REQUESTS: StaticCell<Requests> = StaticCell::new();
    static STATE: StaticCell<State<'static>> = StaticCell::new();

    let (vendor, product) = VENDOR_AND_PRODUCT;
    let mut config = Config::new(vendor, product);
    config.manufacturer = Some("armwire");
    config.product = Some("armwire adapter");
    config.serial_number = Some(board::serial_number());
    config.max_power = 100;

    let mut builder = Builder::new(
        driver,
        config,
        CONFIG_DESCRIPTOR.init([0; 128]),
        BOS_DESCRIPTOR.init([0; 40]),
        WINDOWS_DESCRIPTOR.init([0; 180]),
        CONTROL_BUFFER.init([0; Counters::MAX_LEN]),
    );
    let control_name = builder.string();
    // Before the class, so that requests come here first.
    builder.handler(REQUESTS.init(Requests { adapter, control_name }));
    let port = CdcAcmClass::new(&mut builder, STATE.init(State::new()), PACKET as u16);

    // Windows takes its own driver for the interface, WinUSB, without being told by the user.
    builder.msos_descriptor(windows_version::WIN8_1, WINDOWS_REQUEST);
    let mut function = builder.function(VENDOR_SPECIFIC, 0, 0);
    function.msos_feature(CompatibleIdFeatureDescriptor::new("WINUSB", ""));
    function.msos_feature(RegistryPropertyFeatureDescriptor::new(
        "DeviceInterfaceGUIDs",
        PropertyData::RegMultiSz(&[WINDOWS_INTERFACE]),
    ));
    let mut interface = function.interface();
    let mut endpoints = interface.alt_setting(VENDOR_SPECIFIC, 0, 0, Some(control_name));
    let control = control::Interface {
        to_host: endpoints.endpoint_bulk_in(None, PACKET as u16),
        from_host: endpoints.endpoint_bulk_out(None, PACKET as u16),
    };
    drop(function);
    Usb {
        device: builder.build(),
        port,
        control,
    }
}

/// Tells the bridge what the host does, and answers for the line coding as the UART really has it.
struct Requests {
    adapter: &'static Adapter,
    control_name: StringIndex,
}

impl Requests {
    /// What is on its way to the host is for nobody now.
    fn end_sessions(&self) {
        self.adapter.session.signal(());
        self.adapter.control_session.signal(());
    }
}

impl Handler for Requests {
    fn reset(&mut self) {
        board::cancel_unfetched_packets();
        self.adapter.with(|bridge| bridge.usb_reset());
        self.end_sessions();
    }

    fn configured(&mut self, configured: bool) {
        self.adapter.with(|bridge| bridge.usb_configured(configured));
        self.end_sessions();
    }

    fn suspended(&mut self, suspended: bool) {
        if suspended {
            self.adapter.with(|bridge| bridge.usb_suspended());
        }
    }

    fn control_out(&mut self, request: Request, data: &[u8]) -> Option<OutResponse> {
        if !is_for_the_port(&request) {
            return None;
        }
        match request.request {
            SET_LINE_CODING => {
                let coding = data.try_into().ok()?;
                let result = self.adapter.with(|bridge| bridge.request_line_coding(coding, now()));
                Some(result.map_or(OutResponse::Rejected, |()| OutResponse::Accepted))
            }
            SET_CONTROL_LINE_STATE => {
                let dtr = request.value & 1 != 0;
                if self.adapter.with(|bridge| bridge.usb_dtr(dtr)) {
                    self.adapter.session.signal(());
                }
                Some(OutResponse::Accepted)
            }
            _ => None,
        }
    }

    fn control_in<'a>(&'a mut self, request: Request, buf: &'a mut [u8]) -> Option<InResponse<'a>> {
        if is_for_the_port(&request) && request.request == GET_LINE_CODING {
            let coding = self.adapter.look(|bridge| bridge.line_coding()).to_cdc();
            let buf = buf.get_mut(..coding.len())?;
            buf.copy_from_slice(&coding);
            Some(InResponse::Accepted(buf))
        } else if is_for_the_adapter(&request) && request.request == Counters::READ_REQUEST.1 {
            let counters = self.adapter.look(|bridge| bridge.counters());
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
        && request.index == PORT_INTERFACE
}

fn is_for_the_adapter(request: &Request) -> bool {
    request.request_type == RequestType::Vendor
        && request.recipient == Recipient::Device
        && (request.value, request.index) == (0, 0)
}

/// Answers the host's requests.
#[embassy_executor::task]
pub(crate) async fn run(mut device: UsbDevice<'static, UsbDriver>) {
    // What it does takes no time to speak of; all else is waiting for the host.
    let _resting = rest(Task::Usb);
    device.run().await
}
