//! The adapter on the USB host of this computer, through `nusb`. Only Linux lets a program detach the driver of a serial
//! port, so that elsewhere it cannot be opened.

use std::collections::VecDeque;
use std::thread;
use std::time::{Duration, Instant};

use armwire_host::control::{UsbFault, VENDOR_AND_PRODUCT};
use nusb::descriptors::{InterfaceDescriptor, TransferType};
use nusb::transfer::{
    Buffer, Bulk, ControlIn, ControlOut, ControlType, EndpointDirection, In, Out, Recipient, TransferError,
};
use nusb::{Device, DeviceInfo, Endpoint, ErrorKind, Interface, MaybeFuture};

use super::usb::{Direction, Payload, Pipe, Request, Usb, UsbError};

/// The classes of the interfaces: the serial port's two, and the control interface.
const COMMUNICATIONS: u8 = 0x02;
const DATA: u8 = 0x0A;
const VENDOR_SPECIFIC: u8 = 0xFF;

/// Timeout of a control transfer: the maximum for a device (USB 2.0, 9.2.6.1).
const CONTROL_TIMEOUT: Duration = Duration::from_secs(5);
/// Timeout of re-enumeration after a reset or restart, and the polling interval.
const REENUMERATION_TIMEOUT: Duration = Duration::from_secs(10);
const POLL_PERIOD: Duration = Duration::from_millis(100);
/// Maximum time until a restarting adapter disconnects.
const DISCONNECT_TIME: Duration = Duration::from_millis(500);
/// Timeout of pending transmissions, and of a cancelled transfer's end.
const END_TIMEOUT: Duration = Duration::from_secs(1);
/// Number of queued reads, which keeps the host polling without a pause, and the bytes of each.
const QUEUED_READS: usize = 8;
const READ_SIZE: usize = 512;

/// An adapter on this computer, with the driver of its serial port detached. Drop reattaches the driver.
pub(super) struct LinuxUsb {
    start: Instant,
    serial: String,
    /// `None` while the adapter is disconnected.
    adapter: Option<Adapter>,
}

/// The open adapter. The interfaces are released before the device.
struct Adapter {
    port: Bulks,
    control: Bulks,
    /// The serial port's first interface, the target of class requests.
    requests: Interface,
    device: Device,
}

/// An interface with a bulk endpoint in each direction.
struct Bulks {
    input: Endpoint<Bulk, In>,
    output: Endpoint<Bulk, Out>,
    /// Bytes read while an endpoint was released.
    unread: VecDeque<u8>,
    interface: Interface,
}

impl LinuxUsb {
    /// Opens the adapter with this serial number and detaches its driver.
    pub(super) fn open(serial: String) -> Result<Self, UsbFault> {
        let info = info(&serial).map_err(fault)?.ok_or(UsbFault::Disconnected)?;
        Ok(Self {
            start: Instant::now(),
            serial,
            adapter: Some(Adapter::open(&info).map_err(fault)?),
        })
    }

    fn adapter(&mut self) -> Result<&mut Adapter, UsbError> {
        self.adapter.as_mut().ok_or(UsbError::Gone)
    }

    fn bulks(&mut self, pipe: Pipe) -> Result<&mut Bulks, UsbError> {
        let adapter = self.adapter()?;
        Ok(match pipe {
            Pipe::Port => &mut adapter.port,
            Pipe::Control => &mut adapter.control,
        })
    }

    /// Waits until the adapter can be opened.
    fn find(&mut self) -> Result<(), UsbError> {
        let until = Instant::now() + REENUMERATION_TIMEOUT;
        loop {
            match info(&self.serial).map_err(host)?.map(|info| Adapter::open(&info)) {
                Some(Ok(adapter)) => {
                    self.adapter = Some(adapter);
                    return Ok(());
                }
                Some(Err(error)) if Instant::now() > until => return Err(host(error)),
                None if Instant::now() > until => return Err(UsbError::Gone),
                Some(Err(_)) | None => thread::sleep(POLL_PERIOD),
            }
        }
    }

