//! An adapter in virtual time: a line, an arm on it, hosts on USB and on CAN.

extern crate std;

use std::boxed::Box;
use std::collections::VecDeque;
use std::vec;
use std::vec::Vec;

use armwire::decoder::{Decoder, Kind};
use armwire::framing::{Framing, LONGEST_VOID};
use armwire::ling::{self, Ling};
use armwire::messages::Messages;

use crate::can::command::Command;
use crate::can::{Frame, Function, Node};
use crate::config::{ArmKind, Config};
use crate::control::{
    Event, FromAdapter, FromHost, Identity, Initiator, MAX_COBS, MAX_FRAME, MAX_MESSAGE, Reader, Reply, Request, Stamp,
    Subscription, decode, encode, encode_cobs,
};
use crate::isotp::{self, Endpoint, Link};
use crate::{
    Action, Bridge, CanEvent, Counters, Instant, PACKET, Start, Status, Transmit, UartConfig, UartEvent, UsbEvent,
};

/// The arm's answer to a request, and its delay in µs.
pub(super) type Responder = Box<dyn FnMut(&[u8]) -> Option<(u64, Vec<u8>)>>;

/// Duration of a frame on the CAN bus, in µs.
const CAN_FRAME: u64 = 130;

pub(super) struct Rig {
    pub(super) bridge: Bridge,
    pub(super) now: u64,
    /// The UART's configuration.
    pub(super) uart: UartConfig,
    /// The bursts to the arm, and their start times.
    pub(super) sent: Vec<(u64, Vec<u8>)>,
    /// The initiator of each burst.
    pub(super) initiators: Vec<Initiator>,
    /// The baud rate of each burst.
    pub(super) bauds: Vec<u32>,
    /// The time at which the UART accepts more bytes.
    tx_free: u64,
    /// The arm's receiver, its start, and the bytes of its answers with their arrival times.
    arm_decoder: Decoder<ArmKind, 70>,
    pub(super) responder: Responder,
    arm_output: VecDeque<(u64, u8)>,
    idle: Option<u64>,
    /// Bytes received by the host on USB.
    pub(super) usb: Vec<u8>,
    /// Bytes that the host on USB still has to send.
    pub(super) usb_out: VecDeque<u8>,
    control_in: Reader<MAX_MESSAGE>,
    pub(super) replies: Vec<(u8, Reply)>,
    pub(super) events: Vec<(Stamp, Event)>,
    sequence: u8,
    /// The host on CAN: its target node, its two connections, the messages received on them, and all other frames.
    node: Node,
    arm: Endpoint<100, 100>,
    control: Endpoint<300, 100>,
    pub(super) can_out: VecDeque<Vec<u8>>,
    pub(super) can: Vec<Vec<u8>>,
    pub(super) can_control: Vec<FromAdapter>,
    pub(super) frames: Vec<(u64, Frame)>,
    bus_free: u64,
    pub(super) actions: Vec<Action>,
}

impl Rig {
    pub(super) fn new(config: Config) -> Self {
        let link = match config.can.data_bit_rate {
            Some(_) => Link::Fd,
            None => Link::Classic,
        };
        let end = |function: Function| isotp::Config::new(link, function.id(config.can.node));
        let identity = Identity {
            can_fd: link == Link::Fd,
            ..Identity::default()
        };
        let mut bridge = Bridge::new(identity, config, Start::default());
        bridge.usb_event(UsbEvent::Configured(true), Instant::ZERO);
        Self {
            bridge,
            now: 0,
            uart: UartConfig::default(),
            sent: vec![],
            initiators: vec![],
            bauds: vec![],
            tx_free: 0,
            arm_decoder: Decoder::new(),
            responder: Box::new(ling_responder()),
            arm_output: VecDeque::new(),
            idle: None,
            usb: vec![],
            usb_out: VecDeque::new(),
            control_in: Reader::new(),
            replies: vec![],
            events: vec![],
            sequence: 0,
            node: config.can.node,
            arm: Endpoint::new(end(Function::ArmRequest)),
            control: Endpoint::new(end(Function::ControlRequest)),
            can_out: VecDeque::new(),
            can: vec![],
            can_control: vec![],
            frames: vec![],
            bus_free: 0,
            actions: vec![],
        }
    }

    fn byte_time(&self) -> u64 {
        self.uart.coding.micros(1)
    }

