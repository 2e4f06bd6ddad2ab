//! An adapter in virtual time, with an arm and hosts on USB and on CAN.

use std::collections::VecDeque;

use armwire::framing::LONGEST_VOID;
use armwire::ling::{self, Ling, MAX_FRAME};
use armwire::messages::Messages;
use armwire_bridge::Instant;
use armwire_bridge::can::command::Command;
use armwire_bridge::can::{Frame, Function, Node};
use armwire_bridge::config::{ArmKind, Can, Config, ConfigError};
use armwire_bridge::control::{Event, Failure, FromAdapter, Identity, Refusal, Reply, Request, Subscription};
use armwire_bridge::isotp::{self, Endpoint, Link};
use armwire_bridge::{Action, Bridge, CanEvent, LineCoding, PACKET, Start, Status, Transmit, UartEvent, UsbEvent};

use super::arm::{Arm, Behavior};
use super::oracle::Oracle;
use super::{Conditions, ControlPort, byte_times, initiator};
use crate::random::Random;

/// Duration of a frame on the CAN bus, in µs.
const CAN_FRAME: u64 = 130;

/// Polling period of the UART without received bytes, in µs.
const RX_POLL_PERIOD: u64 = 100_000;

/// An adapter with its arm and hosts.
pub(super) struct Rig {
    identity: Identity,
    bridge: Bridge,
    pub(super) oracle: Oracle,
    pub(super) now: u64,
    random: Random,
    arm: Arm,
    pub(super) config: Config,
    /// True if events are printed.
    is_traced: bool,

    baud: u32,
    uart_free_at: u64,
    idle: Option<u64>,
    next_rx_poll: u64,

    usb: VecDeque<u8>,
    pub(super) is_usb_reading: bool,
    port: ControlPort,

    can: Endpoint<100, 100>,
    can_queue: VecDeque<Vec<u8>>,
    can_pdu: Option<Vec<u8>>,
    is_refused: bool,
    bus_free_at: u64,
    command: u8,
    last_command: Option<u64>,

    counted_as_refused: u32,
    /// The sequence number of the last request on the control port, and the reply to it.
    sequence: u8,
    reply: Option<Reply>,
    /// The sequence numbers of stops without a reply.
    stops: Vec<u8>,

    /// Duration of a save to flash, in µs.
    save_duration: u64,
    /// Conditions met.
    other_rate: bool,
    reserved_line: bool,
    saved: bool,
    unsolicited: u32,
    /// The adapter has restarted: the run is over.
    pub(super) is_over: bool,
}

impl Rig {
    /// An adapter with this configuration in its flash. Without CAN, it leaves the settings of the bus out.
    pub(super) fn new(
        saved: Config,
        has_can: bool,
        behavior: Behavior,
        save_duration: u64,
        random: Random,
        is_traced: bool,
    ) -> Self {
        let identity = Identity {
            no_can: !has_can,
            ..Identity::default()
        };
        let can = if has_can { saved.can } else { Can::default() };
        let config = Config { can, ..saved };
        let mut bridge = Bridge::new(identity.clone(), saved, Start::default());
        assert_eq!(bridge.config(), config);
        bridge.usb_event(UsbEvent::Configured(true), Instant::ZERO);
        let request = Function::ArmRequest.id(config.can.node);
        let mut rig = Self {
            identity,
            bridge,
            oracle: Oracle::new(config),
            now: 0,
            random,
            arm: Arm::new(behavior),
            config,
            is_traced,
            baud: LineCoding::LING.baud,
            uart_free_at: 0,
            idle: None,
            next_rx_poll: RX_POLL_PERIOD,
            usb: VecDeque::new(),
            is_usb_reading: true,
            port: ControlPort::default(),
            can: Endpoint::new(isotp::Config::new(Link::Classic, request)),
            can_queue: VecDeque::new(),
            can_pdu: None,
            is_refused: false,
            bus_free_at: 0,
            command: 0,
            last_command: None,
            counted_as_refused: 0,
            sequence: 0,
            reply: None,
            stops: Vec::new(),
            save_duration,
            other_rate: false,
            reserved_line: false,
            saved: false,
            unsolicited: 0,
            is_over: false,
        };
        let everything = Subscription {
            frames: true,
            events: true,
        };
        rig.control(Request::Subscribe(everything));
        rig
    }

