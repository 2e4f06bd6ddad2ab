//! The control port on USB: an interface of the adapter's own, beside that of its serial port.

use std::io::{self, Read, Write};
use std::path::Path;
use std::time::Duration;

use nusb::descriptors::{InterfaceDescriptor, TransferType};
use nusb::io::{EndpointRead, EndpointWrite};
use nusb::transfer::{Bulk, Direction, In, Out};
use nusb::{DeviceInfo, Endpoint, Interface, MaybeFuture};

use crate::error::Error;
use crate::error::no_control::NoControl;
use crate::error::text::Text;
use crate::error::usb_fault::{UsbFault, VENDOR_AND_PRODUCT};
use crate::ports::line::{Line, Names, Reception, is_nothing_yet};
use crate::ports::system::{UsbDevice, has_serial_port, serial_path, usb_device};
use crate::ports::usb_name;

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
    /// Opens the control interface of the adapter that has this serial port, a path or `usb:SERIAL`.
    pub(crate) fn open(port: &str) -> Result<Self, Error> {
        Self::open_on(port.to_owned(), &find(port)?)
    }

    /// Opens the control interface of the adapter with this serial number.
    pub(crate) fn open_by_serial(name: String, serial: &str) -> Result<Self, Error> {
        let device = find_by_serial(&name, serial)?;
        Self::open_on(name, &device)
    }

    fn open_on(name: String, device: &DeviceInfo) -> Result<Self, Error> {
        match claim(device).and_then(|interface| endpoints(&interface)) {
            Ok((reader, writer)) => Ok(Self { name, reader, writer }),
            Err(error) => Err(not_opened(&name, &error)),
        }
    }

    fn lost(&self, error: io::Error) -> Error {
        Error::unplugged(&self.name, &error)
    }
}

/// The serial number of the adapter on USB that has this serial port, a path or `usb:SERIAL`.
///
/// # Errors
///
/// [`Error::NoControl`] if no adapter has it, or if the system does not show which one, and [`Error::Usb`].
pub fn usb_serial_number(port: &str) -> Result<String, Error> {
    let serial = find(port)?.serial_number().map(str::to_owned);
    serial.ok_or_else(|| Error::no_adapter(port))
}

/// The adapter that has this serial port. It is never guessed, also not if there is only one.
fn find(port: &str) -> Result<DeviceInfo, Error> {
    if let Some(serial) = usb_name::serial_in(port) {
        return find_by_serial(port, serial);
    }
    match usb_device(port) {
        UsbDevice::At(folder) => {
            let adapters = adapters().map_err(|error| not_opened(port, &error))?;
            let adapter = adapters.into_iter().find(|adapter| is_at(adapter, &folder));
            adapter.ok_or_else(|| Error::no_adapter(port))
        }
        UsbDevice::NotShown if has_serial_port(port) => {
            let names = serial_numbers().into_iter();
            let reason = NoControl::NotShown {
                candidates: names.map(|serial| usb_name::control_name_of(&serial).into()).collect(),
            };
            let name = port.into();
            Err(Error::NoControl { name, reason })
        }
        UsbDevice::None | UsbDevice::NotShown => Err(Error::no_adapter(port)),
    }
}

/// Returns true for an adapter with this folder. Only Linux has such folders.
fn is_at(adapter: &DeviceInfo, folder: &Path) -> bool {
    #[cfg(target_os = "linux")]
    return adapter.sysfs_path() == folder;
    #[cfg(not(target_os = "linux"))]
    {
        let _ = (adapter, folder);
        false
    }
}

/// The only adapter with this serial number.
fn find_by_serial(name: &str, serial: &str) -> Result<DeviceInfo, Error> {
    let mut adapters = adapters().map_err(|error| not_opened(name, &error))?;
    adapters.retain(|adapter| adapter.serial_number() == Some(serial));
    match adapters.len() {
        0 | 1 => adapters.pop().ok_or_else(|| Error::no_adapter(name)),
        _ => Err(Error::at(name, several_with(serial))),
    }
}

/// The reason against a serial number that several adapters have.
fn several_with(serial: &str) -> String {
    let several = serial_path(&usb_name::name_of(serial)).err();
    several.unwrap_or_else(|| "several adapters have this USB serial number: unplug the others".to_owned())
}

/// The serial numbers of all adapters; none where USB cannot be searched.
pub(crate) fn serial_numbers() -> Vec<String> {
    let adapters = adapters().unwrap_or_default().into_iter();
    adapters
        .filter_map(|adapter| adapter.serial_number().map(str::to_owned))
        .collect()
}

fn adapters() -> Result<Vec<DeviceInfo>, nusb::Error> {
    let devices = match nusb::list_devices().wait() {
        // Linux without USB.
        Err(error) if is_not_found(&error) => return Ok(Vec::new()),
        devices => devices?,
    };
    Ok(devices.filter(|device| control_interface(device).is_some()).collect())
}

fn is_not_found(error: &nusb::Error) -> bool {
    let code = error.os_error().and_then(|code| code.try_into().ok());
    code.is_some_and(|code| io::Error::from_raw_os_error(code).kind() == io::ErrorKind::NotFound)
}

/// The number of the control interface, if it is an adapter.
fn control_interface(device: &DeviceInfo) -> Option<u8> {
    let mut interfaces = device.interfaces();
    let is_control = |class, subclass, protocol| (class, subclass, protocol) == CLASS;
    let interface = interfaces.find(|it| is_control(it.class(), it.subclass(), it.protocol()))?;
    let is_adapter = (device.vendor_id(), device.product_id()) == VENDOR_AND_PRODUCT;
    is_adapter.then(|| interface.interface_number())
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