    pub(super) fn run(&mut self, micros: u64) {
        let end = self.now + micros;
        self.pump();
        loop {
            let arm_output = self.arm_output.front().map(|&(at, _)| at);
            let timeout = self.bridge.timeout().map(|at| at.as_micros());
            let hosts = [self.arm.timeout(), self.control.timeout()]
                .into_iter()
                .flatten()
                .map(|at| at.as_micros())
                .min();
            let tx = (self.tx_free > self.now).then_some(self.tx_free);
            let bus = (self.bus_free > self.now).then_some(self.bus_free);
            let next = [arm_output, timeout, self.idle, tx, bus, hosts]
                .into_iter()
                .flatten()
                .min();
            match next {
                Some(at) if at <= end => {
                    self.now = self.now.max(at);
                    self.step();
                }
                _ => break,
            }
        }
        self.now = end;
        self.pump();
    }

    /// Passes bytes of the arm to the bridge. Without a frame no more work may become due, apart from packets to the
    /// host.
    fn receive(&mut self, now: Instant, receive: impl FnOnce(&mut Bridge) -> usize) {
        let due = |bridge: &mut Bridge| {
            let status = Status {
                usb: false,
                passed_bytes: 0,
                ..bridge.update(now)
            };
            (status, bridge.timeout())
        };
        let (status, timeout) = due(&mut self.bridge);
        if receive(&mut self.bridge) == 0 {
            let (status_then, timeout_then) = due(&mut self.bridge);
            assert_eq!(status_then, status);
            assert!(timeout_then >= timeout, "{timeout_then:?} {timeout:?}");
        }
    }

    fn step(&mut self) {
        let now = at(self.now);
        while let Some((at, byte)) = self.arm_output.pop_front_if(|(at, _)| *at <= now.as_micros()) {
            self.receive(Instant::from_micros(at), |bridge| {
                bridge.uart_received(&[byte], Instant::from_micros(at))
            });
            let next = self.arm_output.front().map(|&(at, _)| at);
            // Times are rounded down to microseconds.
            let idle = at + self.byte_time() + 1;
            self.idle = next.is_none_or(|next| next > idle).then_some(idle);
        }
        if self.idle.take_if(|at| *at <= now.as_micros()).is_some() {
            self.receive(now, |bridge| bridge.uart_event(UartEvent::Idle, now));
        }
        let _ = self.arm.tick(now);
        let _ = self.control.tick(now);
        self.pump();
    }

    /// Executes all work that is due.
    fn pump(&mut self) {
        let now = at(self.now);
        loop {
            let mut idle = true;
            if self.bridge.timeout().is_some_and(|at| at <= now) {
                self.bridge.tick(now);
                assert!(
                    self.bridge.timeout().is_none_or(|at| at > now),
                    "a tick leaves nothing that is late"
                );
            }
            while self.bridge.update(now).usb_room && !self.usb_out.is_empty() {
                let n = self.usb_out.len().min(PACKET);
                let packet: Vec<u8> = self.usb_out.drain(..n).collect();
                self.bridge.usb_received(&packet, now);
            }
            let mut packet = [0; PACKET];
            while self.bridge.update(now).usb {
                let n = self.bridge.usb_transmit(&mut packet).expect("one is due");
                self.usb.extend(&packet[..n]);
            }
            assert_eq!(self.bridge.usb_transmit(&mut packet), None);
            while self.bridge.update(now).control {
                if let Some(n) = self.bridge.control_transmit(&mut packet, now) {
                    self.receive_control(&packet[..n]);
                }
            }
            assert_eq!(self.bridge.control_transmit(&mut packet, now), None);
            if self.bridge.update(now).uart_cut {
                // The byte on the line goes out, and possibly the next.
                self.tx_free = self.tx_free.min(now.as_micros() + self.uart.coding.micros(2));
            }
            if self.tx_free <= now.as_micros() {
                let mut out = [0; MAX_FRAME];
                let due = self.bridge.update(now).uart;
                let before = self.bridge.counters();
                let transmit = self.bridge.uart_transmit(&mut out, now, |_, _| {});
                assert_eq!(transmit.is_some(), due);
                match transmit {
                    None => {}
                    Some(Transmit::Configure(uart)) => {
                        self.bridge.uart_event(UartEvent::Configured(uart), now);
                        self.uart = uart;
                        idle = false;
                    }
                    Some(Transmit::Burst { len, start }) => {
                        let start = start.map_or(now.as_micros(), Instant::as_micros);
                        assert!(start >= now.as_micros());
                        self.tx_free = start + self.uart.coding.micros(len);
                        self.initiators.push(initiator(&before, &self.bridge.counters()));
                        self.bauds.push(self.uart.coding.baud);
                        self.sent.push((start, out[..len].to_vec()));
                        self.send_to_arm(&out[..len], start);
                        idle = false;
                    }
                }
            }
            if self.bus_free <= now.as_micros() {
                idle &= !self.use_bus(now);
            }
            while let Some(action) = self.bridge.action(now) {
                self.actions.push(action);
                idle = false;
            }
            if idle {
                return;
            }
        }
    }