    fn trace(&self, what: impl FnOnce() -> String) {
        if self.is_traced {
            println!("{:9} {}", self.now, what());
        }
    }

    fn time(&self) -> Instant {
        Instant::from_micros(self.now)
    }

    fn status(&mut self) -> Status {
        self.bridge.update(self.time())
    }

    pub(super) fn run_until(&mut self, end: u64) {
        if self.is_over {
            return;
        }
        self.step();
        while !self.is_over {
            let later = |at: u64| (at > self.now).then_some(at);
            let next = [
                self.arm.timeout(),
                self.bridge.timeout().map(|at| at.as_micros()),
                self.idle,
                Some(self.next_rx_poll),
                later(self.uart_free_at),
                later(self.bus_free_at),
                self.can.transmit_at().map(|at| at.as_micros()).and_then(later),
                self.can.timeout().map(|at| at.as_micros()),
            ];
            let next = next.into_iter().flatten().min().unwrap_or(end).max(self.now);
            if next > end {
                break;
            }
            self.now = next;
            self.step();
        }
        self.now = self.now.max(end);
    }

    /// Handles all events due now.
    fn step(&mut self) {
        self.arm.tick(self.now, &mut self.random);
        while let Some((at, bytes)) = self.arm.transmit(self.now) {
            self.on_arm_bytes(at.max(self.now), &bytes);
        }
        if self.idle.take_if(|at| *at <= self.now).is_some() {
            self.bridge.uart_event(UartEvent::Idle, self.time());
        }
        if self.next_rx_poll <= self.now {
            self.next_rx_poll = self.now + RX_POLL_PERIOD;
            self.bridge.uart_received(&[], self.time());
        }
        for event in self.can.tick(self.time()) {
            let is_disturbed = self.oracle.is_can_disturbed;
            assert!(
                is_disturbed || !matches!(event, isotp::Event::Failed(_)),
                "{event:?} at {}",
                self.now
            );
        }
        while !self.is_over && self.serve() {}
        if !self.is_over {
            self.oracle.tick(self.now);
            self.oracle.check(self.now);
            assert!(
                !self.bridge.is_stuck(self.time()),
                "the adapter is stuck at {} µs",
                self.now
            );
        }
    }

    fn on_arm_bytes(&mut self, at: u64, bytes: &[u8]) {
        if self.baud != LineCoding::LING.baud {
            return; // at another rate no valid byte arrives
        }
        self.trace(|| format!("arm: {bytes:02X?}"));
        self.oracle.on_arm_sent(at, bytes);
        let (head, tail) = match self.random.percent(25) {
            true => bytes.split_at(self.random.between(1, bytes.len() as u64 - 1) as usize),
            false => bytes.split_at(0),
        };
        let early = Instant::from_micros(at - byte_times(tail.len()));
        for (bytes, at) in [(head, early), (tail, Instant::from_micros(at))] {
            if !bytes.is_empty() {
                self.bridge.uart_received(bytes, at);
                self.poll_control();
            }
        }
        self.idle = Some(at + byte_times(1) + 1);
    }

    /// Lets each participant do one thing that needs no waiting. Returns true if there was any.
    fn serve(&mut self) -> bool {
        let now = self.time();
        let mut any = false;
        if self.bridge.timeout().is_some_and(|at| at <= now) {
            // The first tick may end a stream that blocked another rate.
            self.bridge.tick(now);
            self.bridge.tick(now);
            assert!(
                self.bridge.timeout().is_none_or(|at| at > now),
                "ticks leave what was due"
            );
            any = true;
        }
        self.oracle.end_stop(self.now);
        self.poll_control();
        if !self.status().usb_room {
            self.oracle.on_usb_blocked(self.now);
        } else if !self.usb.is_empty() {
            let packet: Vec<u8> = self.usb.drain(..self.usb.len().min(PACKET)).collect();
            self.bridge.usb_received(&packet, now);
            self.trace(|| format!("from USB: {packet:02X?}"));
            let refused = self.refused_bytes();
            match refused {
                0 => self.oracle.on_usb_accepted(self.now, &packet),
                _ => self.oracle.on_usb_refused(self.now, packet.len(), refused),
            }
            any = true;
        }
        let mut packet = [0; PACKET];
        while self.is_usb_reading
            && let Some(len) = self.bridge.usb_transmit(&mut packet)
        {
            self.oracle.usb_bytes += len as u64;
            any = true;
        }
        any |= self.use_line();
        any |= self.use_bus();
        while !self.is_over
            && let Some(action) = self.bridge.action(self.time())
        {
            self.act(action);
            any = true;
        }
        self.poll_control();
        any
    }

