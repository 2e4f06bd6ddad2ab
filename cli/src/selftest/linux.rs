//! The adapter on the USB host of this computer, by `nusb`. Linux alone lets a program take the serial port from its driver.

use std::collections::VecDeque;
use std::thread;
use std::time::{Duration, Instant};

use nusb::descriptors::{InterfaceDescriptor, TransferType};
use nusb::transfer::{
    Buffer, Bulk, ControlIn, ControlOut, ControlType, Direction as Way, EndpointDirection, In, Out, Recipient,
    TransferError,
};
use nusb::{Device, DeviceInfo, Endpoint, ErrorKind, Interface, MaybeFuture};

use super::usb::{Direction, Payload, Pipe, Request, Usb, UsbError};

/// The classes of the interfaces: the serial port's two, and the control interface.
const COMMUNICATIONS: u8 = 0x02;
const DATA: u8 = 0x0A;
const VENDOR_SPECIFIC: u8 = 0xFF;

/// How long a control transfer may take: a device that needs longer is broken (USB 2.0, 9.2.6.1).
const CONTROL: Duration = Duration::from_secs(5);
/// How long an adapter that was reset or starts again may be gone, and how often it is looked for.
const GONE: Duration = Duration::from_secs(10);
const GLANCE: Duration = Duration::from_millis(100);
/// How long an adapter that starts again is still there.
const LEAVING: Duration = Duration::from_millis(500);
/// How long what was handed over may take to go, and a transfer that was cancelled to end.
const LEFT: Duration = Duration::from_secs(1);
/// Reads that wait for the adapter at a time, so that it is asked without a pause, and the bytes of each.
const READS: usize = 8;
const READ: usize = 512;

/// An adapter on this computer, without the driver of its serial port. The driver has it back once this is dropped.
pub(super) struct LinuxUsb {
    start: Instant,
    serial: String,
    /// `None` while the adapter is gone.
    adapter: Option<Adapter>,
}

/// The open adapter. The interfaces are given back before the device is.
struct Adapter {
    port: Bulks,
    control: Bulks,
    /// The serial port's first interface, which class requests go to.
    requests: Interface,
    device: Device,
}

/// An interface with a bulk endpoint each way.
struct Bulks {
    input: Endpoint<Bulk, In>,
    output: Endpoint<Bulk, Out>,
    /// What was read while an endpoint was given back.
    unread: VecDeque<u8>,
    interface: Interface,
}

impl LinuxUsb {
    /// Takes the adapter from its driver.
    pub(super) fn open(info: &DeviceInfo) -> Result<Self, nusb::Error> {
        Ok(Self {
            start: Instant::now(),
            serial: info.serial_number().unwrap_or_default().to_owned(),
            adapter: Some(Adapter::open(info)?),
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
        let until = Instant::now() + GONE;
        loop {
            let devices = nusb::list_devices().wait().map_err(host)?;
            let mut same = devices.filter(|info| info.serial_number() == Some(&self.serial));
            match same.next().map(|info| Adapter::open(&info)) {
                Some(Ok(adapter)) => {
                    self.adapter = Some(adapter);
                    return Ok(());
                }
                Some(Err(error)) if Instant::now() > until => return Err(host(error)),
                None if Instant::now() > until => return Err(UsbError::Gone),
                Some(Err(_)) | None => thread::sleep(GLANCE),
            }
        }
    }

    /// Ends all transfers, and gives the interfaces back.
    fn close(&mut self) -> Option<Device> {
        self.adapter.take().map(Adapter::close)
    }
}

impl Drop for LinuxUsb {
    fn drop(&mut self) {
        if self.adapter.is_none() {
            let _ = self.find();
        }
        if let Some(device) = self.close() {
            // Without its driver the serial port is back once the adapter is plugged in again.
            let _ = device.attach_kernel_driver(0);
        }
    }
}

impl Adapter {
    fn open(info: &DeviceInfo) -> Result<Self, nusb::Error> {
        // Where there is none, the claim fails for an interface that is not there.
        let numbered = |class| {
            let mut interfaces = info.interfaces();
            interfaces
                .find(|it| it.class() == class)
                .map_or(u8::MAX, |it| it.interface_number())
        };
        let numbers = [COMMUNICATIONS, DATA, VENDOR_SPECIFIC].map(numbered);
        Self::claim(info.open().wait()?, numbers)
    }

    /// Takes the serial port's two interfaces and the control interface.
    fn claim(device: Device, [requests, data, control]: [u8; 3]) -> Result<Self, nusb::Error> {
        // A driver that is not there cannot be detached. If it stays, the claim fails and says why.
        let _ = device.detach_kernel_driver(requests);
        let claim = |number| device.claim_interface(number).wait();
        Ok(Self {
            requests: claim(requests)?,
            port: Bulks::open(claim(data)?)?,
            control: Bulks::open(claim(control)?)?,
            device,
        })
    }

    /// Ends all transfers, and gives the interfaces back.
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
        // Where there is none, the library fails for an endpoint that is not there.
        let address = |way| {
            let descriptor = interface.descriptor();
            let is_it = |it: &nusb::descriptors::EndpointDescriptor<'_>| {
                it.direction() == way && it.transfer_type() == TransferType::Bulk
            };
            let mut endpoints = descriptor.iter().flat_map(InterfaceDescriptor::endpoints);
            endpoints.find(is_it).map_or(0, |it| it.address())
        };
        let mut bulks = Self {
            input: interface.endpoint(address(Way::In))?,
            output: interface.endpoint(address(Way::Out))?,
            unread,
            interface,
        };
        bulks.ask();
        Ok(bulks)
    }