    /// Ends all transfers and releases the interfaces.
    fn close(&mut self) -> Option<Device> {
        self.adapter.take().map(Adapter::close)
    }
}

impl Drop for LinuxUsb {
    fn drop(&mut self) {
        if self.adapter.is_none() {
            let _ = self.find();
        }
        if let Some(adapter) = self.adapter.take() {
            let number = adapter.requests.interface_number();
            // If the driver does not reattach, the serial port returns when the adapter is plugged in again.
            let _ = adapter.close().attach_kernel_driver(number);
        }
    }
}

impl Adapter {
    fn open(info: &DeviceInfo) -> Result<Self, nusb::Error> {
        // A missing interface gets number 255, which the claim refuses.
        let numbered = |class| {
            let mut interfaces = info.interfaces();
            interfaces
                .find(|it| it.class() == class)
                .map_or(u8::MAX, |it| it.interface_number())
        };
        let numbers = [COMMUNICATIONS, DATA, VENDOR_SPECIFIC].map(numbered);
        Self::claim(info.open().wait()?, numbers)
    }

    /// Claims the serial port's two interfaces and the control interface.
    fn claim(device: Device, [requests, data, control]: [u8; 3]) -> Result<Self, nusb::Error> {
        let claim = |number| device.claim_interface(number).wait();
        // The control interface comes first: another program may have it, and has no use for a detached driver.
        let control = Bulks::open(claim(control)?)?;
        // Detaching fails without a driver. If a driver stays, the claim reports the reason.
        let _ = device.detach_kernel_driver(requests);
        let port = || Ok((claim(requests)?, Bulks::open(claim(data)?)?));
        match port() {
            Ok((requests, port)) => Ok(Self {
                port,
                control,
                requests,
                device,
            }),
            Err(error) => {
                // If the driver does not reattach, the serial port returns when the adapter is plugged in again.
                let _ = device.attach_kernel_driver(requests);
                Err(error)
            }
        }
    }

    /// Ends all transfers and releases the interfaces.
    fn close(self) -> Device {
        let Self {
            port, control, device, ..
        } = self;
        port.close();
        control.close();
        device
    }
}

impl Bulks {
    fn open(interface: Interface) -> Result<Self, nusb::Error> {
        Self::open_with(interface, VecDeque::new())
    }

    fn open_with(interface: Interface, unread: VecDeque<u8>) -> Result<Self, nusb::Error> {
        let input = interface.endpoint(bulk(&interface, Direction::In))?;
        let output = interface.endpoint(bulk(&interface, Direction::Out))?;
        let mut bulks = Self {
            input,
            output,
            unread,
            interface,
        };
        bulks.queue_reads();
        Ok(bulks)
    }

    /// Queues reads on the IN endpoint.
    fn queue_reads(&mut self) {
        while self.input.pending() < QUEUED_READS {
            self.input.submit(Buffer::new(READ_SIZE));
        }
    }

    fn send(&mut self, bytes: &[u8]) -> Result<(), UsbError> {
        // The library panics if no transfer is pending.
        while self.output.pending() > 0
            && let Some(sent) = self.output.wait_next_complete(Duration::ZERO)
        {
            sent.status.map_err(transfer)?;
        }
        self.output.submit(bytes.to_vec().into());
        Ok(())
    }

    fn receive(&mut self, wait: Duration) -> Result<Vec<u8>, UsbError> {
        let mut bytes: Vec<u8> = self.unread.drain(..).collect();
        loop {
            // Each read has ended with an error, as after a disconnect. The library panics if no transfer is pending.
            if self.input.pending() == 0 {
                return if bytes.is_empty() {
                    Err(UsbError::Gone)
                } else {
                    Ok(bytes)
                };
            }
            let wait = if bytes.is_empty() { wait } else { Duration::ZERO };
            let Some(read) = self.input.wait_next_complete(wait) else {
                return Ok(bytes);
            };
            bytes.extend(&read.buffer[..read.actual_len]);
            match read.status {
                Ok(()) => self.input.submit(read.buffer),
                Err(error) => {
                    self.unread.extend(bytes);
                    return Err(transfer(error));
                }
            }
        }
    }