    fn receive_control(&mut self, mut packet: &[u8]) {
        while !packet.is_empty() {
            packet = self.control_in.push(packet);
            match self.control_in.next::<FromAdapter>() {
                Some(Ok(FromAdapter::Reply { sequence, reply })) => self.replies.push((sequence, reply)),
                Some(Ok(FromAdapter::Event { at, event })) => {
                    if let Event::Refused { initiator, reason } = event {
                        assert!(reason.initiators().contains(&initiator), "{initiator:?} {reason:?}");
                    }
                    self.events.push((at, event));
                }
                Some(Err(error)) => panic!("{error}"),
                None => {}
            }
        }
    }

    /// The arm receives bytes that are on the line from `start` on, and answers one request after the other.
    fn send_to_arm(&mut self, bytes: &[u8], start: u64) {
        let coding = self.uart.coding;
        for (n, byte) in bytes.iter().enumerate() {
            assert!(self.arm_decoder.push(&[*byte]).is_empty());
            let end = start + coding.micros(n + 1);
            let arm = self.bridge.config().arm;
            while let Some(item) = self.arm_decoder.next(&arm, arm.requests()) {
                let Kind::Frame = item.kind else { continue };
                if let Some((after, answer)) = (self.responder)(item.bytes) {
                    let start = self.arm_output.back().map_or(0, |&(at, _)| at).max(end) + after;
                    let bytes = answer.iter().enumerate();
                    self.arm_output
                        .extend(bytes.map(|(n, &byte)| (start + coding.micros(n + 1), byte)));
                }
            }
        }
    }

    /// The arm sends an unsolicited frame.
    pub(super) fn arm_sends(&mut self, bytes: &[u8]) {
        let start = self.arm_output.back().map_or(0, |&(at, _)| at).max(self.now);
        let coding = self.uart.coding;
        self.arm_output.extend(
            bytes
                .iter()
                .enumerate()
                .map(|(n, &byte)| (start + coding.micros(n + 1), byte)),
        );
    }

    /// Moves one frame over the bus, if there is one.
    fn use_bus(&mut self, now: Instant) -> bool {
        while self.bridge.update(now).can {
            let Some(frame) = self.bridge.can_transmit(now) else {
                continue;
            };
            self.bus_free = now.as_micros() + CAN_FRAME;
            self.receive_from_bus(&frame, now);
            self.bridge.can_event(CanEvent::Waiting(0), now);
            return true;
        }
        assert_eq!(self.bridge.can_transmit(now), None);
        if !self.arm.is_sending()
            && let Some(pdu) = self.can_out.pop_front()
        {
            self.arm.send(&pdu).unwrap();
        }
        let frame = self.arm.transmit(now).inspect(|_| self.arm.transmitted(now));
        let frame = frame.or_else(|| self.control.transmit(now).inspect(|_| self.control.transmitted(now)));
        let Some(frame) = frame else { return false };
        self.bus_free = now.as_micros() + CAN_FRAME;
        self.bridge.can_received(&frame, now);
        true
    }

    fn receive_from_bus(&mut self, frame: &Frame, now: Instant) {
        let (function, node) = Function::of(frame.id()).unwrap();
        match function {
            Function::ArmAnswer if node == self.node => {
                let _ = self.arm.receive(frame.data(), now);
                if let Some(pdu) = self.arm.received() {
                    self.can.push(pdu.to_vec());
                    self.arm.release();
                }
            }
            Function::ControlAnswer if node == self.node => {
                let _ = self.control.receive(frame.data(), now);
                if let Some(pdu) = self.control.received() {
                    self.can_control.push(decode(pdu).unwrap());
                    self.control.release();
                }
            }
            _ => self.frames.push((self.now, *frame)),
        }
    }

    /// Passes a frame from the bus to the adapter.
    pub(super) fn can_frame(&mut self, frame: &Frame) {
        self.bridge.can_received(frame, at(self.now));
        self.pump();
    }

    /// Sends a request on the control interface of USB, and returns its sequence number.
    pub(super) fn request(&mut self, request: Request) -> u8 {
        self.sequence += 1;
        let sequence = self.sequence;
        assert!(self.bridge.update(at(self.now)).control_room);
        send_request(&mut self.bridge, sequence, request, at(self.now));
        self.pump();
        sequence
    }

    /// The reply to a request that is answered at once.
    pub(super) fn call(&mut self, request: Request) -> Reply {
        let sequence = self.request(request);
        let (replied, reply) = self.replies.pop().unwrap();
        assert_eq!(replied, sequence);
        reply
    }

