//! The concurrent users of the arm: a host on USB, a host on CAN, and a subscriber at the control interface.
//!
//! The hosts never panic because of the adapter's behaviour. They record it for the tests.

use std::collections::VecDeque;

use armwire::decoder::{Decoder, Kind};
use armwire::ling::{Ling, MAX_FRAME};
use armwire_bridge::can::telemetry::{Sample, event_from_frame};
use armwire_bridge::can::{Frame as CanFrame, Function};
use armwire_bridge::control::{Event, Initiator, Stamp};
use armwire_bridge::isotp;
use armwire_virtual_board::line::Arm;
use armwire_virtual_board::{Error, Nanos, VirtualBoard};

use super::ticket_arm::{CAN, Ticket, USB, number_in};
use super::{BIT_RATE, CanProgram, Control, MEGABAUD, facts, plug_in};

/// Polling period without received bytes, and with bytes that no host reads.
pub(super) const POLL_PERIOD: Nanos = Nanos(250_000);
pub(super) const FINE_POLL_PERIOD: Nanos = Nanos(3_000);

/// Time limit for an answer, after which a host gives up the request: longer than the adapter's.
pub(super) const ANSWER_TIMEOUT: Nanos = Nanos::from_millis(150);

/// The requests of one host, made with tickets, and the check of each answer.
#[derive(Debug, Default)]
pub struct RequestTracker {
    /// The initiator, as in a [`Ticket`].
    pub initiator: u8,
    /// Number of requests so far.
    pub issued: u32,
    open: VecDeque<(u32, Nanos)>,
    /// Position of the last answer in the arm's sequence of answers to all hosts.
    place: Option<u32>,
    /// The number of the last answered request.
    pub last_answered: Option<u32>,
    /// True while no new requests are made.
    pub paused: bool,
    /// Requests with an answer, in order.
    pub answered: u32,
    /// Requests that were given up.
    pub given_up: u32,
    /// Received frames that match no open request.
    pub strays: Vec<Vec<u8>>,
}

impl RequestTracker {
    /// True if no request is open.
    pub fn is_done(&self) -> bool {
        self.open.is_empty()
    }

    fn next_request(&mut self, now: Nanos) -> Vec<u8> {
        let (initiator, number) = (self.initiator, self.issued);
        self.issued += 1;
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
                self.last_answered = self.open.drain(..=nth).next_back().map(|(number, _)| number);
                self.answered += 1;
                self.given_up += nth as u32;
                self.place = Some(place);
            }
            None => self.strays.push(answer.to_vec()),
        }
    }

    /// Gives up requests past their time limit. Returns true if there was one.
    fn give_up(&mut self, now: Nanos) -> bool {
        let expired = self
            .open
            .partition_point(|&(_, since)| now.since(since) > ANSWER_TIMEOUT);
        self.open.drain(..expired);
        self.given_up += expired as u32;
        expired > 0
    }
}

/// Silence after which an incomplete frame is discarded.
const FRAME_GAP_TIMEOUT: Nanos = Nanos::from_millis(10);

/// Maximum number of open requests of the host on USB.
const WINDOW: u32 = 3;

/// A host at the serial port, with several open requests.
#[derive(Debug, Default)]
pub struct UsbHost {
    /// Requests and answers.
    pub tracker: RequestTracker,
    decoder: Decoder<Ling, MAX_FRAME>,
    /// The time of the last received bytes.
    last_rx: Nanos,
    /// Received bytes.
    pub bytes: u32,
    /// Received bytes outside frames.
    pub noise_bytes: u32,
    /// True if requests are made regardless of the number of open ones.
    pub ignores_window: bool,
}

