//! The USB controller as a host sees it (4.1.2): endpoints, their buffers, and the registers that change its answers.
//! The emulator has its memory, and its interrupts.
//!
//! | Behaviour | Section |
//! |---|---|
//! | Pull-up, address | 4.1.3 SIE_CTRL, ADDR_ENDP |
//! | Buffers: AVAILABLE, the data toggle, STALL | 4.1.2.5, 4.1.2.6 |
//! | SETUP is accepted always, and ends a stall of endpoint 0 | 4.1.2.6 |
//! | EP_ABORT: NAK from the end of the transaction | 4.1.2.9 |
//! | A packet that becomes available in the last part of a frame, and is fetched there, ends all communication | RP2040-E15 |
//! | Before revision B2: after a reset of the bus nothing is answered until the controller has seen an idle bus for 800 µs. It never does by itself, as behind a busy hub | RP2040-E5 |
//!
//! Not modelled: double buffers, isochronous endpoints, remote wake-up, the bus voltage, which the image
//! overrides.

use super::messages::{Commands, UsbRegister};
use crate::revision::Rp2040Revision;
use crate::shared::{Shared, lock};
use crate::time::Nanos;
use crate::usb::host::Host;
use crate::usb::{Direction, Function, Handshake, Reply};

const ENDPOINTS: usize = 16;

/// PULLUP_EN of SIE_CTRL, ADDRESS of ADDR_ENDP (4.1.4).
const PULLUP_EN: u32 = 1 << 16;
const ADDRESS: u32 = 0x7F;

/// From here to the end of a frame a packet must not become available (RP2040-E15). Other drivers check a limit of 800 µs
/// before they write the packet: this leaves the time of the write, and of an interrupt at the start of the frame that waits.
const FRAME_END: Nanos = Nanos(825_000);

/// Time that the controller needs to connect (RP2040-E5).
const CONNECT: Nanos = Nanos(800_000);

/// ENABLE of an endpoint's control, and bits of its buffer's control (4.1.2.5.1).
const ENABLE: u32 = 1 << 31;
const AVAILABLE: u32 = 1 << 10;
const STALL: u32 = 1 << 11;
const DATA1: u32 = 1 << 13;

/// One direction of an endpoint.
#[derive(Clone, Debug, Default)]
struct Endpoint {
    enabled: bool,
    /// The control of its buffer.
    control: u32,
    /// The packet for the host.
    packet: Vec<u8>,
    /// Time at which the packet became ready.
    armed: Nanos,
}

#[derive(Debug, Default)]
struct Device {
    pulls_up: bool,
    address: u32,
    stall_arm: u32,
    abort: u32,
    /// By twice the number, and one for OUT.
    endpoints: [Endpoint; 2 * ENDPOINTS],
    /// The endpoint whose packet is on the wire, until the end of that packet.
    sending: Option<u8>,
    /// The time of the last event.
    now: Nanos,
    /// The start of the frame.
    frame: Nanos,
    /// It answers nothing until the next reset of the chip.
    hangs: bool,
    /// The chip has RP2040-E5.
    connects_late: bool,
    connection: Connection,
    commands: Commands,
}

/// The controller's connection to the bus.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Connection {
    #[default]
    Connected,
    /// The bus is in reset.
    Reset,
    /// It waits for an idle bus.
    Waiting,
    /// It is at pins instead of the bus, which show an idle bus since then.
    Idle(Nanos),
    /// It is at pins that show something else.
    AtPins,
}

/// What a token would get.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Silent,
    Stalled,
    Busy,
    Ready,
}

/// The index of an endpoint, and its bit in EP_ABORT.
fn index(endpoint: u8, direction: Direction) -> usize {
    2 * usize::from(endpoint) + usize::from(direction == Direction::Out)
}

impl Device {
    fn endpoint(&mut self, endpoint: u8, direction: Direction) -> Option<&mut Endpoint> {
        self.endpoints.get_mut(index(endpoint, direction))
    }

    fn state(&self, endpoint: u8, direction: Direction) -> State {
        let index = index(endpoint, direction);
        let Some(Endpoint { enabled, control, .. }) = self.endpoints.get(index) else {
            return State::Silent;
        };
        if endpoint != 0 && !enabled {
            State::Silent
        } else if self.abort >> index & 1 != 0 {
            State::Busy
        } else if control & STALL != 0 && (endpoint != 0 || self.stall_arm >> index & 1 != 0) {
            State::Stalled
        } else if control & AVAILABLE != 0 {
            State::Ready
        } else {
            State::Busy
        }
    }

    fn is_addressed(&self, address: u8) -> bool {
        self.hears() && self.address == address.into()
    }

    /// Returns true if packets on the bus reach the controller.
    fn hears(&self) -> bool {
        self.pulls_up && self.connection == Connection::Connected && !self.hangs
    }

    /// The image moved the controller to the bus, or to pins.
    fn mux(&mut self, value: u32) {
        self.connection = match (value, self.connection) {
            (UsbRegister::IDLE, Connection::Waiting) => Connection::Idle(self.now),
            (0, Connection::Idle(since)) if self.now.since(since) >= CONNECT => Connection::Connected,
            (0, Connection::Idle(_) | Connection::AtPins) => Connection::Waiting,
            (0, connection) => connection,
            _ => Connection::AtPins,
        };
    }
}

impl Function for Device {
    fn pulls_up(&self) -> bool {
        self.pulls_up
    }

    fn power(&mut self, _: bool) {}

