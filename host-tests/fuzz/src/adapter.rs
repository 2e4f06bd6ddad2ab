//! An adapter, and the actions of its hosts, its arm, its buses and the time.

use armwire::alpha1::{self, Alpha1};
use armwire::ling::{self, Ling};
use armwire::time::{Duration, Instant};
use armwire_bridge::can::command::Command;
use armwire_bridge::can::telemetry::{Errors, Sample, event_from_frame};
use armwire_bridge::can::{Frame, Function, Id};
use armwire_bridge::config::{ArmKind, Config, Poll};
use armwire_bridge::control::{Failure, FromAdapter, Identity, MAX_FRAME, MAX_MESSAGE, Request, decode, encode};
use armwire_bridge::isotp::{self, Endpoint, Link};
use armwire_bridge::store::Saved;
use armwire_bridge::{
    Action, Bridge, CanErrors, CanEvent, PACKET, Start, Status, Transmit, UartErrors, UartEvent, UsbEvent,
};
use armwire_host_tests::adapter::{ControlPort, initiator};
use armwire_host_tests::reference;

use crate::accounts::Accounts;
use crate::subject::{request_bytes, response_bytes};
use crate::{Result, Subject, Unstructured};

/// An adapter, its hosts, and the bytes they sent and received.
pub struct World {
    /// The adapter.
    pub bridge: Bridge,
    /// The time.
    pub now: Instant,
    config: Config,
    /// The host's side of the control port on USB.
    port: ControlPort,
    /// The host on CAN: its connections, and the number of its last command.
    arm: Endpoint<100, 100>,
    control: Endpoint<300, 100>,
    command: u8,
    /// The last two cyclic frames with joints.
    joints: [Option<Frame>; 2],
    /// The last request received by the arm.
    last: Vec<u8>,
    accounts: Accounts,
}

/// Any request that moves a Ling arm: three of them are a stream.
pub fn any_move_request(u: &mut Unstructured<'_>) -> Result<Vec<u8>> {
    let request = ling::Request::Move(u.arbitrary()?);
    Ok(request_bytes(Ling, &request))
}

/// Arbitrary bytes to this kind of arm.
pub fn any_arm_request(u: &mut Unstructured<'_>, arm: ArmKind) -> Result<Vec<u8>> {
    match arm {
        ArmKind::Ling => Ling.any_frame(u, ()),
        ArmKind::Alpha1 | ArmKind::Alpha1Servo => Alpha1.any_frame(u, alpha1::Expect::Requests),
        ArmKind::Raw => Ok(u.arbitrary::<&[u8]>()?.to_vec()),
    }
}