impl UsbHost {
    /// Gives up all open requests after the port was closed.
    pub fn on_closed(&mut self) {
        self.tracker.given_up += self.tracker.open.len() as u32;
        self.tracker.open.clear();
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

    /// Reads answers and makes new requests, if the port is open.
    fn poll<A: Arm>(&mut self, board: &mut VirtualBoard<A>) {
        if !board.usb().is_open() {
            return;
        }
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
            // An apparent start of a frame may delay the answers behind it.
            self.decoder.idle();
            self.decode();
        }
        // The window varies.
        let window = 1 + self.tracker.answered % WINDOW;
        while !self.tracker.paused
            && (self.ignores_window && board.usb().unsent() == 0 || (self.tracker.open.len() as u32) < window)
        {
            self.request_burst(board, 1);
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
#[derive(Debug, Default)]
pub struct CanHost {
    program: CanProgram,
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
    /// The number of polls answered before that of the last sample.
    pub newest: Option<u32>,
    /// Complete samples.
    pub samples: u32,
    /// Samples after a gap, and answers of the arm that were repeated or out of order.
    pub gaps: u32,
}

impl Telemetry {
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
    /// True if a request of several frames is being sent.
    pub fn is_sending(&self) -> bool {
        self.program.endpoint.is_sending()
    }

    /// Handles the bus and makes new requests.
    fn poll<A: Arm>(&mut self, board: &mut VirtualBoard<A>) {
        let now = board.now().instant();
        let frames = board.can().read();
        if self.hangs {
            return;
        }
        for frame in frames {
            match Function::of(frame.id()) {
                Some((Function::ArmAnswer, _)) => {
                    let events = self.program.endpoint.receive(frame.data(), now);
                    self.record_failures(events);
                }
                Some((Function::JointsA | Function::JointsB | Function::State, _)) => self.telemetry.on_frame(frame),
                Some((Function::Event, _)) => self.can_events.extend(event_from_frame(&frame).map(|(_, event)| event)),
                _ => {}
            }
            if let Some(answer) = self.program.endpoint.received() {
                self.tracker.on_answer(answer);
                self.program.endpoint.release();
            }
        }
        let events = self.program.endpoint.tick(now);
        self.record_failures(events);
        if self.tracker.give_up(board.now()) && self.aborts {
            self.program.endpoint.abort();
        }
        if !self.is_sending() {
            if let Some(order) = self.orders.pop_front() {
                self.program.send(&order);
            } else if !self.tracker.paused && self.tracker.is_done() {
                self.program.send(&self.tracker.next_request(board.now()));
            }
        }
        self.program.transmit(board);
    }

    fn record_failures(&mut self, events: isotp::Events) {
        for event in events {
            if let isotp::Event::Failed(error) = event {
                self.failures.push(error);
            }
        }
    }
}

/// A program at the control interface with a subscription to all events.
#[derive(Debug, Default)]
pub struct Subscriber {
    /// The interface.
    pub control: Control,
    /// Frames of the arm: the initiator of the request, `None` for an unsolicited frame, and the length in bytes.
    pub frames: Vec<(Option<Initiator>, u32)>,
    last: Stamp,
    /// Frames with an earlier stamp than the frame before.
    pub disorder: u32,
    /// All other events.
    pub events: Vec<(Stamp, Event)>,
}

impl Subscriber {
    /// Opens the interface and subscribes. The records are kept.
    ///
    /// # Panics
    ///
    /// See [`Control::open`] and [`Control::subscribe`].
    pub fn open<A: Arm>(&mut self, board: &mut VirtualBoard<A>) {
        self.control = Control::open(board);
        self.control.subscribe(board);
    }

    /// Clears the records.
    pub fn forget(&mut self) {
        *self = Self {
            control: std::mem::take(&mut self.control),
            ..Self::default()
        };
    }

    /// Reads events, if the interface is open.
    fn poll<A: Arm>(&mut self, board: &mut VirtualBoard<A>) {
        for (at, event) in self.control.take_events(board) {
            match event {
                Event::Frame { initiator, bytes } => {
                    self.frames.push((initiator, bytes.len() as u32));
                    self.disorder += u32::from(at < self.last);
                    self.last = at;
                }
                other => self.events.push((at, other)),
            }
        }
    }

    /// Number of frames for `initiator`, or of unsolicited frames.
    pub fn frames_for(&self, initiator: Option<Initiator>) -> u32 {
        self.frames.iter().filter(|frame| frame.0 == initiator).count() as u32
    }

    /// Bytes of all frames.
    pub fn frame_bytes(&self) -> u32 {
        self.frames.iter().map(|frame| frame.1).sum()
    }
}

/// All hosts. A host without a connection does nothing.
#[derive(Debug, Default)]
pub struct Hosts {
    /// The host at the serial port.
    pub usb: UsbHost,
    /// The host on the bus.
    pub can: CanHost,
    /// The program at the control interface.
    pub subscriber: Subscriber,
}

impl Hosts {
    /// Connects all hosts to the board.
    ///
    /// # Panics
    ///
    /// See [`plug_in`] and [`Subscriber::open`].
    pub fn connect<A: Arm>(board: &mut VirtualBoard<A>) -> Self {
        plug_in(board, MEGABAUD);
        board.can().attach(BIT_RATE);
        let mut hosts = Self::default();
        hosts.usb.tracker.initiator = USB;
        hosts.can.tracker.initiator = CAN;
        // A host on a bus without an adapter has nothing to do.
        hosts.can.hangs = !facts(board.chip()).can;
        hosts.subscriber.open(board);
        hosts
    }

    /// The requests of the host on USB and of the host on CAN.
    pub fn trackers(&self) -> [&RequestTracker; 2] {
        [&self.usb.tracker, &self.can.tracker]
    }

    /// Pauses or resumes new requests.
    pub fn set_paused(&mut self, paused: bool) {
        self.usb.tracker.paused = paused;
        self.can.tracker.paused = paused;
    }

    /// True if no host waits for an answer.
    pub fn is_done(&self) -> bool {
        self.usb.tracker.is_done() && (self.can.hangs || self.can.tracker.is_done())
    }

    /// Polls each host.
    pub fn poll<A: Arm>(&mut self, board: &mut VirtualBoard<A>) {
        self.usb.poll(board);
        self.can.poll(board);
        self.subscriber.poll(board);
    }
}

/// Runs the board until a host on USB or CAN has unread data, for at most `limit`.
///
/// # Errors
///
/// If the firmware crashes or the power fails.
pub fn run_until_unread<A: Arm>(board: &mut VirtualBoard<A>, limit: Nanos) -> Result<(), Error> {
    match board.run_until(limit, |board| board.usb().unread() > 0 || board.can().unread() > 0) {
        // Unread data without a reader does not end the wait.
        Ok(Nanos(0)) => board.run_for(FINE_POLL_PERIOD.min(limit)),
        Ok(_) | Err(Error::TimedOut { .. }) => Ok(()),
        Err(error) => Err(error),
    }
}
