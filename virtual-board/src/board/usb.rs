//! The API of the USB host.

use std::sync::Mutex;

use super::VirtualBoard;
use crate::error::Error;
use crate::line::Arm;
use crate::shared::lock;
use crate::time::Nanos;
use crate::usb::Direction;
use crate::usb::cdc::{LineCoding, Port};
use crate::usb::descriptor::Endpoint;
use crate::usb::enumerate::{self, Enumerated};
use crate::usb::host::{Host, Packet, Request, TransferError};
use crate::usb::vendor::Vendor;

/// Time limit of a control transfer, by the standard (USB 2.0, 9.2.6.1).
const CONTROL_LIMIT: Nanos = Nanos::from_millis(5_000);

/// Time limit from power to the pull-up.
const CONNECT_LIMIT: Nanos = Nanos::from_millis(2_000);

/// The address that the host gives the device.
const ADDRESS: u8 = 1;

/// Standard requests (USB 2.0, tables 9-2 to 9-6).
const TO_DEVICE: u8 = 0x00;
const TO_INTERFACE: u8 = 0x01;
const TO_ENDPOINT: u8 = 0x02;
const FROM_ENDPOINT: u8 = 0x82;
const GET_STATUS: u8 = 0;
const CLEAR_FEATURE: u8 = 1;
const SET_FEATURE: u8 = 3;
const SET_CONFIGURATION: u8 = 9;
const SET_INTERFACE: u8 = 11;
const ENDPOINT_HALT: u16 = 0;

/// The USB host and its open serial port.
#[derive(Debug)]
pub struct Usb<'a, A: Arm> {
    board: &'a mut VirtualBoard<A>,
}

impl<A: Arm> VirtualBoard<A> {
    /// The USB host.
    pub fn usb(&mut self) -> Usb<'_, A> {
        Usb { board: self }
    }
}

