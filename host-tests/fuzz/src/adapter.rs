//! An adapter, and what must hold of it whatever happens around it.

use armwire::alpha1::Alpha1;
use armwire::framing::Scan;
use armwire::ling::{self, Ling};
use armwire::messages::Messages;
use armwire::time::{Duration, Instant};
use armwire_bridge::can::command::Command;
use armwire_bridge::can::telemetry::{Errors, Sample, event_from_frame};
use armwire_bridge::can::{Frame, Function, Id};
use armwire_bridge::config::{ArmKind, Config, Poll};
use armwire_bridge::control::{
    Failure, FromAdapter, FromHost, Identity, MAX_COBS, MAX_FRAME, MAX_MESSAGE, Reader, Request, decode, encode,
    encode_cobs,
};
use armwire_bridge::isotp::{self, Endpoint, Link};
use armwire_bridge::{
    Action, Bridge, CanErrors, CanEvent, Counters, PACKET, Start, Status, Transmit, UartErrors, UartEvent, UsbEvent,
};

use crate::subject::{request_bytes, response_bytes};
use crate::{Result, Subject, Unstructured};

/// An adapter, its hosts, and the bytes they sent and received.
pub struct World {
    /// The adapter.
    pub bridge: Bridge,
    /// The time.
    pub now: Instant,
    config: Config,

    /// All bytes sent by the arm and received by the host on USB.
    arm_sent: Vec<u8>,
    usb_received: Vec<u8>,
    /// All that was taken from the host on USB, and went to the arm of it.
    usb_said: Vec<u8>,
    /// Bytes of that host that were refused as they came, because of its rate.
    refused: u32,
    usb_sent: Vec<u8>,
    /// The last request received by the arm, and the bytes it received from all initiators.
    last: Vec<u8>,
    to_arm: usize,
    /// Requests of all but the host on USB that want an answer, as far as that is known.
    wanted: Option<usize>,

    /// The host on CAN: its connections, what it has sent on them, and how many PDUs of it were sent to the arm.
    arm: Endpoint<100, 100>,
    control: Endpoint<300, 100>,
    can_requested: Vec<Vec<u8>>,
    can_sent: usize,
    /// Requests of the host on CAN received by the arm, and the number of answers received.
    can_queries: Vec<Vec<u8>>,
    can_received: usize,
    command: u8,
    /// Maximum number of bytes from hosts on CAN to the arm.
    can_bytes: usize,

    /// Control messages: how many were sent, and answered.
    reader: Reader<MAX_MESSAGE>,
    sequence: u8,
    control_requests: usize,
    slcan_requests: usize,
    answered: usize,
    answered_on_can: usize,

    /// Events that make some totals inexact.
    usb_gone: bool,
    can_disturbed: bool,
    reconfigured: bool,
    commanded: bool,
    others: bool,
}

/// Any request that moves a Ling arm: three of them are a stream.
pub fn any_move_request(u: &mut Unstructured<'_>) -> Result<Vec<u8>> {
    let request = ling::Request::Move(u.arbitrary()?);
    Ok(request_bytes(Ling, &request))
}

/// Arbitrary bytes of this kind of arm.
pub fn any_arm_bytes(u: &mut Unstructured<'_>, arm: ArmKind) -> Result<Vec<u8>> {
    match arm {
        ArmKind::Ling => Ling.any_frame(u, ()),
        ArmKind::Alpha1 | ArmKind::Alpha1Servo => {
            let sent = Alpha1::any_response(u)?;
            Ok(response_bytes(Alpha1, &sent))
        }
        ArmKind::Raw => Ok(u.arbitrary::<&[u8]>()?.to_vec()),
    }
}