    /// Cancels the reads and keeps their bytes.
    fn end_reads(&mut self) {
        for read in end(&mut self.input) {
            self.unread.extend(read);
        }
    }

    /// Waits for pending transmissions, then cancels the rest.
    fn end_writes(&mut self) {
        let until = Instant::now() + END_TIMEOUT;
        while self.output.pending() > 0 && Instant::now() < until {
            self.output.wait_next_complete(POLL_PERIOD);
        }
        end(&mut self.output);
    }

    fn clear_halt(&mut self, direction: Direction) -> Result<(), UsbError> {
        match direction {
            Direction::In => {
                self.end_reads();
                self.input.clear_halt().wait().map_err(host)?;
                self.queue_reads();
                Ok(())
            }
            Direction::Out => {
                self.end_writes();
                self.output.clear_halt().wait().map_err(host)
            }
        }
    }

    /// Selects the only setting again. Returns the outcome and the interface.
    fn set_setting(mut self) -> Result<(Self, Result<(), nusb::Error>), UsbError> {
        self.end_writes();
        self.end_reads();
        let Self {
            input,
            output,
            unread,
            interface,
        } = self;
        drop((input, output));
        let result = interface.set_alt_setting(0).wait();
        let bulks = Self::open_with(interface, unread).map_err(host)?;
        Ok((bulks, result))
    }

    fn close(mut self) {
        end(&mut self.output);
        self.end_reads();
    }
}

/// Cancels an endpoint's transfers, waits for their completion and returns the buffer of each.
fn end<D: EndpointDirection>(endpoint: &mut Endpoint<Bulk, D>) -> Vec<Vec<u8>> {
    endpoint.cancel_all();
    let mut ended = Vec::new();
    while endpoint.pending() > 0
        && let Some(transfer) = endpoint.wait_next_complete(END_TIMEOUT)
    {
        ended.push(transfer.buffer[..transfer.actual_len].to_vec());
    }
    ended
}

impl Usb for LinuxUsb {
    fn now(&self) -> Duration {
        self.start.elapsed()
    }

    fn sleep(&mut self, span: Duration) -> Result<(), UsbError> {
        thread::sleep(span);
        Ok(())
    }

    fn control(&mut self, request: &Request<'_>) -> Result<Vec<u8>, UsbError> {
        control(&self.adapter()?.requests, request, CONTROL_TIMEOUT).map_err(transfer)
    }

    fn cancel(&mut self, request: &Request<'_>, after: Duration) -> Result<bool, UsbError> {
        match control(&self.adapter()?.requests, request, after) {
            Ok(_) => Ok(true),
            Err(TransferError::Cancelled) => Ok(false),
            Err(error) => Err(transfer(error)),
        }
    }

    fn send(&mut self, pipe: Pipe, bytes: &[u8]) -> Result<(), UsbError> {
        self.bulks(pipe)?.send(bytes)
    }

    fn receive(&mut self, pipe: Pipe, wait: Duration) -> Result<Vec<u8>, UsbError> {
        self.bulks(pipe)?.receive(wait)
    }

    fn clear_halt(&mut self, direction: Direction) -> Result<(), UsbError> {
        self.bulks(Pipe::Port)?.clear_halt(direction)
    }

    fn set_interface(&mut self) -> Result<(), UsbError> {
        let adapter = self.adapter.take().ok_or(UsbError::Gone)?;
        let (port, result) = adapter.port.set_setting()?;
        self.adapter = Some(Adapter { port, ..adapter });
        result.map_err(host)
    }

