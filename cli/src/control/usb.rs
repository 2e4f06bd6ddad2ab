//! The control port on USB: an interface of the adapter's own, beside that of its serial port.

use std::io::{self, Read, Write};
use std::time::Duration;

use nusb::descriptors::TransferType;
use nusb::io::{EndpointRead, EndpointWrite};
use nusb::transfer::{Bulk, Direction, In, Out};
use nusb::{DeviceInfo, Interface, MaybeFuture};

use crate::link::{Came, Line, is_nothing_yet};
use crate::problem::Problem;

/// What the adapter calls itself. It is the pid.codes test id, so the interface is looked at too.
pub(crate) const VENDOR_AND_PRODUCT: (u16, u16) = (0x1209, 0x0001);
/// The class, subclass and protocol of its control interface: none that is standard.
const CLASS: (u8, u8, u8) = (0xFF, 0, 0);
/// The longest packet, in bytes.
const PACKET: usize = 64;
/// How long the adapter may take no bytes.
const WRITE_TIMEOUT: Duration = Duration::from_millis(500);

/// The open interface.
pub(super) struct UsbLine {
    name: String,
    reader: EndpointRead<Bulk>,
    writer: EndpointWrite<Bulk>,
}

impl UsbLine {
    /// Opens the control interface of the adapter that has this serial port.
    pub(super) fn open(port: &str) -> Result<Self, Problem> {
        let name = port.to_owned();
        let device = find(port)?;
        match claim(&device).and_then(|interface| endpoints(&interface)) {
            Ok((reader, writer)) => Ok(Self { name, reader, writer }),
            Err(error) => Err(Problem::Usb { name, error }),
        }
    }

    fn lost(&self, error: io::Error) -> Problem {
        let port = self.name.clone();
        Problem::Lost { port, error }
    }
}

/// The adapter that has this serial port.
fn find(port: &str) -> Result<DeviceInfo, Problem> {
    let name = port.to_owned();
    // Elsewhere nothing tells whose a port is.
    let serial = serial_number_of(port);
    if cfg!(target_os = "linux") && serial.is_none() {
        return Err(Problem::NoControl { name });
    }
    let devices = match nusb::list_devices().wait() {
        Ok(devices) => devices,
        Err(error) => return Err(Problem::Usb { name, error }),
    };
    let mut adapters: Vec<_> = devices.filter(|device| control_interface(device).is_some()).collect();
    adapters.retain(|adapter| serial.is_none() || adapter.serial_number() == serial.as_deref());
    match adapters.len() {
        0 | 1 => adapters.pop().ok_or(Problem::NoControl { name }),
        _ => {
            let serials = adapters
                .iter()
                .map(|adapter| adapter.serial_number().unwrap_or("?").to_owned());
            let serials = serials.collect();
            Err(Problem::Several { name, serials })
        }
    }
}

/// The number of the control interface, if it is an adapter.
fn control_interface(device: &DeviceInfo) -> Option<u8> {
    let mut interfaces = device.interfaces();
    let is_control = |class, subclass, protocol| (class, subclass, protocol) == CLASS;
    let interface = interfaces.find(|it| is_control(it.class(), it.subclass(), it.protocol()))?;
    let is_adapter = (device.vendor_id(), device.product_id()) == VENDOR_AND_PRODUCT;
    is_adapter.then(|| interface.interface_number())
}

/// The serial number of the USB device that has a serial port, if the system is Linux, which tells it.
fn serial_number_of(port: &str) -> Option<String> {
    // It may be a link, as those under /dev/serial/by-id.
    let device = std::fs::canonicalize(port).ok()?;
    let name = device.file_name()?.to_str()?;
    // This is the interface, and the device is above it.
    let serial = std::fs::read_to_string(format!("/sys/class/tty/{name}/device/../serial")).ok()?;
    Some(serial.trim_end().to_owned())
}

fn claim(device: &DeviceInfo) -> Result<Interface, nusb::Error> {
    let number = control_interface(device).expect("it was found by it");
    device.open().wait()?.claim_interface(number).wait()
}

fn endpoints(interface: &Interface) -> Result<(EndpointRead<Bulk>, EndpointWrite<Bulk>), nusb::Error> {
    // An interface without them gets the library's error for an endpoint that is not there.
    let address = |direction| {
        let descriptor = interface.descriptor();
        let endpoint = descriptor.and_then(|descriptor| {
            let mut endpoints = descriptor.endpoints();
            endpoints.find(|it| it.direction() == direction && it.transfer_type() == TransferType::Bulk)
        });
        endpoint.map_or(0, |endpoint| endpoint.address())
    };
    let reader = interface.endpoint::<Bulk, In>(address(Direction::In))?.reader(PACKET);
    let writer = interface.endpoint::<Bulk, Out>(address(Direction::Out))?.writer(PACKET);
    Ok((reader, writer.with_write_timeout(WRITE_TIMEOUT)))
}

impl Line for UsbLine {
    fn name(&self) -> &str {
        &self.name
    }

    fn read(&mut self, buf: &mut [u8], wait: Duration) -> Result<usize, Problem> {
        self.reader.set_read_timeout(wait);
        match self.reader.read(buf) {
            Ok(n) => Ok(n),
            Err(error) if is_nothing_yet(&error) => Ok(0),
            Err(error) => Err(self.lost(error)),
        }
    }

    fn write(&mut self, bytes: &[u8]) -> Result<usize, Problem> {
        let written = self.writer.write_all(bytes).and_then(|()| self.writer.flush());
        match written {
            Ok(()) => Ok(bytes.len()),
            Err(error) if is_nothing_yet(&error) => Err(Problem::Stuck {
                port: self.name.clone(),
            }),
            Err(error) => Err(self.lost(error)),
        }
    }

    fn doubts(&mut self, _: Came, _: &str) -> String {
        "is its firmware stuck?".to_owned()
    }
}