impl World {
    /// An adapter that a host on USB has found, unless it is `detached`.
    pub fn new(config: Config, detached: bool) -> Self {
        let identity = Identity {
            can_fd: true,
            ..Identity::default()
        };
        let mut bridge = Bridge::new(identity, config, Start::default());
        let config = bridge.config();
        let link = match config.can.data_bit_rate {
            Some(_) => Link::Fd,
            None => Link::Classic,
        };
        let end = |function: Function| isotp::Config::new(link, function.id(config.can.node));
        bridge.usb_event(UsbEvent::Configured(!detached), Instant::ZERO);
        Self {
            bridge,
            now: Instant::ZERO,
            config,
            arm_sent: Vec::new(),
            usb_received: Vec::new(),
            usb_said: Vec::new(),
            refused: 0,
            usb_sent: Vec::new(),
            last: Vec::new(),
            to_arm: 0,
            wanted: Some(0),
            arm: Endpoint::new(end(Function::ArmRequest)),
            control: Endpoint::new(end(Function::ControlRequest)),
            can_requested: Vec::new(),
            can_sent: 0,
            can_queries: Vec::new(),
            can_received: 0,
            command: u8::MAX,
            can_bytes: 0,
            reader: Reader::new(),
            sequence: 0,
            control_requests: 0,
            slcan_requests: 0,
            answered: 0,
            answered_on_can: 0,
            usb_gone: false,
            can_disturbed: false,
            reconfigured: false,
            commanded: false,
            others: config.poll != Poll::Off,
        }
    }

    /// Any request to the kind of arm that there is.
    pub fn any_arm_request(&self, u: &mut Unstructured<'_>) -> Result<Vec<u8>> {
        match self.bridge.config().arm {
            ArmKind::Ling => Ling.any_frame(u, ()),
            ArmKind::Alpha1 | ArmKind::Alpha1Servo => {
                Alpha1::any_request(u).map(|request| request_bytes(Alpha1, &request))
            }
            ArmKind::Raw => Ok(u.arbitrary::<&[u8]>()?.to_vec()),
        }
    }

    // ---- The host on USB ----

    /// The host finds the adapter, or gives it up.
    pub fn configured(&mut self, is: bool) {
        self.bridge.usb_event(UsbEvent::Configured(is), self.now);
        assert_eq!(self.status().is_attached, is);
        self.usb_forgot();
    }

    /// The bus was reset.
    pub fn reset(&mut self) {
        self.bridge.usb_event(UsbEvent::Reset, self.now);
        self.usb_forgot();
    }

    fn usb_forgot(&mut self) {
        self.usb_gone = true;
        self.reader = Reader::new();
    }

    /// The host wants a line coding.
    pub fn line_coding(&mut self, bytes: [u8; 7]) {
        let before = self.bridge.line_coding();
        let refused = self.bridge.counters().refused_line_codings;
        let result = self.bridge.set_line_coding(bytes, self.now);
        match result {
            Ok(()) => assert_eq!(self.bridge.line_coding().to_cdc(), bytes),
            Err(_) => assert_eq!(self.bridge.line_coding(), before),
        }
        let counted = self.bridge.counters().refused_line_codings - refused;
        assert_eq!(counted, u32::from(result.is_err()));
    }

    /// The host sends bytes, as far as there is room.
    pub fn usb_says(&mut self, bytes: &[u8]) {
        for packet in bytes.chunks(PACKET) {
            if self.status().usb_room {
                let before = self.bridge.counters().refused_rate_bytes;
                self.bridge.usb_received(packet, self.now);
                match self.bridge.counters().refused_rate_bytes - before {
                    0 => self.usb_said.extend(packet),
                    refused => {
                        assert_eq!(refused as usize, packet.len());
                        self.refused += refused;
                    }
                }
            }
        }
    }

    /// A packet of at most `most` bytes was not read: the host is gone.
    pub fn usb_lost(&mut self, most: usize) {
        let mut packet = [0; PACKET];
        if most >= PACKET
            && let Some(len) = self.bridge.usb_transmit(&mut packet)
        {
            self.bridge.usb_event(UsbEvent::Lost(len), self.now);
        }
    }

    /// The host takes a packet of each interface.
    pub fn usb_takes(&mut self) {
        let mut packet = [0; PACKET];
        let due = self.status().usb;
        let len = self.bridge.usb_transmit(&mut packet);
        assert_eq!(len.is_some(), due);
        self.usb_received.extend(&packet[..len.unwrap_or(0)]);

        let mut len = None;
        while len.is_none() && self.status().control {
            len = self.bridge.control_transmit(&mut packet, self.now);
        }
        if len.is_none() {
            assert_eq!(self.bridge.control_transmit(&mut packet, self.now), None);
        }
        let mut rest = &packet[..len.unwrap_or(0)];
        while !rest.is_empty() {
            rest = self.reader.push(rest);
            let now = self.now;
            match self.reader.next::<FromAdapter>() {
                Some(message) => self.answered += usize::from(is_reply(message.expect("it can be read"), now)),
                None => assert!(rest.is_empty()),
            }
        }
    }