impl<A: Arm> Usb<'_, A> {
    /// Plugs the cable in.
    pub fn attach(&mut self) {
        self.host(|host| host.set_cable(true));
    }

    /// Unplugs the cable. Open interfaces close.
    pub fn detach(&mut self) {
        self.host(|host| host.set_cable(false));
        self.board.device = None;
        self.board.close();
    }

    /// Returns true if a device is connected.
    pub fn connected(&self) -> bool {
        self.host(|host| host.connected())
    }

    /// Waits for a device and brings it to its first configuration: bus reset, descriptors, address.
    ///
    /// # Errors
    ///
    /// [`Error::NoDevice`], or the device's failure.
    pub fn enumerate(&mut self) -> Result<&Enumerated, Error> {
        self.board.close();
        let appeared = self
            .board
            .run_until(CONNECT_LIMIT, |board| lock(&board.host).connected());
        appeared.map_err(|error| match error {
            Error::TimedOut { limit } => Error::NoDevice { limit },
            other => other,
        })?;
        let mut bus = Wire {
            board: self.board,
            failed: None,
        };
        let device = enumerate::enumerate(&mut bus, ADDRESS);
        if let Some(error) = bus.failed {
            return Err(error);
        }
        let epoch = self.host(|host| host.epoch());
        Ok(&self.board.device.insert((epoch, device?)).1)
    }

    /// Opens the device's serial port number `nth`, from 0, as a program does: with `coding`, DTR and RTS on. An
    /// unconfigured device is enumerated first.
    ///
    /// # Errors
    ///
    /// As for [`enumerate`](Self::enumerate), and if there is no such port.
    pub fn open(&mut self, nth: usize, coding: LineCoding) -> Result<(), Error> {
        self.open_without_dtr(nth, coding)?;
        self.set_control_lines(true, true)
    }

    /// Opens a port as [`open`](Self::open) does, but leaves DTR and RTS unchanged.
    ///
    /// # Errors
    ///
    /// The same.
    pub fn open_without_dtr(&mut self, nth: usize, coding: LineCoding) -> Result<(), Error> {
        if self.device().is_none() {
            self.enumerate()?;
        }
        let ports = self
            .device()
            .map_or_else(Vec::new, |device| Port::find(&device.configuration));
        let port = *ports.get(nth).ok_or(Error::NoPort {
            nth,
            count: ports.len(),
        })?;
        self.use_endpoints([Some(port.output), Some(port.input), port.notify].into_iter().flatten());
        self.board.port = Some(port);
        self.set_line_coding(coding)
    }

    /// Opens the device's vendor-specific interface, besides its serial port. An unconfigured device is enumerated
    /// first.
    ///
    /// # Errors
    ///
    /// As for [`enumerate`](Self::enumerate), and if there is no such interface.
    pub fn open_vendor(&mut self) -> Result<(), Error> {
        if self.device().is_none() {
            self.enumerate()?;
        }
        let found = self.device().and_then(|device| Vendor::find(&device.configuration));
        let vendor = found.ok_or(Error::NoVendor)?;
        self.use_endpoints([vendor.output, vendor.input]);
        self.board.vendor = Some(vendor);
        Ok(())
    }

    /// Makes the host serve additional endpoints.
    fn use_endpoints(&self, endpoints: impl IntoIterator<Item = Endpoint>) {
        self.host(|host| {
            for endpoint in endpoints {
                if !host.is_open(endpoint.number, endpoint.direction) {
                    host.open(ADDRESS, endpoint);
                }
            }
        });
    }

    /// The enumerated device, while it stays connected.
    pub fn device(&self) -> Option<&Enumerated> {
        let epoch = self.host(|host| host.epoch());
        let (enumerated, device) = self.board.device.as_ref()?;
        (*enumerated == epoch).then_some(device)
    }

    /// Returns true while a serial port is open and the device is connected.
    pub fn is_open(&self) -> bool {
        self.serial().is_open()
    }

    /// Runs one control transfer with the device, on endpoint 0.
    ///
    /// # Errors
    ///
    /// The transfer's error.
    pub fn control(&mut self, request: Request) -> Result<Vec<u8>, Error> {
        let packet = self.device().map_or(64, |device| device.device.packet);
        Ok(self.board.control(ADDRESS, packet, request)??)
    }

    /// Starts a control transfer and abandons it after `span`, in any stage. Returns true if it completed before.
    ///
    /// # Errors
    ///
    /// The error of the run.
    pub fn abandon(&mut self, request: Request, span: impl Into<Nanos>) -> Result<bool, Error> {
        let packet = self.device().map_or(64, |device| device.device.packet);
        self.host(|host| host.start_control(ADDRESS, packet, request));
        self.board.run_for(span)?;
        Ok(self.host(|host| {
            host.abandon_control();
            host.take_control().is_some()
        }))
    }

    /// Halts one direction of the open port, as a device test does (USB 2.0, 9.4.9).
    ///
    /// # Errors
    ///
    /// [`Error::NotOpen`], or the error of the request.
    pub fn set_halt(&mut self, direction: Direction) -> Result<(), Error> {
        let endpoint = self.port_endpoint(direction)?;
        let request = Request::write(
            TO_ENDPOINT,
            SET_FEATURE,
            ENDPOINT_HALT,
            address_of(endpoint),
            Vec::new(),
        );
        self.control(request).map(|_| ())
    }

    /// Clears the halt of one direction of the open port, and resets the host's data toggle to DATA0 (USB 2.0, 9.4.5).
    ///
    /// # Errors
    ///
    /// [`Error::NotOpen`], or the error of the request.
    pub fn clear_halt(&mut self, direction: Direction) -> Result<(), Error> {
        let endpoint = self.port_endpoint(direction)?;
        let request = Request::write(
            TO_ENDPOINT,
            CLEAR_FEATURE,
            ENDPOINT_HALT,
            address_of(endpoint),
            Vec::new(),
        );
        self.control_anew(&[endpoint], request)
    }

    /// Returns true if one direction of the open port is halted (USB 2.0, 9.4.5, GET_STATUS).
    ///
    /// # Errors
    ///
    /// [`Error::NotOpen`], or the error of the request.
    pub fn is_halted(&mut self, direction: Direction) -> Result<bool, Error> {
        let endpoint = self.port_endpoint(direction)?;
        let request = Request::read(FROM_ENDPOINT, GET_STATUS, 0, address_of(endpoint), 2);
        Ok(self.control(request)? == [1, 0])
    }

    /// Selects the first alternate setting of the open port's data interface again, and resets the host's data toggles
    /// to DATA0 (USB 2.0, 9.4.10).
    ///
    /// # Errors
    ///
    /// [`Error::NotOpen`], or the error of the request.
    pub fn set_interface(&mut self) -> Result<(), Error> {
        let endpoints = [self.port_endpoint(Direction::Out)?, self.port_endpoint(Direction::In)?];
        let interface = self.port()?.data.into();
        self.control_anew(
            &endpoints,
            Request::write(TO_INTERFACE, SET_INTERFACE, 0, interface, Vec::new()),
        )
    }

    /// Selects a configuration, 0 for none, and resets the host's data toggles of all endpoints to DATA0 (USB 2.0,
    /// 9.1.1.5, 9.4.7).
    ///
    /// # Errors
    ///
    /// The error of the request.
    pub fn set_configuration(&mut self, value: u8) -> Result<(), Error> {
        let endpoints = self.host(|host| host.open_endpoints());
        self.control_anew(
            &endpoints,
            Request::write(TO_DEVICE, SET_CONFIGURATION, value.into(), 0, Vec::new()),
        )
    }

    /// The host's data toggle of one direction of the open port: true for DATA1.
    pub fn toggle(&self, direction: Direction) -> Option<bool> {
        let (endpoint, direction) = self.port_endpoint(direction).ok()?;
        self.host(|host| host.toggle(endpoint, direction))
    }

    /// Runs a control transfer that resets endpoints to DATA0, while none of their packets is on the wire.
    fn control_anew(&mut self, endpoints: &[(u8, Direction)], request: Request) -> Result<(), Error> {
        let each = |host: &Mutex<Host>, act: fn(&mut Host, u8, Direction)| {
            for &(endpoint, direction) in endpoints {
                act(&mut lock(host), endpoint, direction);
            }
        };
        each(&self.board.host, Host::pause);
        let result = self.control(request);
        each(&self.board.host, Host::start_anew);
        result.map(|_| ())
    }

    fn port_endpoint(&self, direction: Direction) -> Result<(u8, Direction), Error> {
        let port = self.port()?;
        let endpoint = match direction {
            Direction::Out => port.output,
            Direction::In => port.input,
        };
        Ok((endpoint.number, direction))
    }

    /// Sets the line coding of the open port.
    ///
    /// # Errors
    ///
    /// [`Error::NotOpen`], or the error of the request.
    pub fn set_line_coding(&mut self, coding: LineCoding) -> Result<(), Error> {
        let request = self.port()?.set_line_coding(coding);
        self.control(request).map(|_| ())
    }

    /// Reads the line coding of the open port. `None` for an invalid answer.
    ///
    /// # Errors
    ///
    /// [`Error::NotOpen`], or the error of the request.
    pub fn line_coding(&mut self) -> Result<Option<LineCoding>, Error> {
        let request = self.port()?.get_line_coding();
        Ok(LineCoding::decode(&self.control(request)?))
    }

    /// Drives DTR and RTS of the open port.
    ///
    /// # Errors
    ///
    /// [`Error::NotOpen`], or the error of the request.
    pub fn set_control_lines(&mut self, dtr: bool, rts: bool) -> Result<(), Error> {
        let request = self.port()?.set_control_lines(dtr, rts);
        self.control(request).map(|_| ())
    }

    /// The bytes of the open port.
    pub fn serial(&self) -> Pipe<'_> {
        self.pipe(self.board.port.map(|port| (port.output, port.input)))
    }

    /// The bytes of the open vendor-specific interface.
    pub fn vendor(&self) -> Pipe<'_> {
        self.pipe(self.board.vendor.map(|vendor| (vendor.output, vendor.input)))
    }

    fn pipe(&self, endpoints: Option<(Endpoint, Endpoint)>) -> Pipe<'_> {
        Pipe {
            host: &self.board.host,
            endpoints,
        }
    }

    /// Queues bytes for the open port, in packets of its maximum size. They are sent while the board runs.
    ///
    /// # Errors
    ///
    /// [`Error::NotOpen`].
    pub fn write(&mut self, bytes: &[u8]) -> Result<(), Error> {
        self.serial().write(bytes)
    }

    /// Number of bytes queued for the open port that were not sent yet.
    pub fn unsent(&self) -> usize {
        self.serial().unsent()
    }

    /// Takes the bytes received from the open port.
    pub fn read(&mut self) -> Vec<u8> {
        self.serial().read()
    }

    /// Number of bytes received from the open port that were not read yet.
    pub fn unread(&self) -> usize {
        self.serial().unread()
    }

    /// Enables IN transfers of the open port. A host disables them if a program does not read.
    pub fn set_reading(&mut self, reading: bool) {
        self.serial().set_reading(reading);
    }

    /// Ends the next `count` data transactions of the open port with a NAK, independent of the device.
    pub fn inject_naks(&mut self, direction: Direction, count: u32) {
        self.serial().inject_naks(direction, count);
    }

    /// Resets the bus, as a host does to recover. Open interfaces close.
    pub fn reset_bus(&mut self) {
        self.host(Host::reset);
        self.board.device = None;
        self.board.close();
    }

    /// Suspends the bus.
    pub fn suspend(&mut self) {
        self.host(Host::suspend);
    }

    /// Wakes the bus.
    pub fn resume(&mut self) {
        self.host(Host::resume);
    }

    /// Sets the polling interval of idle endpoints, [`Host::poll_interval`].
    pub fn set_poll_interval(&mut self, interval: impl Into<Nanos>) {
        self.host(|host| host.poll_interval = interval.into());
    }

    /// Every data packet since the beginning, except on endpoint 0, in order.
    pub fn packets(&self) -> Vec<Packet> {
        self.host(|host| host.packets().to_vec())
    }

    /// Clears the record of packets.
    pub fn forget_packets(&mut self) {
        self.host(Host::forget_packets);
    }

    fn port(&self) -> Result<Port, Error> {
        self.board.port.ok_or(Error::NotOpen)
    }

    fn host<R>(&self, use_it: impl FnOnce(&mut Host) -> R) -> R {
        use_it(&mut lock(&self.board.host))
    }
}