    fn set_configuration(&mut self) -> Result<(), UsbError> {
        let adapter = self.adapter.take().ok_or(UsbError::Gone)?;
        let interfaces = [&adapter.requests, &adapter.port.interface, &adapter.control.interface];
        let numbers = interfaces.map(Interface::interface_number);
        // Linux refuses this while any interface is claimed.
        let device = adapter.close();
        let result = device.set_configuration(1).wait();
        self.adapter = Some(Adapter::claim(device, numbers).map_err(host)?);
        result.map_err(host)
    }

    fn reset(&mut self) -> Result<(), UsbError> {
        let device = self.close().ok_or(UsbError::Gone)?;
        let result = device.reset().wait();
        drop(device);
        self.find()?;
        result.map_err(host)
    }

    fn reopen(&mut self) -> Result<(), UsbError> {
        drop(self.close());
        thread::sleep(DISCONNECT_TIME);
        self.find()
    }

    fn suspend(&mut self, _: Duration) -> Result<(), UsbError> {
        Err(UsbError::Unsupported(
            "a program cannot suspend the bus here: suspend this computer, and run the echo again".to_owned(),
        ))
    }
}

/// The adapter with this serial number, if it is connected.
fn info(serial: &str) -> Result<Option<DeviceInfo>, nusb::Error> {
    let mut devices = nusb::list_devices().wait()?;
    Ok(devices.find(|info| {
        (info.vendor_id(), info.product_id()) == VENDOR_AND_PRODUCT && info.serial_number() == Some(serial)
    }))
}

/// The address of an interface's bulk endpoint. A missing endpoint gets 0, which `nusb` refuses.
fn bulk(interface: &Interface, direction: Direction) -> u8 {
    let descriptor = interface.descriptor();
    let mut endpoints = descriptor.iter().flat_map(InterfaceDescriptor::endpoints);
    let endpoint = endpoints.find(|it| it.direction() == direction && it.transfer_type() == TransferType::Bulk);
    endpoint.map_or(0, |endpoint| endpoint.address())
}

/// Makes a control transfer with a timeout.
fn control(interface: &Interface, request: &Request<'_>, timeout: Duration) -> Result<Vec<u8>, TransferError> {
    let control_type = match request.kind >> 5 & 3 {
        0 => ControlType::Standard,
        1 => ControlType::Class,
        _ => ControlType::Vendor,
    };
    let recipient = match request.kind & 0x1F {
        0 => Recipient::Device,
        1 => Recipient::Interface,
        2 => Recipient::Endpoint,
        _ => Recipient::Other,
    };
    let (value, index) = (request.value, request.index);
    match request.payload {
        Payload::Read(length) => {
            let setup = ControlIn {
                control_type,
                recipient,
                request: request.request,
                value,
                index,
                length,
            };
            interface.control_in(setup, timeout).wait()
        }
        Payload::Write(data) => {
            let setup = ControlOut {
                control_type,
                recipient,
                request: request.request,
                value,
                index,
                data,
            };
            interface.control_out(setup, timeout).wait().map(|()| Vec::new())
        }
    }
}

fn transfer(error: TransferError) -> UsbError {
    match error {
        TransferError::Stall => UsbError::Stalled,
        TransferError::Cancelled => UsbError::TimedOut,
        TransferError::Disconnected => UsbError::Gone,
        error => UsbError::Host(error.to_string()),
    }
}

fn fault(error: nusb::Error) -> UsbFault {
    match error.kind() {
        ErrorKind::PermissionDenied => UsbFault::PermissionDenied,
        ErrorKind::Busy => UsbFault::Busy,
        ErrorKind::Disconnected => UsbFault::Disconnected,
        _ => UsbFault::Other(error.to_string().into()),
    }
}

fn host(error: nusb::Error) -> UsbError {
    match error.kind() {
        ErrorKind::Disconnected => UsbError::Gone,
        _ => UsbError::Host(error.to_string()),
    }
}
