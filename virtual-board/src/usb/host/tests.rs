//! The host with a scripted device.

use super::*;
use crate::usb::cdc::{LineCoding, Port};
use crate::usb::descriptor::Configuration;
use crate::usb::enumerate::{self, Bus, EnumerateError, Enumerated};

const DEVICE: [u8; 18] = [18, 1, 0, 2, 2, 0, 0, 64, 0x09, 0x12, 1, 0, 0, 1, 1, 2, 3, 1];

/// A CDC-ACM serial port with endpoint 1 for data.
const CONFIGURATION: [u8; 55] = [
    9, 2, 55, 0, 2, 1, 0, 0x80, 50, //
    9, 4, 0, 0, 1, 2, 2, 0, 0, //
    5, 0x24, 6, 0, 1, //
    7, 5, 0x82, 3, 8, 0, 4, //
    9, 4, 1, 0, 2, 10, 0, 0, 0, //
    7, 5, 0x01, 2, 64, 0, 0, //
    7, 5, 0x81, 2, 64, 0, 0, // the last two bytes are nothing
    2, 0xFF,
];

/// A fault of the device.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Failure {
    #[default]
    None,
    /// It stalls every control transfer.
    Stalls,
    /// It never answers.
    Dead,
}

/// A device whose control pipe answers at once, and which echoes on endpoint 1.
#[derive(Debug, Default)]
struct Echo {
    failure: Failure,
    address: u8,
    next_address: u8,
    setup: Vec<[u8; 8]>,
    answer: Vec<u8>,
    control_out: Vec<u8>,
    control_toggle: bool,
    toggles: [bool; 2],
    echo: VecDeque<Vec<u8>>,
    /// It answers an IN token with the previous packet.
    repeats: bool,
    last: Vec<u8>,
    frames: Vec<u16>,
    suspended: u32,
}

impl Function for Echo {
    fn pulls_up(&self) -> bool {
        true
    }

    fn power(&mut self, _: bool) {}

    fn reset(&mut self) {
        self.address = 0;
        self.toggles = [false; 2];
    }

    fn reset_done(&mut self) {}

    fn start_of_frame(&mut self, number: u16) {
        self.frames.push(number);
    }

    fn suspend(&mut self) {
        self.suspended += 1;
    }

    fn resume(&mut self) {}

    fn ready(&self, endpoint: u8, direction: Direction) -> bool {
        endpoint == 0 || direction == Direction::Out || endpoint == 1 && (self.repeats || !self.echo.is_empty())
    }

    fn setup(&mut self, address: u8, request: [u8; 8]) -> bool {
        if self.failure == Failure::Dead || address != self.address {
            return false;
        }
        self.setup.push(request);
        self.control_toggle = true;
        let length = usize::from(u16::from_le_bytes([request[6], request[7]]));
        let whole: Vec<u8> = match (request[1], request[3]) {
            (6, 1) => DEVICE.to_vec(),
            (6, 2) => CONFIGURATION.to_vec(),
            (6, 3) => [&[2 + 2 * 4, 3][..], b"t\0e\0s\0t\0"].concat(),
            (5, _) => {
                self.next_address = request[2];
                Vec::new()
            }
            _ => Vec::new(),
        };
        self.answer = whole[..whole.len().min(length)].to_vec();
        true
    }

    fn output(&mut self, _: u8, endpoint: u8, toggle: bool, data: &[u8]) -> Handshake {
        if endpoint == 0 {
            self.control_out.extend(data);
            return Handshake::Ack;
        }
        if toggle == self.toggles[0] {
            self.toggles[0] = !toggle;
            self.echo.push_back(data.to_vec());
        }
        Handshake::Ack
    }

    fn input(&mut self, _: u8, endpoint: u8) -> Reply {
        if endpoint == 0 {
            if self.failure == Failure::Stalls {
                return Reply::Stall;
            }
            let bytes = self.answer[..self.answer.len().min(64)].to_vec();
            return Reply::Data {
                toggle: self.control_toggle,
                bytes,
                armed: Nanos(0),
            };
        }
        let (toggle, bytes) = if std::mem::take(&mut self.repeats) {
            (!self.toggles[1], self.last.clone())
        } else {
            match self.echo.front() {
                Some(bytes) => (self.toggles[1], bytes.clone()),
                None => return Reply::Nak,
            }
        };
        Reply::Data {
            toggle,
            bytes,
            armed: Nanos(1),
        }
    }

    fn acknowledged(&mut self, endpoint: u8) {
        if endpoint == 0 {
            self.answer.drain(..self.answer.len().min(64));
            self.control_toggle = !self.control_toggle;
            self.address = self.next_address;
        } else if let Some(bytes) = self.echo.pop_front() {
            self.last = bytes;
            self.toggles[1] = !self.toggles[1];
        }
    }
}

/// A host and a device, and the clock between them.
#[derive(Debug, Default)]
struct Wire {
    host: Host,
    device: Echo,
    now: Nanos,
}