    fn reset(&mut self) {
        self.sending = None;
        self.connection = Connection::Reset;
        self.commands.bus_reset();
    }

    fn reset_done(&mut self) {
        self.connection = match self.connects_late {
            true => Connection::Waiting,
            false => Connection::Connected,
        };
        self.commands.bus_reset_done();
    }

    fn start_of_frame(&mut self, number: u16) {
        self.frame = self.now;
        if self.hears() {
            self.commands.start_of_frame(number);
        }
    }

    fn suspend(&mut self) {
        self.commands.suspend();
    }

    fn resume(&mut self) {
        self.commands.resume();
    }

    fn ready(&self, endpoint: u8, direction: Direction) -> bool {
        self.state(endpoint, direction) != State::Busy
    }

    fn setup(&mut self, address: u8, request: [u8; 8]) -> bool {
        let is_addressed = self.is_addressed(address);
        if is_addressed {
            self.stall_arm = 0;
            self.commands.setup(request);
        }
        is_addressed
    }

    fn output(&mut self, address: u8, endpoint: u8, toggle: bool, data: &[u8]) -> Handshake {
        if !self.is_addressed(address) {
            return Handshake::NoResponse;
        }
        match self.state(endpoint, Direction::Out) {
            State::Silent => return Handshake::NoResponse,
            State::Stalled => return Handshake::Stall,
            State::Busy => return Handshake::Nak,
            State::Ready => {}
        }
        if let Some(buffer) = self.endpoint(endpoint, Direction::Out)
            // Otherwise it is a packet received before.
            && (buffer.control & DATA1 != 0) == toggle
        {
            buffer.control &= !AVAILABLE;
            self.commands.output(endpoint, data);
        }
        Handshake::Ack
    }

    fn input(&mut self, address: u8, endpoint: u8) -> Reply {
        if !self.is_addressed(address) {
            return Reply::NoResponse;
        }
        match self.state(endpoint, Direction::In) {
            State::Silent => return Reply::NoResponse,
            State::Stalled => return Reply::Stall,
            State::Busy => return Reply::Nak,
            State::Ready => self.sending = Some(endpoint),
        }
        let end = self.frame + FRAME_END;
        if let Some(buffer) = self.endpoint(endpoint, Direction::In)
            && endpoint != 0
            && buffer.armed >= end
        {
            self.hangs = true;
            return Reply::NoResponse;
        }
        match self.endpoint(endpoint, Direction::In) {
            Some(buffer) => Reply::Data {
                toggle: buffer.control & DATA1 != 0,
                bytes: buffer.packet.clone(),
                armed: buffer.armed,
            },
            None => Reply::NoResponse,
        }
    }

    fn acknowledged(&mut self, endpoint: u8) {
        if self.sending.take() != Some(endpoint) {
            return;
        }
        if let Some(buffer) = self.endpoint(endpoint, Direction::In) {
            buffer.control &= !AVAILABLE;
            self.commands.fetched(endpoint);
        }
        self.commands.aborted(self.abort);
    }
}

/// The controller, with a host at the other end of the cable.
#[derive(Debug)]
pub(super) struct Usb {
    device: Device,
    host: Shared<Host>,
    /// The time of the host's next event.
    wake: Option<Nanos>,
}

impl Usb {
    pub(super) fn new(host: Shared<Host>, revision: Rp2040Revision) -> Self {
        Self {
            device: Device {
                connects_late: revision == Rp2040Revision::B1,
                ..Device::default()
            },
            host,
            wake: None,
        }
    }

    /// Resets the controller: the device disconnects.
    pub(super) fn reset(&mut self) {
        self.device = Device {
            connects_late: self.device.connects_late,
            ..Device::default()
        };
    }

    /// The image wrote a register.
    pub(super) fn write(&mut self, register: UsbRegister, value: u32, now: Nanos) {
        let device = &mut self.device;
        device.now = now;
        match register {
            UsbRegister::Address => device.address = value & ADDRESS,
            UsbRegister::SieControl => device.pulls_up = value & PULLUP_EN != 0,
            UsbRegister::StallArm => device.stall_arm = value,
            UsbRegister::Muxing => device.mux(value),
            UsbRegister::Abort => {
                device.abort = value;
                let sending = device.sending.map_or(0, |endpoint| 1 << index(endpoint, Direction::In));
                device.commands.aborted(value & !sending);
            }
        }
    }

    /// The image wrote the control of an endpoint.
    pub(super) fn write_endpoint(&mut self, index: u8, control: u32) {
        if let Some(endpoint) = self.device.endpoints.get_mut(usize::from(index)) {
            endpoint.enabled = control & ENABLE != 0;
        }
    }

    /// The image wrote the control of a buffer.
    pub(super) fn write_buffer(&mut self, index: u8, control: u32, packet: Vec<u8>, now: Nanos) {
        if let Some(endpoint) = self.device.endpoints.get_mut(usize::from(index)) {
            endpoint.control = control;
            endpoint.packet = packet;
            endpoint.armed = now;
        }
    }

    /// Executes due events, and senses changes.
    pub(super) fn poll(&mut self, now: Nanos, commands: &mut Commands) {
        self.device.now = now;
        self.wake = lock(&self.host).poll(now, &mut self.device);
        commands.append(&mut self.device.commands);
    }

    /// The time of the next event.
    pub(super) fn due(&self) -> Option<Nanos> {
        self.wake
    }

    /// Returns true if an event occurred that a program may wait for.
    pub(super) fn take_progress(&self) -> bool {
        lock(&self.host).take_progress()
    }
}
