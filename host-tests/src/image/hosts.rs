//! The concurrent users of the arm: a host on USB, a host on CAN, and a subscriber at the control interface.
//!
//! The hosts never panic because of the adapter's behaviour. They record it for the tests.

use std::collections::VecDeque;

use armwire::decoder::{Decoder, Kind};
use armwire::ling::{Ling, MAX_FRAME};
use armwire_bridge::can::telemetry::{Sample, event_from_frame};
use armwire_bridge::can::{Frame as CanFrame, Function, Node};
use armwire_bridge::control::{Event, Initiator, Stamp};
use armwire_bridge::isotp::{self, Config, Endpoint, Link};
use armwire_virtual_board::line::Arm;
use armwire_virtual_board::{Nanos, VirtualBoard};

use super::Control;
use super::ticket_arm::{CAN, Ticket, USB, number_in};

/// Polling period without received bytes.
const POLL_PERIOD: Nanos = Nanos(250_000);

/// Time limit for an answer, after which a host gives up the request: longer than the adapter's.
const ANSWER_TIMEOUT: Nanos = Nanos::from_millis(150);

/// The requests of one host, made with tickets, and the check of each answer.
#[derive(Debug)]
pub struct RequestTracker {
    initiator: u8,
    next: u32,
    open: VecDeque<(u32, Nanos)>,
    /// Position of the last answer in the arm's sequence of answers to all hosts.
    place: Option<u32>,
    /// The number of the last answered request.
    last: Option<u32>,
    /// True while new requests are made.
    pub enabled: bool,
    /// Requests with an answer, in order.
    pub answered: u32,
    /// Requests that were given up.
    pub given_up: u32,
    /// Received frames that match no open request.
    pub strays: Vec<Vec<u8>>,
}

impl RequestTracker {
    fn new(initiator: u8) -> Self {
        Self {
            initiator,
            next: 0,
            open: VecDeque::new(),
            place: None,
            last: None,
            enabled: true,
            answered: 0,
            given_up: 0,
            strays: Vec::new(),
        }
    }

    /// Number of requests so far.
    pub fn issued(&self) -> u32 {
        self.next
    }

    /// True if no request is open.
    pub fn is_done(&self) -> bool {
        self.open.is_empty()
    }

    /// The initiator, as in a [`Ticket`].
    pub fn initiator(&self) -> u8 {
        self.initiator
    }

    /// The number of the last answered request.
    pub fn last_answered(&self) -> Option<u32> {
        self.last
    }

    /// Gives up all open requests.
    pub fn abandon(&mut self) {
        self.given_up += self.open.len() as u32;
        self.open.clear();
    }

    /// The next request.
    fn next_request(&mut self, now: Nanos) -> Vec<u8> {
        let (initiator, number) = (self.initiator, self.next);
        self.next += 1;
        self.open.push_back((number, now));
        Ticket { initiator, number }.request()
    }

    fn on_answer(&mut self, answer: &[u8]) {
        let open = Ticket::of_answer(answer).and_then(|(ticket, place)| {
            let mine = ticket.initiator == self.initiator && Some(place) > self.place;
            let nth = self.open.iter().position(|&(number, _)| number == ticket.number);
            nth.filter(|_| mine).map(|nth| (nth, place))
        });
        match open {
            // The arm answers in order: earlier requests get no answer any more.
            Some((nth, place)) => {
                self.last = self.open.drain(..=nth).next_back().map(|(number, _)| number);
                self.answered += 1;
                self.given_up += nth as u32;
                self.place = Some(place);
            }
            None => self.strays.push(answer.to_vec()),
        }
    }

    /// Gives up requests past their time limit. Returns true if there was one.
    fn give_up(&mut self, now: Nanos) -> bool {
        let before = self.given_up;
        while self
            .open
            .pop_front_if(|(_, since)| now.since(*since) > ANSWER_TIMEOUT)
            .is_some()
        {
            self.given_up += 1;
        }
        self.given_up > before
    }
}

/// Silence after which an incomplete frame is discarded.
const FRAME_GAP_TIMEOUT: Nanos = Nanos::from_millis(10);

/// Maximum number of open requests of the host on USB.
const WINDOW: u32 = 3;

/// A host at the serial port, with several open requests.
#[derive(Debug)]
pub struct UsbHost {
    /// Requests and answers.
    pub tracker: RequestTracker,
    decoder: Decoder<MAX_FRAME>,
    /// The time of the last received bytes.
    last_rx: Nanos,
    /// Received bytes.
    pub bytes: u32,
    /// Received bytes outside frames.
    pub noise_bytes: u32,
    /// True if requests are made regardless of the number of open ones.
    pub ignores_window: bool,
}

