//! The control port on USB: an interface of the adapter's own, beside that of its serial port.

use std::io::{self, Read, Write};
use std::time::Duration;

use nusb::descriptors::{InterfaceDescriptor, TransferType};
use nusb::io::{EndpointRead, EndpointWrite};
use nusb::transfer::{Bulk, Direction, In, Out};
use nusb::{DeviceInfo, Endpoint, Interface, MaybeFuture};

use crate::error::Error;
use crate::error::text::Text;
use crate::error::usb_fault::{UsbFault, VENDOR_AND_PRODUCT};
use crate::ports::line::{Line, Names, Reception, is_nothing_yet};
use crate::ports::system::has_serial_port;

/// The class, subclass and protocol of its control interface: none that is standard.
const CLASS: (u8, u8, u8) = (0xFF, 0, 0);
/// The longest packet, in bytes.
const PACKET: usize = 64;
/// Timeout of a write.
const WRITE_TIMEOUT: Duration = Duration::from_millis(500);

/// The open interface.
pub(crate) struct UsbLine {
    name: String,
    reader: EndpointRead<Bulk>,
    writer: EndpointWrite<Bulk>,
}

impl UsbLine {
    /// Opens the control interface of the adapter that has this serial port.
    pub(crate) fn open(port: &str) -> Result<Self, Error> {
        let name = port.to_owned();
        let device = find(port)?;
        match claim(&device).and_then(|interface| endpoints(&interface)) {
            Ok((reader, writer)) => Ok(Self { name, reader, writer }),
            Err(error) => Err(not_opened(port, &error)),
        }
    }

    fn lost(&self, error: io::Error) -> Error {
        Error::unplugged(&self.name, &error)
    }
}

/// The serial number of the adapter on USB that has this serial port.
///
/// # Errors
///
/// [`Error::NoControl`] if no adapter has it, [`Error::At`] if it is not known which one, and [`Error::Usb`].
pub fn usb_serial_number(port: &str) -> Result<String, Error> {
    let serial = find(port)?.serial_number().map(str::to_owned);
    serial.ok_or_else(|| Error::NoControl { name: port.into() })
}

/// The adapter that has this serial port.
fn find(port: &str) -> Result<DeviceInfo, Error> {
    let name = port.into();
    // Other systems than Linux do not name the USB device of a port.
    let serial = serial_number_of(port);
    if !has_serial_port(port) || cfg!(target_os = "linux") && serial.is_none() {
        return Err(Error::NoControl { name });
    }
    let mut adapters = adapters().map_err(|error| not_opened(port, &error))?;
    adapters.retain(|adapter| serial.is_none() || adapter.serial_number() == serial.as_deref());
    match adapters.len() {
        0 | 1 => adapters.pop().ok_or(Error::NoControl { name }),
        _ => {
            let serials = adapters.iter().map(|adapter| adapter.serial_number().unwrap_or("?"));
            let serials: Vec<_> = serials.collect();
            let reason = format!(
                "there are several adapters ({}), and this system does not show which of them has the port: unplug the others",
                serials.join(", ")
            );
            Err(Error::at(port, reason))
        }
    }
}

/// The serial numbers of all adapters; none where USB cannot be searched.
pub(crate) fn serial_numbers() -> Vec<String> {
    let adapters = adapters().unwrap_or_default().into_iter();
    adapters
        .filter_map(|adapter| adapter.serial_number().map(str::to_owned))
        .collect()
}

fn adapters() -> Result<Vec<DeviceInfo>, nusb::Error> {
    let devices = nusb::list_devices().wait()?;
    Ok(devices.filter(|device| control_interface(device).is_some()).collect())
}

/// The number of the control interface, if it is an adapter.
fn control_interface(device: &DeviceInfo) -> Option<u8> {
    let mut interfaces = device.interfaces();
    let is_control = |class, subclass, protocol| (class, subclass, protocol) == CLASS;
    let interface = interfaces.find(|it| is_control(it.class(), it.subclass(), it.protocol()))?;
    let is_adapter = (device.vendor_id(), device.product_id()) == VENDOR_AND_PRODUCT;
    is_adapter.then(|| interface.interface_number())
}

/// The serial number of the USB device with this serial port. `None` except on Linux.
pub(crate) fn serial_number_of(port: &str) -> Option<String> {
    // The port may be a link, for example under /dev/serial/by-id.
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
    let input: Endpoint<Bulk, In> = interface.endpoint(bulk(interface, Direction::In))?;
    let output: Endpoint<Bulk, Out> = interface.endpoint(bulk(interface, Direction::Out))?;
    let writer = output.writer(PACKET).with_write_timeout(WRITE_TIMEOUT);
    Ok((input.reader(PACKET), writer))
}

/// The address of an interface's bulk endpoint. A missing endpoint gets 0, which the library refuses.
fn bulk(interface: &Interface, direction: Direction) -> u8 {
    let descriptor = interface.descriptor();
    let mut endpoints = descriptor.iter().flat_map(InterfaceDescriptor::endpoints);
    let endpoint = endpoints.find(|it| it.direction() == direction && it.transfer_type() == TransferType::Bulk);
    endpoint.map_or(0, |endpoint| endpoint.address())
}

impl Line for UsbLine {
    fn name(&self) -> &str {
        &self.name
    }

    fn read(&mut self, buf: &mut [u8], wait: Duration) -> Result<usize, Error> {
        self.reader.set_read_timeout(wait);
        match self.reader.read(buf) {
            Ok(n) => Ok(n),
            Err(error) if is_nothing_yet(&error) => Ok(0),
            Err(error) => Err(self.lost(error)),
        }
    }

    fn write(&mut self, bytes: &[u8]) -> Result<usize, Error> {
        let written = self.writer.write_all(bytes).and_then(|()| self.writer.flush());
        match written {
            Ok(()) => Ok(bytes.len()),
            Err(error) if is_nothing_yet(&error) => Err(Error::Stuck {
                name: self.name.as_str().into(),
            }),
            Err(error) => Err(self.lost(error)),
        }
    }

    fn hint(&self, _: Reception, _: Names) -> Text {
        "is its firmware stuck?".into()
    }
}

/// The error of a control port that cannot be used.
fn not_opened(port: &str, error: &nusb::Error) -> Error {
    let fault = match error.kind() {
        nusb::ErrorKind::PermissionDenied => UsbFault::PermissionDenied,
        nusb::ErrorKind::Busy => UsbFault::Busy,
        nusb::ErrorKind::Disconnected => UsbFault::Disconnected,
        _ => UsbFault::Other(error.to_string().into()),
    };
    let name = port.into();
    Error::Usb { name, fault }
}