/// Arbitrary bytes of this kind of arm.
pub fn any_arm_bytes(u: &mut Unstructured<'_>, arm: ArmKind) -> Result<Vec<u8>> {
    match arm {
        ArmKind::Alpha1 | ArmKind::Alpha1Servo => Ok(response_bytes(Alpha1, &Alpha1::any_response(u)?.response, None)),
        ArmKind::Ling | ArmKind::Raw => any_arm_request(u, arm),
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
            port: ControlPort::default(),
            arm: Endpoint::new(end(Function::ArmRequest)),
            control: Endpoint::new(end(Function::ControlRequest)),
            command: u8::MAX,
            joints: [None; 2],
            last: Vec::new(),
            accounts: Accounts::new(&config),
        }
    }

    /// The configured kind of arm.
    pub fn arm_kind(&self) -> ArmKind {
        self.bridge.config().arm
    }

    // ---- The host on USB ----

    /// An event of the USB device.
    pub fn usb_event(&mut self, event: UsbEvent) {
        self.bridge.usb_event(event, self.now);
    }

    /// The host configures the device, or leaves.
    pub fn configured(&mut self, is: bool) {
        self.usb_event(UsbEvent::Configured(is));
        assert_eq!(self.status().is_attached, is);
        self.usb_is_gone();
    }

    /// The bus was reset.
    pub fn reset(&mut self) {
        self.usb_event(UsbEvent::Reset);
        self.usb_is_gone();
    }

    fn usb_is_gone(&mut self) {
        self.accounts.usb_gone = true;
        self.port = ControlPort::default();
    }

    /// The host sets a line coding.
    pub fn set_line_coding(&mut self, bytes: [u8; 7]) {
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
    pub fn usb_sends(&mut self, bytes: &[u8]) {
        for packet in bytes.chunks(PACKET) {
            if self.status().usb_room {
                let before = self.bridge.counters().refused_rate_bytes;
                self.bridge.usb_received(packet, self.now);
                match self.bridge.counters().refused_rate_bytes - before {
                    0 => self.accounts.usb_accepted.extend(packet),
                    refused => {
                        assert_eq!(refused as usize, packet.len());
                        self.accounts.refused += refused;
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
            self.usb_event(UsbEvent::Lost(len));
        }
    }

    /// The host reads a packet of each interface.
    pub fn usb_reads(&mut self) {
        let mut packet = [0; PACKET];
        let due = self.status().usb;
        let len = self.bridge.usb_transmit(&mut packet);
        assert_eq!(len.is_some(), due);
        self.accounts.usb_received.extend(&packet[..len.unwrap_or(0)]);

        let messages = self.port.read_packet(&mut self.bridge, self.now).unwrap_or_default();
        self.accounts.control_replies += messages.iter().filter(|message| is_reply(message, self.now)).count();
    }

    /// The host reads all packets.
    fn usb_reads_all(&mut self) {
        while self.status().usb || self.status().control {
            self.usb_reads();
        }
    }

    /// The host sends a request to the control port, if there is room.
    pub fn control(&mut self, request: Request) {
        if self.status().control_room {
            self.accounts.on_control_request(request);
            self.accounts.control_requests += 1;
            self.port.send(&mut self.bridge, request, self.now);
        }
    }

    // ---- The arm, and the UART ----

    /// The arm sends bytes.
    pub fn arm_sends(&mut self, bytes: &[u8]) {
        self.accounts.arm_sent.extend(bytes);
        let is_late = self.accounts.arm_sent.len() % 2 == 1;
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
        assert!(self.bridge.rx_wait().threshold.max > 0);
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
        let answer = match (self.arm_kind(), &*self.last) {
            (ArmKind::Ling, &[_, command, function, ..]) => {
                reference::ling::frame(command, function, &data[..data.len().min(ling::MAX_DATA)])
            }
            (_, &[0xFA, _, servo, 0x01 | 0x04, ..]) => vec![servo.wrapping_add(0xAA)],
            (_, &[command @ (0xFA | 0xFC), _, servo, ..]) => {
                reference::alpha1::frame(command, &[servo, 0xAA, 0, 0, 0, 0])
            }
            (_, &[command, partner, ..]) => vec![command, partner, 0xAA, 0xED],
            _ => return,
        };
        self.arm_sends(&answer);
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

    /// The UART transmits a burst, or changes its settings. Returns true if it did either.
    pub fn uart_transmits(&mut self) -> bool {
        let before = self.bridge.counters();
        let mut out = [0; MAX_FRAME];
        // Due events are handled by a tick, and also by a request for bytes.
        self.tick();
        let due = self.status().uart;
        let (len, start) = match self.bridge.uart_transmit(&mut out, self.now, |_, _| {}) {
            None => {
                assert!(!due, "pending bytes are not sent");
                return false;
            }
            Some(Transmit::Configure(uart)) => {
                assert!(due);
                self.bridge.uart_event(UartEvent::Configured(uart), self.now);
                return true;
            }
            Some(Transmit::Burst { len, start }) => (len, start),
        };
        assert!(due && (1..=MAX_FRAME).contains(&len));
        if let Some(start) = start {
            assert!(self.now < start && start <= self.now + armwire_bridge::POLL_LEAD_TIME);
        }
        let sent = &out[..len];
        let initiator = initiator(&before, &self.bridge.counters());
        self.accounts.on_sent(initiator, sent, self.arm_kind());
        self.last = sent.to_vec();
        true
    }

    // ---- CAN ----

    /// The host on CAN sends a PDU, unless it is still busy with the one before.
    pub fn can_sends(&mut self, pdu: &[u8]) {
        if self.arm.send(pdu).is_ok() {
            self.accounts.can_requested.push(pdu.to_vec());
            self.accounts.can_bytes += pdu.len();
            self.accounts.others = true;
        }
    }

    /// The host on CAN sends a request on the control connection, unless it is still busy.
    pub fn can_control(&mut self, request: Request) {
        if self.control.is_sending() {
            return;
        }
        let mut bytes = [0; MAX_MESSAGE];
        let len = encode(&self.port.message(request), &mut bytes).expect("there is room");
        self.accounts.on_control_request(request);
        self.accounts.can_control_requests += 1;
        self.control.send(&bytes[..len]).expect("it is idle");
    }

    /// A cyclic command, of the one before or a later number.
    pub fn command(&mut self, skip: u8, joints: u16, speed: u8, gripper: u8) {
        (self.accounts.others, self.accounts.commanded) = (true, true);
        self.accounts.can_bytes += MAX_FRAME;
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
        (self.accounts.can_disturbed, self.accounts.others) = (true, true);
        self.accounts.can_bytes += MAX_FRAME;
        self.bridge.can_received(&frame, self.now);
    }

    /// A frame goes over the bus, if there is one: one of the adapter's first. Returns true if there was one.
    pub fn use_bus(&mut self) -> bool {
        let now = self.now;
        let due = self.status().can;
        let sent = self.bridge.can_transmit(now);
        assert!(due || sent.is_none());
        assert!(sent.is_some() || !self.status().can, "it stays due");
        if let Some(frame) = sent {
            self.on_can_frame(&frame);
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

    fn on_can_frame(&mut self, frame: &Frame) {
        let (function, node) = Function::of(frame.id()).expect("an identifier of an adapter");
        if node != self.config.can.node {
            assert!(self.accounts.reconfigured);
            return;
        }
        match function {
            Function::ArmAnswer => {
                let _ = self.arm.receive(frame.data(), self.now);
                if let Some(pdu) = self.arm.received() {
                    self.accounts.on_can_answer(pdu, &self.config);
                    self.arm.release();
                }
            }
            Function::ControlAnswer => {
                let _ = self.control.receive(frame.data(), self.now);
                if let Some(pdu) = self.control.received() {
                    let message = decode::<FromAdapter>(pdu).expect("it can be read");
                    self.accounts.can_control_replies += usize::from(is_reply(&message, self.now));
                    self.control.release();
                }
            }
            Function::JointsA | Function::JointsB => self.joints = [self.joints[1], Some(*frame)],
            Function::State => self.on_sample(frame),
            Function::Errors => assert!(Errors::from_frame(frame).is_some()),
            Function::Event => assert!(event_from_frame(frame).is_some()),
            Function::CommandA | Function::CommandB | Function::ArmRequest | Function::ControlRequest => {
                panic!("{frame:?} is for an adapter")
            }
        }
    }

    /// The last frame of a sample: it has the state in a frame of the arm, and its stamp is no later than now.
    fn on_sample(&self, state: &Frame) {
        let [Some(a), Some(b)] = self.joints else { return };
        let Some(sample) = Sample::from_frames(&[a, b, *state]) else {
            assert!(self.accounts.can_disturbed || self.accounts.reconfigured, "{state:?}");
            return;
        };
        assert!((self.now.as_micros() as u32).wrapping_sub(sample.stamp) < 1 << 31);
        let frame = response_bytes(Ling, &ling::Response::Joints(sample.state), None);
        // It is one of the last frames, which may be longer.
        let data = &frame[4..frame.len() - 2];
        let mut sent = self.accounts.arm_sent.windows(data.len()).rev();
        assert!(sent.any(|bytes| bytes == data), "{sample:?} was not sent");
    }

    /// The controller leaves the bus, or comes back.
    pub fn bus_off(&mut self, off: bool) {
        self.accounts.can_disturbed = true;
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
            Some(Action::Load) => self
                .bridge
                .loaded(done.then_some(Saved::Nothing).ok_or(Failure::Flash), self.now),
            Some(Action::Save(..) | Action::Replace(_) | Action::Reset(_) | Action::Erase) => {
                if let Some(Action::Save(config, _)) = action {
                    assert_eq!(config.check(), Ok(()));
                }
                self.bridge.saved(done.then_some(()).ok_or(Failure::Flash), self.now);
            }
            Some(Action::RestartCan(can)) => {
                assert!(self.accounts.reconfigured);
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
            self.accounts.can_disturbed |= event != isotp::Event::Received;
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

    // ---- Invariants ----

    /// Checks the invariants that hold at any time.
    pub fn check(&mut self) {
        assert_eq!(self.bridge.config().check(), Ok(()));
        self.accounts.check(&self.bridge.counters());
    }

    /// The hosts read all bytes, the arm is silent, and time passes: all activity ends, and the totals are exact.
    pub fn end(mut self) {
        self.bridge.uart_event(UartEvent::Idle, self.now);
        self.settle();
        let status = self.status();
        assert_eq!((status.uart, status.usb, status.control), (false, false, false));
        self.bridge.uart_received(&[], self.now);
        assert!(!self.bridge.is_stuck(self.now));
        self.accounts.check_ended(&self.bridge.counters());
    }

    /// Lets all activity end.
    fn settle(&mut self) {
        // An Alpha1 has more than a second for an answer: a waiting request blocks the line for no longer.
        const HOLD: Duration = Duration::from_millis(3_000);
        // A reservation and the rate of a host without DTR last for 10 s, and replies of many CAN frames take seconds.
        let mut end = self.now + Duration::from_millis(25_000);
        while self.now < end {
            // A host on CAN may still request polls.
            self.stop_polls();
            self.usb_reads_all();
            let mut moved = false;
            while self.uart_transmits() {
                (moved, end) = (true, end.max(self.now + HOLD));
            }
            for _ in 0..100 {
                if !self.use_bus() {
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
        self.usb_reads_all();
        let reconfigured = self.accounts.reconfigured;
        let without_polls = Config {
            poll: Poll::Off,
            ..config
        };
        self.control(Request::SetConfig(without_polls));
        assert_eq!(self.bridge.config().poll, Poll::Off);
        self.accounts.reconfigured = reconfigured;
    }
}

/// True for a reply. The stamp of an event is not in the future.
fn is_reply(message: &FromAdapter, now: Instant) -> bool {
    if let FromAdapter::Event { at, .. } = message {
        assert!(at.0 <= now.as_micros());
    }
    matches!(message, FromAdapter::Reply { .. })
}