impl Default for UsbHost {
    fn default() -> Self {
        Self {
            tracker: RequestTracker::new(USB),
            decoder: Decoder::new(),
            last_rx: Nanos(0),
            bytes: 0,
            noise_bytes: 0,
            ignores_window: false,
        }
    }
}

impl UsbHost {
    /// Gives up all open requests after the port was opened anew.
    pub fn reopened(&mut self) {
        self.tracker.abandon();
        self.decoder = Decoder::new();
    }

    /// Makes `count` requests at once, in as few packets as possible. The port must be open.
    ///
    /// # Panics
    ///
    /// If it is not.
    pub fn request_burst<A: Arm>(&mut self, board: &mut VirtualBoard<A>, count: u32) {
        let requests: Vec<u8> = (0..count)
            .flat_map(|_| self.tracker.next_request(board.now()))
            .collect();
        board.usb().write(&requests).unwrap();
    }

    /// Reads answers and makes new requests. The port must be open.
    pub fn poll<A: Arm>(&mut self, board: &mut VirtualBoard<A>) {
        let bytes = board.usb().read();
        self.bytes += bytes.len() as u32;
        let mut rest = &*bytes;
        while !rest.is_empty() {
            rest = self.decoder.push(rest);
            self.decode();
        }
        let now = board.now();
        if !bytes.is_empty() {
            self.last_rx = now;
        }
        if self.tracker.give_up(now) && now.since(self.last_rx) > FRAME_GAP_TIMEOUT {
            // An apparent start of a frame may hold back the answers behind it.
            self.decoder.idle();
            self.decode();
        }
        // The window varies.
        let window = 1 + self.tracker.answered % WINDOW;
        while self.tracker.enabled
            && (self.ignores_window && board.usb().unsent() == 0 || (self.tracker.open.len() as u32) < window)
        {
            let request = self.tracker.next_request(board.now());
            board.usb().write(&request).unwrap();
        }
    }

    /// Handles complete frames.
    fn decode(&mut self) {
        while let Some(item) = self.decoder.next(&Ling, ()) {
            match item.kind {
                Kind::Frame => self.tracker.on_answer(item.bytes),
                _ => self.noise_bytes += item.bytes.len() as u32,
            }
        }
    }
}

/// A host on the CAN bus, with one ISO-TP connection for requests. It also reads the adapter's telemetry and events.
#[derive(Debug)]
pub struct CanHost {
    node: Node,
    endpoint: Endpoint<MAX_FRAME, MAX_FRAME>,
    /// Requests and answers.
    pub tracker: RequestTracker,
    /// True if the host hangs: it drops received frames and sends no flow control.
    pub hangs: bool,
    /// True if the host aborts the transfer of a given-up request.
    pub aborts: bool,
    /// Frames for the arm without an answer, sent before all tickets.
    pub orders: VecDeque<Vec<u8>>,
    /// Transfers that failed.
    pub failures: Vec<isotp::Error>,
    /// Events received as plain frames.
    pub can_events: Vec<Event>,
    /// Cyclic telemetry.
    pub telemetry: Telemetry,
}

/// Cyclic telemetry of a [`TicketArm`](super::TicketArm).
#[derive(Debug, Default)]
pub struct Telemetry {
    parts: Vec<CanFrame>,
    count: Option<u8>,
    newest: Option<u32>,
    /// Complete samples.
    pub samples: u32,
    /// Samples after a gap, and answers of the arm that were repeated or out of order.
    pub gaps: u32,
}

impl Telemetry {
    /// The number of polls answered before that of the last sample.
    pub fn newest(&self) -> Option<u32> {
        self.newest
    }

    fn on_frame(&mut self, frame: CanFrame) {
        self.parts.push(frame);
        let Ok(parts) = <&[CanFrame; 3]>::try_from(&*self.parts) else {
            return;
        };
        match Sample::from_frames(parts) {
            Some(sample) => {
                self.samples += 1;
                let follows = self.count.is_none_or(|count| sample.count == count.wrapping_add(1));
                let number = number_in(&sample.state);
                let is_new = self.newest.is_none_or(|newest| number > newest);
                self.gaps += u32::from(!follows || !is_new);
                (self.count, self.newest) = (Some(sample.count), Some(number));
                self.parts.clear();
            }
            // A frame is missing.
            None => {
                self.gaps += 1;
                self.parts.remove(0);
            }
        }
    }
}

