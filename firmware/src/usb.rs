//! The USB serial port: one CDC-ACM function.

use armwire_bridge::{Counters, PACKET};
use embassy_futures::select::{Either, select};
use embassy_usb::class::cdc_acm::{CdcAcmClass, Receiver, Sender, State};
use embassy_usb::control::{InResponse, OutResponse, Recipient, Request, RequestType};
use embassy_usb::{Builder, Config, Handler, UsbDevice};
use static_cell::StaticCell;

use crate::adapter::{Adapter, now};
use crate::board::{self, UsbDriver};

/// The pid.codes test id. It is for private use: a product needs an id of its own.
const VENDOR_AND_PRODUCT: (u16, u16) = (0x1209, 0x0001);

/// Requests of CDC PSTN 1.2, section 6.3.
const SET_LINE_CODING: u8 = 0x20;
const GET_LINE_CODING: u8 = 0x21;
const SET_CONTROL_LINE_STATE: u8 = 0x22;

/// The interface that the requests go to: the first, the only function's.
const CONTROL_INTERFACE: u16 = 0;

/// The device, and the two directions of its port.
pub(crate) fn new(
    driver: UsbDriver,
    adapter: &'static Adapter,
) -> (
    UsbDevice<'static, UsbDriver>,
    Sender<'static, UsbDriver>,
    Receiver<'static, UsbDriver>,
) {
    static CONFIG_DESCRIPTOR: StaticCell<[u8; 128]> = StaticCell::new();
    static CONTROL_BUFFER: StaticCell<[u8; Counters::MAX_LEN]> = StaticCell::new();
    static CONTROL: StaticCell<Control> = StaticCell::new();
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
        &mut [],
        &mut [],
        CONTROL_BUFFER.init([0; Counters::MAX_LEN]),
    );
    // Before the class, so that requests come here first.
    builder.handler(CONTROL.init(Control { adapter }));
    let port = CdcAcmClass::new(&mut builder, STATE.init(State::new()), PACKET as u16);
    let (sender, receiver) = port.split();
    (builder.build(), sender, receiver)
}

/// Tells the bridge what the host does, and answers for the line coding as the UART really has it.
struct Control {
    adapter: &'static Adapter,
}

impl Handler for Control {
    fn reset(&mut self) {
        board::cancel_unfetched_packets();
        self.adapter.with(|bridge| bridge.usb_reset());
        self.adapter.session.signal(());
    }

    fn configured(&mut self, configured: bool) {
        self.adapter.with(|bridge| bridge.usb_configured(configured));
        self.adapter.session.signal(());
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
                self.adapter.bytes.signal(());
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
            let coding = self.adapter.with(|bridge| bridge.line_coding()).to_cdc();
            answer(buf, &coding)
        } else if is_for_the_adapter(&request) && request.request == Counters::READ_REQUEST.1 {
            let counters = self.adapter.with(|bridge| bridge.counters());
            counters.to_bytes(buf).ok().map(InResponse::Accepted)
        } else {
            None
        }
    }
}

fn is_for_the_port(request: &Request) -> bool {
    request.request_type == RequestType::Class
        && request.recipient == Recipient::Interface
        && request.index == CONTROL_INTERFACE
}

fn is_for_the_adapter(request: &Request) -> bool {
    request.request_type == RequestType::Vendor
        && request.recipient == Recipient::Device
        && (request.value, request.index) == (0, 0)
}

fn answer<'a>(buf: &'a mut [u8], bytes: &[u8]) -> Option<InResponse<'a>> {
    let buf = buf.get_mut(..bytes.len())?;
    buf.copy_from_slice(bytes);
    Some(InResponse::Accepted(buf))
}

/// Answers the host's control requests.
#[embassy_executor::task]
pub(crate) async fn run(mut device: UsbDevice<'static, UsbDriver>) {
    device.run().await
}

/// Sends the host what the arm said.
#[embassy_executor::task]
pub(crate) async fn to_host(adapter: &'static Adapter, mut sender: Sender<'static, UsbDriver>) {
    let mut packet = [0; PACKET];
    loop {
        sender.wait_connection().await;
        loop {
            adapter.session.reset();
            let Some(n) = adapter.with(|bridge| bridge.usb_transmit(&mut packet)) else {
                adapter.packet.wait().await;
                continue;
            };
            // A packet that waits for the host to fetch the one before it is not for the next host.
            let sent = select(sender.write_packet(&packet[..n]), adapter.session.wait()).await;
            if !matches!(sent, Either::First(Ok(()))) {
                adapter.with(|bridge| bridge.usb_lost(n));
            }
            if matches!(sent, Either::First(Err(_))) {
                break;
            }
        }
    }
}

/// Takes from the host what is for the arm.
#[embassy_executor::task]
pub(crate) async fn from_host(adapter: &'static Adapter, mut receiver: Receiver<'static, UsbDriver>) {
    let mut packet = [0; PACKET];
    loop {
        receiver.wait_connection().await;
        loop {
            // Until a packet is read, USB holds the host back.
            while !adapter.with(|bridge| bridge.usb_room()) {
                adapter.room.wait().await;
            }
            let Ok(n) = receiver.read_packet(&mut packet).await else {
                break;
            };
            adapter.with(|bridge| bridge.usb_received(&packet[..n], now()));
            adapter.bytes.signal(());
        }
    }
}