    // ---- The arm's line ----

    fn use_line(&mut self) -> bool {
        let now = self.time();
        if self.status().uart_cut {
            // The current byte is completed, and possibly the next.
            let rest = 2 * nanos_a_byte(self.baud).div_ceil(1_000);
            self.uart_free_at = self.uart_free_at.min(self.now + rest);
        }
        if self.uart_free_at > self.now {
            return false;
        }
        let before = self.bridge.counters();
        let mut out = [0; MAX_FRAME];
        let transmit = self.bridge.uart_transmit(&mut out, now, |_, _| {});
        self.poll_control();
        let (len, start) = match transmit {
            None => return false,
            Some(Transmit::Configure(uart)) => {
                self.bridge.uart_event(UartEvent::Configured(uart), self.time());
                self.baud = uart.coding.baud;
                let at_arms_rate = self.baud == LineCoding::LING.baud;
                self.other_rate |= !at_arms_rate;
                self.oracle.on_rate_changed(self.now, at_arms_rate);
                return true;
            }
            Some(Transmit::Burst { len, start }) => (len, start),
        };
        let after = self.bridge.counters();
        let initiator = initiator(&before, &after);
        let start = start.map_or(self.now, |at| at.as_micros());
        let bytes = &out[..len];
        self.uart_free_at = start + (len as u64 * nanos_a_byte(self.baud)).div_ceil(1_000);
        self.trace(|| format!("{initiator} at {start}: {bytes:02X?}"));
        let untracked = after.untracked_requests - before.untracked_requests;
        self.oracle
            .on_sent(initiator, bytes, untracked, self.now, start..self.uart_free_at);
        if self.baud == LineCoding::LING.baud && self.arm.on_bytes(bytes, start, &mut self.random) {
            self.oracle.on_torque_off();
        }
        true
    }

    /// The arm sends an unsolicited frame.
    pub(super) fn arm_sends_unsolicited(&mut self) {
        self.arm.send_unsolicited(self.now);
        self.unsolicited += 1;
    }

    // ---- The host on USB ----

    /// The host on USB writes bytes.
    pub(super) fn usb_writes(&mut self, bytes: &[u8]) {
        self.usb.extend(bytes);
    }

    /// The host on USB sets the rate. The change may overtake bytes written before.
    pub(super) fn set_rate(&mut self, baud: u32) {
        let coding = LineCoding {
            baud,
            ..LineCoding::LING
        };
        self.trace(|| format!("{baud} baud"));
        let result = self.bridge.set_line_coding(coding.to_cdc(), self.time());
        assert_eq!(result, Ok(()));
        self.oracle.on_rate_requested(baud == LineCoding::LING.baud);
    }

    /// The host on USB opens or closes the serial port.
    pub(super) fn set_dtr(&mut self, high: bool) {
        self.trace(|| format!("DTR {high}"));
        self.bridge.usb_event(UsbEvent::Dtr(high), self.time());
        self.oracle.on_dtr(self.now, high, nanos_a_byte(self.baud));
    }