impl CanHost {
    /// A host that communicates with this node. The bus must have another node.
    pub fn new(node: Node) -> Self {
        Self {
            node,
            endpoint: Endpoint::new(Config::new(Link::Classic, Function::ArmRequest.id(node))),
            tracker: RequestTracker::new(CAN),
            hangs: false,
            aborts: false,
            orders: VecDeque::new(),
            failures: Vec::new(),
            can_events: Vec::new(),
            telemetry: Telemetry::default(),
        }
    }

    /// True if a request of several frames is being sent.
    pub fn is_sending(&self) -> bool {
        self.endpoint.is_sending()
    }

    /// Handles the bus and makes new requests.
    pub fn poll<A: Arm>(&mut self, board: &mut VirtualBoard<A>) {
        let now = board.now().instant();
        let frames = board.can().read();
        if self.hangs {
            return;
        }
        for frame in frames {
            match Function::of(frame.id()) {
                Some((Function::ArmAnswer, node)) if node == self.node => {
                    let events = self.endpoint.receive(frame.data(), now);
                    self.record_failures(events);
                }
                Some((Function::JointsA | Function::JointsB | Function::State, _)) => self.telemetry.on_frame(frame),
                Some((Function::Event, _)) => self.can_events.extend(event_from_frame(&frame).map(|(_, event)| event)),
                _ => {}
            }
            if let Some(answer) = self.endpoint.received() {
                self.tracker.on_answer(answer);
                self.endpoint.release();
            }
        }
        let events = self.endpoint.tick(now);
        self.record_failures(events);
        let given_up = self.tracker.given_up;
        self.tracker.give_up(board.now());
        if self.aborts && self.tracker.given_up > given_up {
            self.endpoint.abort();
        }
        if !self.endpoint.is_sending() {
            let next = match self.orders.pop_front() {
                None if self.tracker.enabled && self.tracker.is_done() => Some(self.tracker.next_request(board.now())),
                order => order,
            };
            if let Some(frame) = next {
                self.endpoint.send(&frame).unwrap();
            }
        }
        while self.endpoint.transmit_at().is_some_and(|at| at <= now)
            && let Some(frame) = self.endpoint.transmit(now)
        {
            board.can().send(&frame).unwrap();
            self.endpoint.transmitted(now);
        }
    }

    fn record_failures(&mut self, events: isotp::Events) {
        for event in events {
            if let isotp::Event::Failed(error) = event {
                self.failures.push(error);
            }
        }
    }
}

/// Number of initiators, with none as the last.
const INITIATORS: usize = 6;

fn place(initiator: Option<Initiator>) -> usize {
    initiator.map_or(INITIATORS - 1, |initiator| initiator as usize)
}

/// A program at the control interface with a subscription to all events.
#[derive(Debug)]
pub struct Subscriber {
    /// The interface.
    pub control: Control,
    /// Frames of the arm, by initiator.
    frames: [u32; INITIATORS],
    /// Bytes in these frames.
    pub frame_bytes: u32,
    bytes: [u32; INITIATORS],
    last: Stamp,
    /// Frames with an earlier stamp than the frame before.
    pub disorder: u32,
    /// All other events.
    pub events: Vec<(Stamp, Event)>,
}

impl Subscriber {
    /// Opens the interface and subscribes.
    ///
    /// # Panics
    ///
    /// See [`Control::open`] and [`Control::subscribe`].
    pub fn open<A: Arm>(board: &mut VirtualBoard<A>) -> Self {
        let mut control = Control::open(board);
        control.subscribe(board);
        Self {
            control,
            frames: [0; INITIATORS],
            frame_bytes: 0,
            bytes: [0; INITIATORS],
            last: Stamp(0),
            disorder: 0,
            events: Vec::new(),
        }
    }

    /// Resets the interface after the device was detached. The records are kept.
    pub fn away(mut self) -> Self {
        self.control = Control::default();
        self
    }

    /// Opens the interface anew and subscribes.
    ///
    /// # Panics
    ///
    /// See [`open`](Self::open).
    pub fn reopen<A: Arm>(&mut self, board: &mut VirtualBoard<A>) {
        self.control = Control::open(board);
        self.control.subscribe(board);
    }

    /// Clears the records.
    pub fn forget(&mut self) {
        self.frames = [0; INITIATORS];
        self.frame_bytes = 0;
        self.bytes = [0; INITIATORS];
        self.events.clear();
        (self.last, self.disorder) = (Stamp(0), 0);
    }