    /// The host takes all there is.
    fn usb_takes_all(&mut self) {
        while self.status().usb || self.status().control {
            self.usb_takes();
        }
    }

    /// The host sends a request on the control interface, if there is room.
    pub fn control_sends(&mut self, request: Request) {
        if !self.status().control_room {
            return;
        }
        let mut bytes = [0; MAX_COBS];
        let len = encode_cobs(&self.message(request), &mut bytes).expect("there is room");
        assert!(len <= PACKET);
        self.control_requests += 1;
        self.bridge.control_received(&bytes[..len], self.now);
    }

    fn message(&mut self, request: Request) -> FromHost {
        self.sequence = self.sequence.wrapping_add(1);
        self.reconfigured |= matches!(request, Request::SetConfig(_) | Request::ResetConfig);
        self.others |= request == Request::IdentifyArm;
        FromHost {
            sequence: self.sequence,
            request,
        }
    }

    // ---- The arm, and the UART ----

    /// The arm sends bytes.
    pub fn arm_says(&mut self, bytes: &[u8]) {
        self.arm_sent.extend(bytes);
        let is_late = self.arm_sent.len() % 2 == 1;
        for chunk in bytes.chunks(PACKET) {
            if is_late {
                // The bytes were not seen by an interrupt handler, and due events are handled later.
                let frames = self.bridge.uart_received(chunk, self.now);
                let errors = UartErrors {
                    late_stamps: frames as u32,
                    ..UartErrors::default()
                };
                self.bridge.uart_event(UartEvent::Errors(errors), self.now);
            } else {
                self.feed(|bridge, now| bridge.uart_received(chunk, now));
            }
        }
        assert!(self.bridge.rx_threshold().max > 0);
    }

    /// The line goes idle.
    pub fn line_idles(&mut self) {
        self.feed(|bridge, now| bridge.uart_event(UartEvent::Idle, now));
    }

    /// Passes input of the arm to the bridge. Without a frame, only a packet for the host may become due.
    fn feed(&mut self, feed: impl FnOnce(&mut Bridge, Instant) -> usize) {
        let before = self.status();
        let frames = feed(&mut self.bridge, self.now);
        let after = Status {
            usb: before.usb,
            passed_bytes: before.passed_bytes,
            ..self.status()
        };
        assert!(frames > 0 || after == before, "something is due without a frame");
    }

    /// The status, after pending events were sent to the hosts.
    pub fn status(&mut self) -> Status {
        self.bridge.update(self.now)
    }

    /// The arm answers the last received request, with this data if possible.
    pub fn arm_answers(&mut self, data: &[u8]) {
        let answer = match (self.bridge.config().arm, &*self.last) {
            (ArmKind::Ling, &[_, command, function, ..]) => {
                let data = &data[..data.len().min(ling::MAX_DATA)];
                let frame = ling::Frame {
                    command,
                    function,
                    data,
                };
                let mut out = [0; MAX_FRAME];
                let len = frame.encode(&mut out).expect("it is not too long");
                out[..len].to_vec()
            }
            (_, &[0xFA, _, servo, 0x01 | 0x04, ..]) => vec![servo.wrapping_add(0xAA)],
            (_, &[command @ (0xFA | 0xFC), partner, servo, ..]) => {
                let check = servo.wrapping_add(0xAA);
                vec![command, partner, servo, 0xAA, 0, 0, 0, 0, check, 0xED]
            }
            (_, &[command, partner, ..]) => vec![command, partner, 0xAA, 0xED],
            _ => return,
        };
        self.arm_says(&answer);
    }

    /// The UART reports errors.
    pub fn uart_errors(&mut self, [framing, parity, noise, overrun]: [u8; 4]) {
        self.bridge.uart_event(
            UartEvent::Errors(UartErrors {
                framing: framing.into(),
                parity: parity.into(),
                noise: noise.into(),
                overrun: overrun.into(),
                ring_overrun: u32::from(overrun == 0xFF),
                late_stamps: 0,
            }),
            self.now,
        );
    }