impl Wire {
    fn running() -> Self {
        let mut wire = Self::default();
        wire.host.set_cable(true);
        wire.advance(Nanos(1));
        wire.reset();
        wire
    }

    fn advance(&mut self, span: Nanos) {
        let until = self.now + span;
        while let Some(next) = self.host.poll(self.now, &mut self.device).filter(|&next| next <= until) {
            self.now = next;
        }
        self.now = until;
    }
}

impl Bus for Wire {
    fn wait(&mut self, span: Nanos) {
        self.advance(span);
    }

    fn reset(&mut self) {
        self.host.reset();
        self.advance(RESET + Nanos(1));
    }

    fn control(&mut self, address: u8, packet: u8, request: Request) -> Result<Vec<u8>, TransferError> {
        self.host.start_control(address, packet, request);
        for _ in 0..100 {
            self.advance(Nanos::from_millis(1));
            if let Some(result) = self.host.take_control() {
                return result;
            }
        }
        Err(TransferError::TimedOut)
    }
}

fn enumerate(wire: &mut Wire) -> Result<Enumerated, EnumerateError> {
    enumerate::enumerate(wire, 9)
}

/// A wire with the device's serial port open.
fn open() -> (Wire, Port) {
    let mut wire = Wire::running();
    let device = enumerate(&mut wire).unwrap();
    let port = Port::find(&device.configuration)[0];
    for endpoint in [port.output, port.input] {
        wire.host.open(9, endpoint);
    }
    (wire, port)
}

#[test]
fn device_is_enumerated() {
    let device = enumerate(&mut Wire::running()).unwrap();
    assert_eq!((device.device.vendor, device.device.product), (0x1209, 1));
    assert_eq!(device.serial.as_deref(), Some("test"));
    assert_eq!(Configuration::parse(&CONFIGURATION), Ok(device.configuration));
}

#[test]
fn stalling_or_silent_device_is_an_error() {
    for (failure, error) in [
        (Failure::Stalls, TransferError::Stalled),
        (Failure::Dead, TransferError::NoResponse),
    ] {
        let mut wire = Wire::running();
        wire.device.failure = failure;
        let Err(EnumerateError::Transfer { error: found, .. }) = enumerate(&mut wire) else {
            panic!("{failure:?}");
        };
        assert_eq!(found, error);
    }
}

#[test]
fn control_write_carries_its_data() {
    let (mut wire, port) = open();
    let coding = port.set_line_coding(LineCoding::new(115_200));
    assert_eq!(wire.control(9, 64, coding), Ok(Vec::new()));
    assert_eq!(
        wire.device.control_out.last_chunk(),
        Some(&[0x00, 0xC2, 0x01, 0, 0, 0, 8])
    );
}

#[test]
fn frames_are_a_millisecond_apart_and_numbered() {
    let mut wire = Wire::running();
    wire.device.frames.clear();
    wire.advance(Nanos::from_millis(5));
    let first = wire.device.frames[0];
    assert_eq!(wire.device.frames, [0, 1, 2, 3, 4].map(|n| first + n));
}

#[test]
fn bytes_are_split_into_packets_in_order() {
    let (mut wire, port) = open();
    let sent: Vec<u8> = (0..200).collect();
    assert!(wire.host.write(port.output.number, &sent));
    assert_eq!(wire.host.unsent(port.output.number), 200);
    wire.advance(Nanos::from_millis(3));
    assert_eq!(wire.host.unsent(port.output.number), 0);
    assert_eq!(wire.host.read(port.input.number), sent);
    let sizes: Vec<usize> = wire
        .host
        .packets()
        .iter()
        .filter(|packet| packet.direction == Direction::Out)
        .map(|packet| packet.data.len())
        .collect();
    assert_eq!(sizes, [64, 64, 64, 8]);
}

#[test]
fn transactions_take_time_and_stay_within_frame() {
    let (mut wire, port) = open();
    wire.host.write(port.output.number, &[0; 64 * 40]);
    wire.advance(Nanos::from_millis(10));
    let packets = wire.host.packets();
    let whole = TOKEN + TURNAROUND + timing::data(64) + TURNAROUND + HANDSHAKE;
    for packet in packets {
        assert!(packet.end.since(packet.start).0.abs_diff(whole.0) <= 2, "{packet:?}");
        assert_eq!(
            packet.start.0 / timing::FRAME.0,
            packet.end.0 / timing::FRAME.0,
            "{packet:?}"
        );
    }
    assert!(
        packets.windows(2).all(|pair| pair[0].end < pair[1].start),
        "one at a time"
    );
    assert!(packets.len() >= 80);
}

#[test]
fn idle_host_gets_nothing_and_loses_nothing() {
    let (mut wire, port) = open();
    wire.host.set_reading(port.input.number, false);
    wire.host.write(port.output.number, b"wait");
    wire.advance(Nanos::from_millis(5));
    assert_eq!(wire.host.unread(port.input.number), 0);
    wire.host.set_reading(port.input.number, true);
    wire.advance(Nanos::from_millis(1));
    assert_eq!(wire.host.read(port.input.number), b"wait");
}