    /// Sends a request on the control connection of CAN.
    pub(super) fn request_on_can(&mut self, sequence: u8, request: Request) {
        let mut bytes = [0; 100];
        let len = encode(&FromHost { sequence, request }, &mut bytes).unwrap();
        self.control.send(&bytes[..len]).unwrap();
        self.pump();
    }

    pub(super) fn subscribe(&mut self) {
        let everything = Subscription {
            frames: true,
            events: true,
        };
        assert_eq!(self.call(Request::Subscribe(everything)), Reply::Done);
    }

    /// All bytes that went to the arm.
    pub(super) fn line(&self) -> Vec<u8> {
        self.sent.iter().flat_map(|(_, bytes)| bytes.clone()).collect()
    }
}

/// The instant this many microseconds after the start.
pub(super) const fn at(micros: u64) -> Instant {
    Instant::from_micros(micros)
}

/// Bytes that went to the arm.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Burst {
    pub(super) len: usize,
    pub(super) start: Option<Instant>,
}

/// A host on CAN streams motion until a self-check of 500 ms fills the queue.
pub(super) fn streaming_on_can_into_a_self_check(config: Config) -> Rig {
    let mut rig = Rig::new(config);
    rig.subscribe();
    for _ in 0..3 {
        rig.can_out.push_back(motion());
        rig.run(10_000);
    }
    rig.responder = Box::new(|_| None);
    rig.usb_out.extend(ling::SELF_CHECK);
    rig.run(1_000);
    rig
}

/// Takes the next bytes for the arm.
pub(super) fn transmit(bridge: &mut Bridge, out: &mut [u8; MAX_FRAME], now: Instant) -> Option<Burst> {
    match bridge.uart_transmit(out, now, |_, _| {})? {
        Transmit::Configure(_) => None,
        Transmit::Burst { len, start } => Some(Burst { len, start }),
    }
}

/// The initiator of the bytes sent between these counts.
fn initiator(before: &Counters, after: &Counters) -> Initiator {
    let requests = |c: &Counters| {
        [
            (Initiator::Can, c.requests_can),
            (Initiator::Poll, c.requests_poll),
            (Initiator::Command, c.requests_command),
            (Initiator::Adapter, c.requests_adapter),
        ]
    };
    let others = requests(before).into_iter().zip(requests(after));
    let mut changed = others.filter(|(before, after)| before != after);
    changed.next().map_or(Initiator::Usb, |((initiator, _), _)| initiator)
}

/// Sends a request of the host on USB on the control interface.
pub(super) fn send_request(bridge: &mut Bridge, sequence: u8, request: Request, now: Instant) {
    let mut bytes = [0; MAX_COBS];
    let len = encode_cobs(&FromHost { sequence, request }, &mut bytes).unwrap();
    bridge.control_received(&bytes[..len], now);
}

/// A request that moves a Ling arm.
pub(super) fn motion() -> Vec<u8> {
    let command = Command {
        sequence: 1,
        joints: [2048; 6],
        speed: 10,
        gripper: 0,
    };
    let mut out = [0; MAX_FRAME];
    let request = ling::Request::Move(command.target().unwrap());
    let len = Ling.encode_request(&request, &mut out).unwrap();
    out[..len].to_vec()
}

/// A Ling arm that answers known requests after 200 µs. The first data byte of its answers counts them.
pub(super) fn ling_responder() -> impl FnMut(&[u8]) -> Option<(u64, Vec<u8>)> {
    let mut count = 0_u8;
    move |request: &[u8]| {
        let len = match request[1..3] {
            [0x01, 0] => 24,
            [0x06, 0] => 15,
            [0x06, 1] if request[4] == 0xFE => 6,
            [0x06, 2] => 12,
            [0xFE, 0] => 2,
            [0x77, _] => 3,
            _ => return None,
        };
        count = count.wrapping_add(1);
        let mut data = vec![0; len];
        data[0] = count;
        Some((200, ling(request[1], request[2], &data)))
    }
}

/// The bursts of a void of the adapter.
pub(super) fn void() -> Vec<Vec<u8>> {
    vec![0; LONGEST_VOID].chunks(MAX_FRAME).map(<[u8]>::to_vec).collect()
}

/// A Ling frame.
pub(super) fn ling(command: u8, function: u8, data: &[u8]) -> Vec<u8> {
    let mut out = [0; 70];
    let frame = armwire::ling::Frame {
        command,
        function,
        data,
    };
    let n = frame.encode(&mut out).unwrap();
    out[..n].to_vec()
}