impl<A: Arm> VirtualBoard<A> {
    fn close(&mut self) {
        self.port = None;
        self.vendor = None;
    }

    fn control(&mut self, address: u8, packet: u8, request: Request) -> Result<Result<Vec<u8>, TransferError>, Error> {
        lock(&self.host).start_control(address, packet, request);
        let mut result = None;
        let ended = self.run_until(CONTROL_LIMIT, |board| {
            result = lock(&board.host).take_control();
            result.is_some()
        });
        match (ended, result) {
            (_, Some(result)) => Ok(result),
            (Err(Error::TimedOut { .. }) | Ok(_), None) => {
                lock(&self.host).abandon_control();
                Ok(Err(TransferError::TimedOut))
            }
            (Err(error), None) => Err(error),
        }
    }
}

/// The endpoint address in a request (USB 2.0, 9.3.4).
fn address_of((endpoint, direction): (u8, Direction)) -> u16 {
    let direction = match direction {
        Direction::Out => 0,
        Direction::In => 0x80,
    };
    direction | u16::from(endpoint)
}

/// The bytes of one of the device's interfaces, in both directions. A closed interface accepts none and has none.
#[derive(Clone, Copy, Debug)]
pub struct Pipe<'a> {
    host: &'a Mutex<Host>,
    /// The OUT and the IN endpoint.
    endpoints: Option<(Endpoint, Endpoint)>,
}