    /// Reads events.
    pub fn poll<A: Arm>(&mut self, board: &mut VirtualBoard<A>) {
        for (at, event) in self.control.take_events(board) {
            match event {
                Event::Frame { initiator, bytes } => {
                    self.frames[place(initiator)] += 1;
                    self.frame_bytes += bytes.len() as u32;
                    self.bytes[place(initiator)] += bytes.len() as u32;
                    self.disorder += u32::from(at < self.last);
                    self.last = at;
                }
                other => self.events.push((at, other)),
            }
        }
    }

    /// Number of reported frames.
    pub fn all_frames(&self) -> u32 {
        self.frames.iter().sum()
    }

    /// Bytes of the frames for `initiator`, or of unasked frames.
    pub fn bytes(&self, initiator: Option<Initiator>) -> u32 {
        self.bytes[place(initiator)]
    }

    /// Number of frames for `initiator`, or of unasked frames.
    pub fn frames(&self, initiator: Option<Initiator>) -> u32 {
        self.frames[place(initiator)]
    }
}

/// All hosts. An absent host does nothing.
#[derive(Debug, Default)]
pub struct Hosts {
    /// The host at the serial port.
    pub usb: Option<UsbHost>,
    /// The host on the bus.
    pub can: Option<CanHost>,
    /// The program at the control interface.
    pub subscriber: Option<Subscriber>,
}

impl Hosts {
    /// Runs the hosts until `done`.
    ///
    /// # Panics
    ///
    /// If the firmware crashes, or it takes longer than `limit`.
    pub fn run_until<A: Arm>(
        &mut self,
        board: &mut VirtualBoard<A>,
        limit: Nanos,
        mut done: impl FnMut(&mut Self, &mut VirtualBoard<A>) -> bool,
    ) {
        let end = board.now() + limit;
        while !self.work(board, end, &mut done) {
            assert!(board.now() < end, "not done after {limit}");
        }
    }

    /// Runs the hosts for `span`.
    ///
    /// # Panics
    ///
    /// If the firmware crashes.
    pub fn run_for<A: Arm>(&mut self, board: &mut VirtualBoard<A>, span: Nanos) {
        let end = board.now() + span;
        while board.now() < end {
            self.work(board, end, &mut |_, _| false);
        }
    }

    /// Stops new requests and waits until each has ended.
    ///
    /// # Panics
    ///
    /// If the firmware crashes, or a host still waits after twice its time limit.
    pub fn finish<A: Arm>(&mut self, board: &mut VirtualBoard<A>) {
        self.set_requesting(false);
        self.run_until(board, Nanos(2 * ANSWER_TIMEOUT.0), |hosts, _| hosts.is_done());
        // Last bytes are still on their way.
        self.run_for(board, Nanos::from_millis(20));
    }

    /// Starts or stops new requests.
    pub fn set_requesting(&mut self, enabled: bool) {
        if let Some(usb) = &mut self.usb {
            usb.tracker.enabled = enabled;
        }
        if let Some(can) = &mut self.can {
            can.tracker.enabled = enabled;
        }
    }

    fn is_done(&self) -> bool {
        let usb = self.usb.as_ref().map(|usb| &usb.tracker);
        let can = self.can.as_ref().filter(|can| !can.hangs).map(|can| &can.tracker);
        usb.is_none_or(RequestTracker::is_done) && can.is_none_or(RequestTracker::is_done)
    }

    /// Polls each host once, then runs the board until the next poll.
    fn work<A: Arm>(
        &mut self,
        board: &mut VirtualBoard<A>,
        end: Nanos,
        done: &mut dyn FnMut(&mut Self, &mut VirtualBoard<A>) -> bool,
    ) -> bool {
        if let Some(usb) = &mut self.usb {
            usb.poll(board);
        }
        if let Some(can) = &mut self.can {
            can.poll(board);
        }
        if let Some(subscriber) = &mut self.subscriber {
            subscriber.poll(board);
        }
        if done(self, board) {
            return true;
        }
        let limit = board.now() + POLL_PERIOD;
        let limit = limit.min(end).since(board.now());
        let (usb, can) = (self.usb.is_some(), self.can.is_some());
        let news = |board: &mut VirtualBoard<A>| usb && board.usb().unread() > 0 || can && board.can().unread() > 0;
        match board.run_until(limit, news) {
            Ok(_) | Err(armwire_virtual_board::Error::TimedOut { .. }) => false,
            Err(error) => panic!("{error}"),
        }
    }
}