    /// The host on USB sends a request to the control port.
    pub(super) fn control(&mut self, request: Request) {
        if !self.status().control_room {
            return;
        }
        self.trace(|| format!("control port: {request:?}"));
        self.oracle.on_control_request(request == Request::IdentifyArm);
        match request {
            Request::Restart | Request::RestartIntoBootLoader => self.oracle.on_restart_request(),
            Request::EndStream => self.oracle.on_end_stream(),
            // Requests of other hosts are refused before the reply.
            Request::ReserveLine => self.oracle.may_be_reserved = true,
            Request::Stop => self.oracle.on_stop_request(self.now, !self.stops.is_empty()),
            _ => {}
        }
        self.reply = None;
        let now = self.time();
        self.sequence = self.port.send(&mut self.bridge, request, now);
        if request == Request::Stop {
            self.stops.push(self.sequence);
        }
        self.poll_control();
        self.oracle.may_be_reserved = false;
        match (request, self.reply.take()) {
            (Request::ReserveLine, Some(Reply::Done)) => {
                self.reserved_line = true;
                self.oracle.on_reservation(true);
            }
            (Request::ReserveLine, reply) => {
                let is_stopping = reply == Some(Reply::Failed(Failure::Busy));
                assert!(
                    is_stopping || reply == Some(Reply::Failed(Failure::StreamArmed)),
                    "{reply:?}"
                );
                self.oracle.on_reservation_refused(is_stopping);
            }
            (Request::Stop, _) => self.oracle.on_stop(),
            (Request::ReleaseLine, _) => self.oracle.on_reservation(false),
            (Request::SetConfig(config), reply) if config.arm != ArmKind::Ling => {
                assert_eq!(reply, Some(Reply::Failed(Failure::StreamArmed)));
            }
            (Request::SetConfig(config), reply) if config.can != self.config.can => {
                assert_eq!(reply, Some(Reply::BadConfig(ConfigError::NoCan)));
            }
            _ => {}
        }
    }

    /// Configures another arm while a stream is armed: torque-off is a frame of the present one.
    pub(super) fn configure_other_arm(&mut self) {
        if self.status().is_armed {
            let other = Config {
                arm: ArmKind::Raw,
                ..Config::default()
            };
            self.control(Request::SetConfig(other));
        }
    }

    /// Configures the bus of an adapter without CAN.
    pub(super) fn configure_bus(&mut self) {
        let can = Can {
            commands: true,
            ..Can::default()
        };
        self.control(Request::SetConfig(Config { can, ..self.config }));
    }

    /// Number of bytes of the host on USB refused because of its rate since the last call.
    fn refused_bytes(&mut self) -> usize {
        let counted = self.bridge.counters().refused_rate_bytes;
        let refused = counted - self.counted_as_refused;
        self.counted_as_refused = counted;
        refused as usize
    }

    fn poll_control(&mut self) {
        match self.refused_bytes() {
            0 => {}
            refused => self.oracle.on_usb_dropped(refused),
        }
        let now = self.time();
        while let Some(messages) = self.port.read_packet(&mut self.bridge, now) {
            messages.into_iter().for_each(|message| self.on_message(message));
        }
    }

    fn on_message(&mut self, message: FromAdapter) {
        match message {
            FromAdapter::Reply { sequence, reply } => {
                let identified = matches!(reply, Reply::Arm(_) | Reply::Failed(Failure::LineReserved));
                self.oracle.on_control_reply(identified);
                if let Some(nth) = self.stops.iter().position(|stop| *stop == sequence) {
                    self.stops.remove(nth);
                    self.oracle.on_stop_reply(self.now, &reply);
                }
                if sequence == self.sequence {
                    self.reply = Some(reply);
                }
            }
            FromAdapter::Event { at, event } => {
                self.trace(|| format!("event: {event:?}"));
                let is_refused = self.oracle.on_event(self.now, at.0, &event);
                self.is_refused |= is_refused;
                if let (
                    Event::Refused {
                        reason: Refusal::QueueFull,
                        ..
                    },
                    Some(pdu),
                ) = (event, &self.can_pdu)
                    && is_refused
                {
                    self.oracle.on_can_without_room(at.0, pdu);
                }
            }
        }
    }

    // ---- Hosts on CAN ----

    /// A host on CAN sends a PDU, after all earlier ones.
    pub(super) fn can_sends(&mut self, pdu: Vec<u8>) {
        self.can_queue.push_back(pdu);
    }

