//! A virtual board on the bench: its USB host as the checks of `armwire selftest` use it, and the jumper on its UART.

use std::collections::VecDeque;
use std::mem;
use std::time::Duration;

use armwire_bridge::Instant;
use armwire_bridge::control::Request::ResetConfig;
use armwire_cli::selftest::{Direction, Payload, Pipe, Usb, UsbError, UsbRequest};
use armwire_host_tests::image::{Control, MEGABAUD};
use armwire_sim::serial::SerialDevice;
use armwire_virtual_board::usb::Direction as UsbDirection;
use armwire_virtual_board::usb::cdc::{LineCoding, Port};
use armwire_virtual_board::usb::host::{Request, TransferError};
use armwire_virtual_board::{Arm, Error, Nanos, VirtualBoard};

/// Timeout of a bus reset, and of the adapter's start.
const RESET: Nanos = Nanos::from_millis(20);
const START: Nanos = Nanos::from_millis(5_000);

/// A fault of the jumper.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Fault {
    #[default]
    None,
    /// It comes off after this number of bytes.
    OutAfter(usize),
    /// The lowest bit of the byte after this number of others is flipped.
    FlipAfter(usize),
}

/// The device on the UART in place of the arm.
#[derive(Debug, Default)]
pub(crate) struct Jumper {
    pub(crate) fault: Fault,
    /// An arm on the same line.
    arm: Option<Box<dyn Arm>>,
    /// True if it sends without a pause.
    pub(crate) is_sending: bool,
    passed: usize,
    received: Vec<u8>,
    bytes: VecDeque<u8>,
}

impl Jumper {
    pub(crate) fn with(fault: Fault) -> Self {
        Self {
            fault,
            ..Self::default()
        }
    }

    pub(crate) fn beside(arm: impl Arm) -> Self {
        Self {
            arm: Some(Box::new(arm)),
            ..Self::default()
        }
    }

    /// Bytes received since the last call.
    pub(crate) fn take_received(&mut self) -> Vec<u8> {
        mem::take(&mut self.received)
    }
}

impl SerialDevice for Jumper {
    fn receive(&mut self, now: Instant, byte: u8) {
        if let Some(arm) = &mut self.arm {
            arm.receive(now, byte);
        }
        match self.fault {
            Fault::OutAfter(passed) if self.passed >= passed => {}
            Fault::FlipAfter(passed) if self.passed == passed => self.bytes.push_back(byte ^ 1),
            _ => self.bytes.push_back(byte),
        }
        self.passed += 1;
        self.received.push(byte);
    }

    fn transmit(&mut self, now: Instant) -> Option<u8> {
        let byte = self.bytes.pop_front().or(self.is_sending.then_some(0x55));
        byte.or_else(|| self.arm.as_mut().and_then(|arm| arm.transmit(now)))
    }

    fn poll_timeout(&self) -> Option<Instant> {
        match self.bytes.is_empty() && !self.is_sending {
            true => self.arm.as_ref().and_then(|arm| arm.poll_timeout()),
            false => Some(Instant::ZERO),
        }
    }
}

/// The USB host of a virtual board, and its faults.
pub(crate) struct BoardUsb<'b> {
    pub(crate) board: &'b mut VirtualBoard<Jumper>,
    /// Changes the adapter's answer to a control transfer.
    pub(crate) answers: fn(&UsbRequest<'_>, Vec<u8>) -> Result<Vec<u8>, UsbError>,
    /// The rate of the host's clock, in parts per thousand.
    pub(crate) clock: u32,
    /// Delay that the system adds to each operation.
    pub(crate) latency: Duration,
    /// The host makes the adapter reset its data toggles, and keeps its own.
    pub(crate) keeps_toggles: bool,
    /// The adapter loses the saved configuration at a restart.
    pub(crate) forgets: bool,
    /// True if the host can suspend the bus.
    pub(crate) suspend: Suspend,
}

/// A host's response to a request to suspend the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Suspend {
    Yes,
    Pretended,
    Unsupported,
}

impl<'b> BoardUsb<'b> {
    /// Plugs the cable in.
    pub(crate) fn new(board: &'b mut VirtualBoard<Jumper>) -> Self {
        board.usb().attach();
        let mut usb = Self {
            board,
            answers: |_, answer| Ok(answer),
            clock: 1_000,
            latency: Duration::ZERO,
            keeps_toggles: false,
            forgets: false,
            suspend: Suspend::Yes,
        };
        usb.open().unwrap();
        usb
    }

    fn open(&mut self) -> Result<(), UsbError> {
        let mut usb = self.board.usb();
        usb.enumerate().map_err(error)?;
        usb.open_without_dtr(0, LineCoding::new(MEGABAUD)).map_err(error)?;
        usb.open_vendor().map_err(error)
    }

    /// Makes a request without data. The host's state does not change.
    fn request(&mut self, kind: u8, request: u8, value: u16, index: u16) -> Result<(), UsbError> {
        let result = self
            .board()
            .usb()
            .control(Request::write(kind, request, value, index, Vec::new()));
        result.map(|_| ()).map_err(error)
    }