    /// The UART takes bytes for the arm, or changes its settings. Returns true if it did either.
    pub fn uart_takes(&mut self, room: usize) -> bool {
        let before = self.bridge.counters();
        let mut out = vec![0; room];
        // Due events are handled by a tick, and also by a request for bytes.
        self.tick();
        let due = self.status().uart;
        let (len, start) = match self.bridge.uart_transmit(&mut out, self.now) {
            None => {
                assert!(room < MAX_FRAME || !due, "pending bytes are not sent");
                return false;
            }
            Some(Transmit::Configure(uart)) => {
                assert!(due);
                self.bridge.uart_event(UartEvent::Configured(uart), self.now);
                return true;
            }
            Some(Transmit::Burst { len, start }) => (len, start),
        };
        self.bridge.uart_transmitted(self.now);
        assert!(due && (1..=room).contains(&len));
        if let Some(start) = start {
            assert!(self.now < start && start <= self.now + armwire_bridge::POLL_LEAD_TIME);
        }
        let bytes = &out[..len];
        self.to_arm += bytes.len();
        self.attribute(bytes, &before);
        self.last = bytes.to_vec();
        true
    }

    /// Attributes bytes to their initiator, by the counters.
    fn attribute(&mut self, bytes: &[u8], before: &Counters) {
        let now = self.bridge.counters();
        let others = [
            now.requests_can - before.requests_can,
            now.requests_poll - before.requests_poll,
            now.requests_command - before.requests_command,
            now.requests_adapter - before.requests_adapter,
        ];
        if others == [0; 4] {
            self.usb_sent.extend(bytes);
            return;
        }
        assert_eq!((others.iter().sum::<u32>(), now.requests_usb), (1, before.requests_usb));
        let wants = wants_answer(self.bridge.config().arm, bytes);
        self.wanted = self
            .wanted
            .zip(wants)
            .map(|(wanted, wants)| wanted + usize::from(wants));
        if others[0] == 1 {
            // PDUs of hosts on CAN are sent complete and in order.
            let place = self.can_requested[self.can_sent..].iter().position(|pdu| pdu == bytes);
            self.can_sent += 1 + place.expect("no host on CAN sent this");
            self.can_queries.push(bytes.to_vec());
        }
    }

    // ---- CAN ----

    /// The host on CAN sends a PDU, unless it is still busy with the one before.
    pub fn can_says(&mut self, pdu: &[u8]) {
        if self.arm.send(pdu).is_ok() {
            self.can_requested.push(pdu.to_vec());
            self.can_bytes += pdu.len();
            self.others = true;
        }
    }

    /// The host on CAN sends a request on the control connection, unless it is still busy.
    pub fn can_asks(&mut self, request: Request) {
        if self.control.is_sending() {
            return;
        }
        let mut bytes = [0; MAX_MESSAGE];
        let len = encode(&self.message(request), &mut bytes).expect("there is room");
        self.slcan_requests += 1;
        self.control.send(&bytes[..len]).expect("it is idle");
    }

    /// A cyclic command, of the one before or a later number.
    pub fn command(&mut self, skip: u8, joints: u16, speed: u8, gripper: u8) {
        (self.others, self.commanded) = (true, true);
        self.can_bytes += MAX_FRAME;
        self.command = self.command.wrapping_add(skip % 3);
        let command = Command {
            sequence: self.command,
            joints: [joints; 6],
            speed,
            gripper,
        };
        for frame in command.to_frames(self.config.can.node) {
            self.bridge.can_received(&frame, self.now);
        }
    }

    /// A frame of any node.
    pub fn can_frame(&mut self, id: u16, data: &[u8]) {
        let Ok(id) = Id::new(id & Id::MAX.get()) else { return };
        let Ok(frame) = Frame::new(id, &data[..data.len().min(8)]) else {
            return;
        };
        self.can_disturbed = true;
        self.others = true;
        self.can_bytes += MAX_FRAME;
        self.bridge.can_received(&frame, self.now);
    }