#[test]
fn injected_naks_delay_and_lose_nothing() {
    let (mut wire, port) = open();
    wire.host.inject_naks(port.output.number, Direction::Out, 5);
    let start = wire.now;
    wire.host.write(port.output.number, b"late");
    wire.advance(Nanos::from_millis(2));
    assert_eq!(wire.host.read(port.input.number), b"late");
    let delay = wire.host.packets()[0].start.since(start);
    assert!(delay >= Nanos(5 * wire.host.poll_interval.0), "{delay}");
}

#[test]
fn repeated_packet_counts_once() {
    let (mut wire, port) = open();
    wire.host.write(port.output.number, b"once");
    wire.advance(Nanos::from_millis(1));
    wire.device.repeats = true;
    wire.advance(Nanos::from_millis(1));
    assert_eq!(wire.host.read(port.input.number), b"once");
}

#[test]
fn unplugging_ends_all_transfers_and_closes_endpoints() {
    let (mut wire, port) = open();
    wire.host.start_control(9, 64, port.get_line_coding());
    wire.host.set_cable(false);
    wire.advance(Nanos(1));
    assert_eq!(wire.host.take_control(), Some(Err(TransferError::Disconnected)));
    assert!(!wire.host.connected());
    assert!(!wire.host.is_open(port.output.number, Direction::Out));
    assert!(!wire.host.write(port.output.number, b"x"));
}

#[test]
fn quiet_bus_suspends_the_device_once() {
    let mut wire = Wire::running();
    let before = wire.device.suspended;
    wire.host.suspend();
    wire.advance(Nanos::from_millis(50));
    assert_eq!(wire.device.suspended, before + 1);
    wire.host.resume();
    wire.device.frames.clear();
    wire.advance(RESUME + Nanos::from_millis(2));
    assert!(!wire.device.frames.is_empty());
}

#[test]
fn ready_endpoint_is_polled_on_the_grid() {
    let (mut wire, port) = open();
    wire.advance(Nanos(300_000));
    wire.device.echo.push_back(vec![1]);
    wire.advance(Nanos(100_000));
    let packet = wire.host.packets().last().unwrap();
    assert_eq!((packet.endpoint, &packet.data[..]), (port.input.number, &[1][..]));
    let frame_start = Nanos((packet.start.0 - 2) / timing::FRAME.0 * timing::FRAME.0 + 2);
    let quiet = packet.start.since(frame_start + TOKEN + TURNAROUND);
    assert_eq!(
        quiet.0 % wire.host.poll_interval.0,
        0,
        "since the start of the frame at {frame_start}"
    );
}

#[test]
fn no_token_is_sent_before_bytes_exist() {
    let (mut wire, port) = open();
    for nth in 0..50 {
        wire.advance(Nanos(700_000 + nth * 311));
        let written = wire.now;
        assert!(wire.host.write(port.output.number, &[1]));
        wire.advance(Nanos::from_millis(1));
        let packets = wire.host.packets();
        let packet = packets
            .iter()
            .rfind(|packet| packet.direction == Direction::Out)
            .unwrap();
        assert!(packet.start >= written, "{} before {written}", packet.start);
    }
}

#[test]
fn abandoned_control_transfer_frees_the_wire() {
    let read = || Request::read(0x80, 6, 0x0100, 0, 18);
    for micros in 0..100 {
        let (mut wire, port) = open();
        wire.host
            .start_control(9, 64, port.set_line_coding(LineCoding::new(115_200)));
        wire.advance(Nanos(1_000 * micros));
        wire.host.abandon_control();
        assert_eq!(wire.control(9, 64, read()), Ok(DEVICE.to_vec()), "after {micros} us");

        wire.host.start_control(9, 64, read());
        wire.advance(Nanos(1_000 * micros));
        let setups = wire.device.setup.len();
        assert_eq!(wire.control(9, 64, read()), Ok(DEVICE.to_vec()), "after {micros} us");
        assert!(wire.device.setup.len() > setups, "after {micros} us: its own setup");
    }
}

#[test]
fn paused_endpoint_gets_no_token_restarts_at_data0() {
    let (mut wire, port) = open();
    wire.host.write(port.output.number, b"one");
    wire.advance(Nanos::from_millis(2));
    assert_eq!(wire.host.toggle(port.output.number, Direction::Out), Some(true));

    wire.host.pause(port.output.number, Direction::Out);
    wire.host.write(port.output.number, b"two");
    wire.advance(Nanos::from_millis(2));
    assert_eq!(wire.host.unsent(port.output.number), 3);

    wire.host.start_anew(port.output.number, Direction::Out);
    wire.device.toggles[0] = false;
    wire.advance(Nanos::from_millis(2));
    assert_eq!(wire.host.unsent(port.output.number), 0);
    assert_eq!(wire.host.read(port.input.number), b"onetwo");
}