    /// Sets the jumper's rate and format to those of the UART: a jumper has none of its own.
    fn board(&mut self) -> &mut VirtualBoard<Jumper> {
        let uart = self.board.uart();
        if let Some(baud) = uart.baud() {
            uart.set_arm_baud(baud as u32);
        }
        uart.set_arm_format(uart.format());
        uart.forget_bytes();
        self.board.usb().forget_packets();
        self.board
    }
}

impl Usb for BoardUsb<'_> {
    fn now(&self) -> Duration {
        Duration::from_nanos(self.board.now().0 / 1_000 * u64::from(self.clock))
    }

    fn sleep(&mut self, span: Duration) -> Result<(), UsbError> {
        self.board().run_for(nanos(span)).map_err(error)
    }

    fn control(&mut self, request: &UsbRequest<'_>) -> Result<Vec<u8>, UsbError> {
        let answer = self.board().usb().control(to_host(request)).map_err(error)?;
        (self.answers)(request, answer)
    }

    fn cancel(&mut self, request: &UsbRequest<'_>, after: Duration) -> Result<bool, UsbError> {
        let cancelled = self.board().usb().abandon(to_host(request), nanos(after));
        cancelled.map_err(error)
    }

    fn send(&mut self, pipe: Pipe, bytes: &[u8]) -> Result<(), UsbError> {
        let mut usb = self.board().usb();
        let sent = match pipe {
            Pipe::Port => usb.write(bytes),
            Pipe::Control => usb.vendor().write(bytes),
        };
        sent.map_err(error)
    }

    fn receive(&mut self, pipe: Pipe, wait: Duration) -> Result<Vec<u8>, UsbError> {
        let unread = |board: &mut VirtualBoard<Jumper>| match pipe {
            Pipe::Port => board.usb().unread(),
            Pipe::Control => board.usb().vendor().unread(),
        };
        let latency = nanos(self.latency);
        let board = self.board();
        match board.run_until(nanos(wait), |board| unread(board) > 0) {
            Ok(_) | Err(Error::TimedOut { .. }) => {}
            Err(failure) => return Err(error(failure)),
        }
        board.run_for(latency).map_err(error)?;
        Ok(match pipe {
            Pipe::Port => board.usb().read(),
            Pipe::Control => board.usb().vendor().read(),
        })
    }

    fn clear_halt(&mut self, direction: Direction) -> Result<(), UsbError> {
        let usb_direction = match direction {
            Direction::In => UsbDirection::In,
            Direction::Out => UsbDirection::Out,
        };
        if self.keeps_toggles {
            let device = self.board().usb().device().unwrap().configuration.clone();
            let [port] = Port::find(&device)[..] else {
                panic!("not one serial port: {device:?}")
            };
            let address = match direction {
                Direction::In => 0x80 | port.input.number,
                Direction::Out => port.output.number,
            };
            return self.request(0x02, 1, 0, address.into());
        }
        self.board().usb().clear_halt(usb_direction).map_err(error)
    }

    fn set_interface(&mut self) -> Result<(), UsbError> {
        if self.keeps_toggles {
            return self.request(0x01, 11, 0, 1);
        }
        self.board().usb().set_interface().map_err(error)
    }

    fn set_configuration(&mut self) -> Result<(), UsbError> {
        if self.keeps_toggles {
            return self.request(0x00, 9, 1, 0);
        }
        self.board().usb().set_configuration(1).map_err(error)
    }

    fn reset(&mut self) -> Result<(), UsbError> {
        let board = self.board();
        board.usb().reset_bus();
        board.run_for(RESET).map_err(error)?;
        self.open()
    }

    fn reopen(&mut self) -> Result<(), UsbError> {
        let gone = self.board().run_until(START, |board| !board.usb().connected());
        gone.map_err(error)?;
        self.open()?;
        if self.forgets {
            Control::open(self.board).order(self.board, ResetConfig);
        }
        Ok(())
    }

    fn suspend(&mut self, span: Duration) -> Result<(), UsbError> {
        match self.suspend {
            Suspend::Yes => {}
            Suspend::Pretended => return self.sleep(span),
            Suspend::Unsupported => return Err(UsbError::Unsupported("no suspend here".to_owned())),
        }
        let board = self.board();
        board.usb().suspend();
        board.run_for(nanos(span)).map_err(error)?;
        board.usb().resume();
        board.run_for(RESET + RESET).map_err(error)
    }
}

fn nanos(span: Duration) -> Nanos {
    Nanos(span.as_nanos() as u64)
}

fn to_host(request: &UsbRequest<'_>) -> Request {
    let UsbRequest {
        kind,
        request,
        value,
        index,
        payload,
    } = *request;
    match payload {
        Payload::Read(length) => Request::read(kind, request, value, index, length),
        Payload::Write(data) => Request::write(kind, request, value, index, data.to_vec()),
    }
}

fn error(error: Error) -> UsbError {
    match error {
        Error::Transfer(TransferError::Stalled) => UsbError::Stalled,
        Error::Transfer(TransferError::TimedOut) => UsbError::TimedOut,
        Error::Transfer(_) | Error::NotOpen | Error::NoDevice { .. } => UsbError::Gone,
        error => UsbError::Host(error.to_string()),
    }
}