    /// A frame goes over the bus, if there is one: one of the adapter's first.
    pub fn can_moves(&mut self) -> bool {
        let now = self.now;
        let due = self.status().can;
        let sent = self.bridge.can_transmit(now);
        assert!(due || sent.is_none());
        assert!(sent.is_some() || !self.status().can, "it stays due");
        if let Some(frame) = sent {
            self.can_hears(&frame);
            self.bridge.can_event(CanEvent::Waiting(0), now);
            return true;
        }
        assert_eq!(self.bridge.can_transmit(now), None);
        let frame = self.arm.transmit(now).inspect(|_| self.arm.transmitted(now));
        let frame = frame.or_else(|| self.control.transmit(now).inspect(|_| self.control.transmitted(now)));
        if let Some(frame) = frame {
            self.bridge.can_received(&frame, now);
        }
        frame.is_some()
    }

    fn can_hears(&mut self, frame: &Frame) {
        let (function, node) = Function::of(frame.id()).expect("an identifier of an adapter");
        if node != self.config.can.node {
            assert!(self.reconfigured);
            return;
        }
        match function {
            Function::ArmAnswer => {
                let _ = self.arm.receive(frame.data(), self.now);
                if let Some(pdu) = self.arm.received() {
                    let pdu = pdu.to_vec();
                    self.arm.release();
                    self.can_hears_answer(&pdu);
                }
            }
            Function::ControlAnswer => {
                let _ = self.control.receive(frame.data(), self.now);
                if let Some(pdu) = self.control.received() {
                    let message = decode::<FromAdapter>(pdu).expect("it can be read");
                    self.answered_on_can += usize::from(is_reply(message, self.now));
                    self.control.release();
                }
            }
            Function::JointsA | Function::JointsB | Function::State => {
                assert!(Sample::from_frames(&[*frame; 3]).is_none());
            }
            Function::Errors => assert!(Errors::from_frame(frame).is_some()),
            Function::Event => assert!(event_from_frame(frame).is_some()),
            Function::CommandA | Function::CommandB | Function::ArmRequest | Function::ControlRequest => {
                panic!("{frame:?} is for an adapter")
            }
        }
    }

    /// Checks that the arm has sent the PDU, and, if the host on CAN gets answers only, that the host has requested it.
    fn can_hears_answer(&mut self, pdu: &[u8]) {
        let sent = self.arm_sent.windows(pdu.len()).any(|window| window == pdu);
        assert!(sent, "the arm did not send {pdu:02X?}");
        if self.reconfigured || self.config.can.unsolicited {
            return;
        }
        self.can_received += 1;
        let queries = self.can_queries.len();
        assert!(
            self.can_received <= queries,
            "{} answers to {queries} requests",
            self.can_received
        );
        if self.config.arm == ArmKind::Ling {
            // Command and function are those of the request.
            let is_requested = self
                .can_queries
                .iter()
                .any(|request| request.get(1..3) == pdu.get(1..3));
            assert!(is_requested, "no host on CAN requested {pdu:02X?}");
        }
    }

    /// The controller leaves the bus, or comes back.
    pub fn bus_off(&mut self, off: bool) {
        self.can_disturbed = true;
        let event = if off { CanEvent::BusOff } else { CanEvent::BusOn };
        self.bridge.can_event(event, self.now);
        if off {
            self.arm.abort();
            self.control.abort();
        }
    }

    /// The controller reports errors.
    pub fn can_errors(&mut self, bus: u32, overruns: u32) {
        let errors = CanErrors {
            bus,
            overruns,
            unsent: 0,
        };
        self.bridge.can_event(CanEvent::Errors(errors), self.now);
    }

    // ---- Firmware, and the time ----

    /// Performs the firmware's next action, or lets it fail. Returns true if there was one.
    pub fn act(&mut self, done: bool) -> bool {
        let action = self.bridge.action(self.now);
        match action {
            Some(Action::Save(config)) => {
                assert_eq!(config.check(), Ok(()));
                self.bridge
                    .saved(if done { Ok(()) } else { Err(Failure::Flash) }, self.now);
            }
            Some(Action::Reset) => self
                .bridge
                .saved(if done { Ok(()) } else { Err(Failure::Flash) }, self.now),
            Some(Action::RestartCan(can)) => {
                assert!(self.reconfigured);
                assert_eq!(can, self.bridge.config().can);
            }
            Some(Action::Restart | Action::RestartIntoBootLoader) | None => {}
        }
        action.is_some()
    }