    /// Lets the host ask the adapter for bytes.
    fn ask(&mut self) {
        while self.input.pending() < READS {
            self.input.submit(Buffer::new(READ));
        }
    }

    fn send(&mut self, bytes: &[u8]) -> Result<(), UsbError> {
        while let Some(sent) = self.output.wait_next_complete(Duration::ZERO) {
            sent.status.map_err(transfer)?;
        }
        self.output.submit(bytes.to_vec().into());
        Ok(())
    }

    fn receive(&mut self, wait: Duration) -> Result<Vec<u8>, UsbError> {
        let mut bytes: Vec<u8> = self.unread.drain(..).collect();
        loop {
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

    /// Ends the reads, and keeps what they read.
    fn end_reads(&mut self) {
        for read in end(&mut self.input) {
            self.unread.extend(read);
        }
    }

    /// Lets what was handed over go, and ends what does not.
    fn end_writes(&mut self) {
        let until = Instant::now() + LEFT;
        while self.output.pending() > 0 && Instant::now() < until {
            self.output.wait_next_complete(GLANCE);
        }
        end(&mut self.output);
    }

    fn clear_halt(&mut self, direction: Direction) -> Result<(), UsbError> {
        match direction {
            Direction::In => {
                self.end_reads();
                self.input.clear_halt().wait().map_err(host)?;
                self.ask();
                Ok(())
            }
            Direction::Out => {
                self.end_writes();
                self.output.clear_halt().wait().map_err(host)
            }
        }
    }

    /// Selects the only setting again, and returns whether that succeeded with the interface.
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

/// Cancels an endpoint's transfers, waits for their ends, and returns what each had read or sent.
fn end<D: EndpointDirection>(endpoint: &mut Endpoint<Bulk, D>) -> Vec<Vec<u8>> {
    endpoint.cancel_all();
    let mut ended = Vec::new();
    while endpoint.pending() > 0
        && let Some(transfer) = endpoint.wait_next_complete(LEFT)
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
        control(&self.adapter()?.device, request, CONTROL).map_err(transfer)
    }

    fn cancel(&mut self, request: &Request<'_>, after: Duration) -> Result<bool, UsbError> {
        match control(&self.adapter()?.device, request, after) {
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
        // The system refuses while any interface is claimed.
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
        thread::sleep(LEAVING);
        self.find()
    }

    fn suspend(&mut self, _: Duration) -> Result<(), UsbError> {
        Err(UsbError::Unsupported(
            "a program cannot suspend the bus here: suspend this computer, and run the echo again".to_owned(),
        ))
    }
}

/// Makes a control transfer, which is cancelled after this time.
fn control(device: &Device, request: &Request<'_>, timeout: Duration) -> Result<Vec<u8>, TransferError> {
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
            device.control_in(setup, timeout).wait()
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
            device.control_out(setup, timeout).wait().map(|()| Vec::new())
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

fn host(error: nusb::Error) -> UsbError {
    match error.kind() {
        ErrorKind::Disconnected => UsbError::Gone,
        _ => UsbError::Host(error.to_string()),
    }
}