impl Pipe<'_> {
    /// Returns true while it is open and the device is connected.
    pub fn is_open(&self) -> bool {
        self.with(|host, (output, _)| host.is_open(output.number, Direction::Out))
            .unwrap_or(false)
    }

    /// Queues bytes, in packets of the interface's maximum size. They are sent while the board runs.
    ///
    /// # Errors
    ///
    /// [`Error::NotOpen`].
    pub fn write(&self, bytes: &[u8]) -> Result<(), Error> {
        let queued = self.with(|host, (output, _)| host.write(output.number, bytes));
        if queued == Some(true) {
            Ok(())
        } else {
            Err(Error::NotOpen)
        }
    }

    /// Number of queued bytes that were not sent yet.
    pub fn unsent(&self) -> usize {
        self.with(|host, (output, _)| host.unsent(output.number)).unwrap_or(0)
    }

    /// Takes the received bytes.
    pub fn read(&self) -> Vec<u8> {
        self.with(|host, (_, input)| host.read(input.number))
            .unwrap_or_default()
    }

    /// Number of received bytes that were not read yet.
    pub fn unread(&self) -> usize {
        self.with(|host, (_, input)| host.unread(input.number)).unwrap_or(0)
    }

    /// Enables IN transfers. A host disables them if a program does not read.
    pub fn set_reading(&self, reading: bool) {
        self.with(|host, (_, input)| host.set_reading(input.number, reading));
    }

    /// Ends the next `count` data transactions with a NAK, independent of the device.
    pub fn inject_naks(&self, direction: Direction, count: u32) {
        self.with(|host, (output, input)| {
            let endpoint = match direction {
                Direction::Out => output,
                Direction::In => input,
            };
            host.inject_naks(endpoint.number, direction, count);
        });
    }

    fn with<R>(&self, use_it: impl FnOnce(&mut Host, (Endpoint, Endpoint)) -> R) -> Option<R> {
        let endpoints = self.endpoints?;
        Some(use_it(&mut lock(self.host), endpoints))
    }
}

/// The bus for enumeration. If the run fails, so does every later transfer.
struct Wire<'a, A: Arm> {
    board: &'a mut VirtualBoard<A>,
    failed: Option<Error>,
}

impl<A: Arm> enumerate::Bus for Wire<'_, A> {
    fn wait(&mut self, span: Nanos) {
        if self.failed.is_none() {
            self.failed = self.board.run_for(span).err();
        }
    }

    fn reset(&mut self) {
        if self.failed.is_none() {
            lock(&self.board.host).reset();
            // The reset ends, then frames follow.
            let over = self.board.run_until(CONTROL_LIMIT, |board| lock(&board.host).running());
            self.failed = over.err();
        }
    }

    fn control(&mut self, address: u8, packet: u8, request: Request) -> Result<Vec<u8>, TransferError> {
        if self.failed.is_some() {
            return Err(TransferError::Disconnected);
        }
        self.board.control(address, packet, request).unwrap_or_else(|error| {
            self.failed = Some(error);
            Err(TransferError::Disconnected)
        })
    }
}