    /// Lets time pass.
    pub fn wait(&mut self, micros: u64) {
        self.now += Duration::from_micros(micros);
        self.tick();
        for event in self.arm.tick(self.now).chain(self.control.tick(self.now)) {
            self.can_disturbed |= event != isotp::Event::Received;
        }
    }

    fn tick(&mut self) {
        // A tick may find another event late: after a second tick nothing is due.
        self.bridge.tick(self.now);
        self.bridge.tick(self.now);
        let left = self.bridge.timeout();
        assert!(
            left.is_none_or(|at| at > self.now),
            "ticks leave what was due at {left:?}"
        );
    }

    /// Lets time pass until something is due.
    pub fn wait_until_due(&mut self) {
        let due = [
            self.bridge.timeout(),
            self.arm.transmit_at(),
            self.arm.timeout(),
            self.control.timeout(),
        ];
        let due = due.into_iter().flatten().min().unwrap_or(self.now);
        self.wait(due.since(self.now).as_micros());
    }

    // ---- What must hold ----

    /// Checks the invariants that hold at any time.
    pub fn check(&mut self) {
        let c = self.bridge.counters();
        assert_eq!(c.arm_to_host_bytes as usize, self.arm_sent.len());
        assert_eq!(c.host_to_arm_bytes as usize, self.to_arm);
        assert_eq!(c.refused_bytes, 0, "a packet was taken that there was no room for");
        let lost = (c.dropped_bytes + c.undelivered_bytes) as usize;
        assert!(self.usb_received.len() + lost <= self.arm_sent.len());
        let can_sent: usize = self.can_queries.iter().map(Vec::len).sum();
        assert!(
            self.usb_sent.len() + can_sent + self.dropped() <= self.usb_said.len() + self.can_bytes,
            "bytes for the arm are sent twice, or counted as dropped and sent"
        );
        assert!(c.late_answers + c.unsolicited_frames <= c.frames);
        assert!(c.late_stamps <= c.frames);
        assert!(c.empty_packets_to_host <= c.packets_to_host);
        assert_eq!(self.bridge.config().check(), Ok(()));
        if self.dropped() == 0 {
            assert!(
                self.usb_said.starts_with(&self.usb_sent),
                "bytes for the arm are altered"
            );
        }
        if lost == 0 && !self.others && !self.reconfigured {
            assert!(
                self.arm_sent.starts_with(&self.usb_received),
                "bytes of the arm are altered"
            );
        }
    }

    /// Bytes that had been taken and were dropped when a host fell silent.
    fn dropped(&self) -> usize {
        let c = self.bridge.counters();
        (c.silenced_bytes + c.refused_rate_bytes - self.refused) as usize
    }

    /// The hosts read all bytes, the arm is silent, and time passes: all activity ends, and the totals are exact.
    pub fn end(mut self) {
        self.bridge.uart_event(UartEvent::Idle, self.now);
        self.settle();
        self.check_heard();
        self.check_ended();
    }

    /// Lets all that was begun end.
    fn settle(&mut self) {
        // An Alpha1 has more than a second for an answer: the line is held no longer for one of the requests that wait.
        const HOLD: Duration = Duration::from_millis(3_000);
        // A lease of the line and the rate of a host without DTR last for 10 s, and replies of many CAN frames take seconds.
        let mut end = self.now + Duration::from_millis(25_000);
        while self.now < end {
            // A host on CAN may still request polls.
            self.stop_polls();
            self.usb_takes_all();
            let mut moved = false;
            while self.uart_takes(MAX_FRAME) {
                (moved, end) = (true, end.max(self.now + HOLD));
            }
            for _ in 0..100 {
                if !self.can_moves() {
                    break;
                }
                moved = true;
            }
            while self.act(true) {
                moved = true;
            }
            self.check();
            let waits = [self.bridge.timeout(), self.arm.timeout(), self.control.timeout()];
            if !moved && waits == [None; 3] {
                break;
            }
            self.wait(40_000);
        }
    }