    /// Another node sends a frame to the arm's identifier.
    pub(super) fn can_frame(&mut self, data: &[u8]) {
        let id = Function::ArmRequest.id(self.config.can.node);
        let frame = Frame::new(id, data).expect("it is a frame");
        self.trace(|| format!("another node: {data:02X?}"));
        self.oracle.is_can_disturbed = true;
        self.bridge.can_received(&frame, self.time());
        self.poll_control();
    }

    /// The controller on CAN sends a cyclic command with this speed, in range or not.
    pub(super) fn command(&mut self, joint: u16, speed: u8) {
        let timeout = u64::from(self.config.can.command_timeout_ms) * 1_000;
        // A stream restarts after a pause.
        self.command = match self.last_command {
            Some(last) if self.now < last + timeout => self.command.wrapping_add(1),
            _ => 0,
        };
        self.last_command = Some(self.now);
        let starts = self.command == 0;
        let command = Command {
            sequence: self.command,
            joints: [joint; 6],
            speed,
            gripper: 0,
        };
        let refused = |bridge: &mut Bridge| {
            let counters = bridge.counters();
            let refused = [counters.refused_line_reserved, counters.refused_stopped];
            (counters.commands_stale, refused)
        };
        let before = refused(&mut self.bridge);
        for frame in command.to_frames(Node::default()) {
            self.bridge.can_received(&frame, self.time());
        }
        let is_taken = refused(&mut self.bridge) == before;
        // The first command of a stream moves nothing. A number 0 in a running stream starts no new one.
        match command.target() {
            _ if !is_taken => self.last_command = None,
            _ if starts => {}
            Ok(target) => self.oracle.on_command_accepted(self.now, motion(&target)),
            Err(_) => self.oracle.on_command_without_speed(self.now),
        }
        self.poll_control();
    }

    fn use_bus(&mut self) -> bool {
        if self.bus_free_at > self.now {
            return false;
        }
        let now = self.time();
        let status = self.status();
        if self.identity.no_can {
            let frame = self.bridge.can_transmit(now);
            assert_eq!((status.can, frame), (false, None), "a frame without a bus");
            return false;
        }
        if let Some(frame) = self.bridge.can_transmit(now) {
            self.bus_free_at = self.now + CAN_FRAME;
            self.bridge.can_event(CanEvent::Waiting(0), now);
            self.on_bus_frame(&frame);
            return true;
        }
        if self.can_pdu.is_none()
            && let Some(pdu) = self.can_queue.pop_front()
        {
            self.can.send(&pdu).expect("it is idle");
            self.can_pdu = Some(pdu);
            self.is_refused = false;
        }
        let Some(frame) = self.can.transmit(now) else {
            return false;
        };
        self.can.transmitted(now);
        self.bus_free_at = self.now + CAN_FRAME;
        self.bridge.can_received(&frame, now);
        self.poll_control();
        self.end_pdu();
        true
    }

    /// Records the result of the PDU in transfer once it has ended.
    fn end_pdu(&mut self) {
        if self.can.is_sending() {
            return;
        }
        if let Some(pdu) = self.can_pdu.take()
            && !self.is_refused
        {
            self.trace(|| format!("from CAN: {pdu:02X?}"));
            self.oracle.on_can_accepted(self.now, pdu);
        }
    }

    fn on_bus_frame(&mut self, frame: &Frame) {
        let (function, _) = Function::of(frame.id()).expect("an identifier of an adapter");
        if function != Function::ArmAnswer {
            return;
        }
        // An adapter without room refuses.
        for _ in self.can.receive(frame.data(), self.time()) {}
        if let Some(pdu) = self.can.received() {
            self.oracle.on_can_received(pdu);
            self.can.release();
        }
        self.end_pdu();
    }

    // ---- Actions of the firmware ----

    fn act(&mut self, action: Action) {
        match action {
            Action::Save(..) | Action::Reset(_) => {
                assert!(!self.oracle.is_armed(), "flash is written while a stream is armed");
                self.saved = true;
                self.now += self.save_duration;
                self.oracle.on_blocked(self.now, self.save_duration);
                while let Some((_, bytes)) = self.arm.transmit(self.now) {
                    self.on_arm_bytes(self.now, &bytes);
                }
                self.bridge.saved(Ok(()), self.time());
            }
            Action::Restart | Action::RestartIntoBootLoader => {
                self.oracle.check_restart(self.now);
                self.is_over = true;
            }
            Action::RestartCan(_) => panic!("unexpected change of the CAN bus"),
            Action::Load | Action::Replace(_) | Action::Erase => panic!("no host asks for it, outside of recovery"),
        }
    }

    /// The watchdog restarts the adapter. If a stream was armed, the first command to the arm is torque-off.
    pub(super) fn watchdog_resets(&mut self) {
        self.poll_control();
        let must = self.oracle.is_armed();
        let is_armed = self.status().is_armed;
        assert!(is_armed || !must, "the adapter does not see an armed stream");
        let start = Start {
            was_armed: is_armed,
            ..Start::default()
        };
        self.bridge = Bridge::new(self.identity.clone(), Config::default(), start);
        let mut line: Vec<u8> = Vec::new();
        let mut send = |bytes: &[u8], _| line.extend(bytes);
        while let Some(transmit) = self.bridge.uart_transmit(&mut [0; MAX_FRAME], Instant::ZERO, &mut send) {
            let Transmit::Burst { .. } = transmit else {
                panic!("the line is not the arm's: {transmit:?}");
            };
        }
        let expected = if is_armed {
            [&[0; LONGEST_VOID][..], &super::oracle::TORQUE_OFF].concat()
        } else {
            vec![]
        };
        assert_eq!(line, expected, "bytes to the arm after a restart");
        self.is_over = true;
    }

    /// Runs until all activity has ended.
    pub(super) fn settle(&mut self) {
        const QUIET: u64 = 250_000;
        let limit = self.now + 60_000_000;
        loop {
            self.run_until(self.now + QUIET);
            if self.is_over || self.is_quiet() && self.oracle.is_idle() {
                // Requests sent at 2400 baud have a later time limit.
                self.run_until(self.now + QUIET);
                // A stop reads a slow arm for two seconds.
                if self.is_over || self.is_quiet() {
                    return;
                }
            }
            assert!(self.now < limit, "the run does not end");
        }
    }

    /// The conditions met in the run.
    pub(super) fn conditions(&self) -> Conditions {
        [
            ("self-check without an answer", self.oracle.open_self_check),
            ("more than 8 requests in flight", self.oracle.most_in_flight > 8),
            ("untracked request", self.oracle.untracked_until > 0),
            ("incomplete frame", self.oracle.half_frame),
            ("another baud rate", self.other_rate),
            ("reservation", self.reserved_line),
            ("save", self.saved),
            ("unsolicited frame every 40 ms", self.unsolicited >= 5),
            ("answer 50 to 100 ms after its request", self.arm.has_answered_late),
            ("host timeout in a stream", self.oracle.host_timeouts > 0),
            ("torque-off", self.oracle.torque_offs > 0),
            (
                "stream that lives by motion without room",
                self.oracle.stream_without_room,
            ),
            (
                "stream that lives by commands without a speed",
                self.oracle.stream_without_speed,
            ),
            ("stop", self.oracle.holds > 0),
            ("adapter without CAN", self.identity.no_can),
        ]
    }

    /// True if all queues are empty.
    pub(super) fn is_quiet(&self) -> bool {
        self.usb.is_empty() && self.can_queue.is_empty() && self.can_pdu.is_none() && !self.arm.is_sending()
    }

    /// Checks the totals at the end.
    pub(super) fn check_totals(&mut self, is_whole: bool) {
        assert!(self.is_quiet(), "a queue is not empty");
        self.oracle.check_totals(&self.bridge.counters(), is_whole);
    }
}

const fn nanos_a_byte(baud: u32) -> u64 {
    10_000_000_000 / baud as u64
}

/// The request for this motion.
pub(super) fn motion(target: &ling::Move) -> Vec<u8> {
    let mut out = [0; MAX_FRAME];
    let len = Ling
        .encode_request(&ling::Request::Move(*target), &mut out)
        .expect("there is room");
    out[..len].to_vec()
}