    /// Switches polls off.
    fn stop_polls(&mut self) {
        let config = self.bridge.config();
        if config.poll == Poll::Off {
            return;
        }
        self.usb_takes_all();
        let reconfigured = self.reconfigured;
        let without_polls = Config {
            poll: Poll::Off,
            ..config
        };
        self.control_sends(Request::SetConfig(without_polls));
        assert_eq!(self.bridge.config().poll, Poll::Off);
        self.reconfigured = reconfigured;
    }

    /// Checks the bytes at the host on USB: those sent by the arm, in order, except counted losses and answers to
    /// others.
    fn check_heard(&self) {
        let mut sent = self.arm_sent.iter();
        assert!(
            self.usb_received.iter().all(|byte| sent.any(|sent| sent == byte)),
            "the host on USB received bytes that the arm did not send"
        );
        let c = self.bridge.counters();
        if self.reconfigured {
            return;
        }
        let lost = (c.dropped_bytes + c.undelivered_bytes) as usize;
        let accounted = self.usb_received.len() + lost;
        assert!(accounted <= self.arm_sent.len(), "bytes of the arm are counted twice");
        // Only an answer to another is not for the host on USB.
        let answers = match self.others {
            true => c.frames - c.late_answers - c.unsolicited_frames,
            false => 0,
        };
        let missing = self.arm_sent.len() - accounted;
        assert!(
            missing <= answers as usize * MAX_FRAME,
            "{missing} bytes of the arm are lost, {answers} answers may have been another's"
        );
    }

    /// Checks that all activity has ended.
    fn check_ended(&mut self) {
        let now = self.now;
        let c = self.bridge.counters();
        let status = self.status();
        assert_eq!((status.uart, status.usb, status.control), (false, false, false));
        if !self.others && self.dropped() == 0 {
            assert_eq!(self.usb_sent, self.usb_said, "bytes for the arm are lost");
        }
        self.bridge.uart_received(&[], now);
        assert!(!self.bridge.is_stuck(self.now));
        if !self.usb_gone {
            assert_eq!(
                self.answered, self.control_requests,
                "requests on the control interface"
            );
        }
        // The cost of a failed transfer is counted there.
        if !self.can_disturbed && !self.reconfigured && c.isotp_failures == 0 {
            assert_eq!(
                self.answered_on_can, self.slcan_requests,
                "requests on the control connection"
            );
            // A command that a newer one replaced is counted as a request that was refused.
            if c.silenced_bytes == 0 && !self.usb_gone && !self.commanded {
                let ended = c.requests_can + c.refused_can_requests + c.refused_can_frames + c.control_requests;
                let sent = self.can_requested.len() + self.slcan_requests + self.control_requests;
                // Some requests refused during a hold may be polls.
                assert!((ended as usize..=(ended + c.refused_line_held) as usize).contains(&sent));
            }
        }
        if self.usb_said.is_empty()
            && let Some(wanted) = self.wanted
        {
            let answered = c.frames - c.late_answers - c.unsolicited_frames;
            assert_eq!(
                (answered + c.unanswered_requests) as usize,
                wanted,
                "answered, or counted as not"
            );
        }
    }
}

/// True for a reply. The stamp of an event is not in the future.
fn is_reply(message: FromAdapter, now: Instant) -> bool {
    match message {
        FromAdapter::Reply { .. } => true,
        FromAdapter::Event { at, .. } => {
            assert!(at.0 <= now.as_micros());
            false
        }
    }
}

/// True if the protocol has an answer to the request. `None` for bytes that are no message.
fn wants_answer(arm: ArmKind, bytes: &[u8]) -> Option<bool> {
    match arm {
        ArmKind::Ling => reply_of(Ling, bytes),
        ArmKind::Alpha1 | ArmKind::Alpha1Servo => reply_of(Alpha1, bytes),
        ArmKind::Raw => Some(false),
    }
}

fn reply_of<P: Messages>(protocol: P, bytes: &[u8]) -> Option<bool> {
    if protocol.scan(bytes, protocol.requests()) != Scan::Frame(bytes.len()) {
        return None;
    }
    protocol.parse_request(bytes).ok()?;
    Some(protocol.request(bytes)?.response.is_some())
}
