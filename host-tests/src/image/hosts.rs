//! Everybody who can use the arm at once: a host on USB, a host on CAN, and a subscriber at the control interface.
//!
//! Nothing here panics because of what the adapter does to them: they keep what they saw, for tests to judge.

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

/// How long nobody looks at most, if nothing comes.
const POLL_PERIOD: Nanos = Nanos(250_000);

/// How long a host waits for an answer before it gives up: longer than the adapter does.
const ANSWER_TIMEOUT: Nanos = Nanos::from_millis(150);

/// One who asks the arm with tickets, and looks at every answer.
#[derive(Debug)]
pub struct RequestTracker {
    initiator: u8,
    next: u32,
    open: VecDeque<(u32, Nanos)>,
    /// How many requests of anybody the arm had answered before that whose answer came last.
    place: Option<u32>,
    /// The request whose answer came last.
    last: Option<u32>,
    /// Whether there are to be more requests.
    pub enabled: bool,
    /// Requests whose answer came, in the order of the requests.
    pub answered: u32,
    /// Requests that were given up.
    pub given_up: u32,
    /// Frames that came and answered nothing that was open.
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

    /// Requests made so far.
    pub fn issued(&self) -> u32 {
        self.next
    }

    /// Whether no answer is waited for.
    pub fn is_done(&self) -> bool {
        self.open.is_empty()
    }

    /// Who asks, as in a [`Ticket`].
    pub fn initiator(&self) -> u8 {
        self.initiator
    }

    /// The number of the request whose answer came last.
    pub fn last_answered(&self) -> Option<u32> {
        self.last
    }

    /// Gives up what is open.
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

    fn hear(&mut self, answer: &[u8]) {
        let open = Ticket::of_answer(answer).and_then(|(ticket, place)| {
            let mine = ticket.initiator == self.initiator && Some(place) > self.place;
            let nth = self.open.iter().position(|&(number, _)| number == ticket.number);
            nth.filter(|_| mine).map(|nth| (nth, place))
        });
        match open {
            // The arm answers in order: those before get no answer any more.
            Some((nth, place)) => {
                self.last = self.open.drain(..=nth).next_back().map(|(number, _)| number);
                self.answered += 1;
                self.given_up += nth as u32;
                self.place = Some(place);
            }
            None => self.strays.push(answer.to_vec()),
        }
    }

    /// Gives up what is open for too long, and returns whether anything was.
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

/// After how long without a byte no more of a frame comes.
const FRAME_GAP_TIMEOUT: Nanos = Nanos::from_millis(10);

/// Requests of the host on USB that are open at once, at most.
const WINDOW: u32 = 3;

/// A host at the serial port. It asks before it has the answers to the last requests.
#[derive(Debug)]
pub struct UsbHost {
    /// What it asks and gets.
    pub tracker: RequestTracker,
    decoder: Decoder<MAX_FRAME>,
    /// When bytes last came.
    last_rx: Nanos,
    /// Bytes that came.
    pub bytes: u32,
    /// Those among them that were in no frame.
    pub noise_bytes: u32,
    /// Whether it asks on, however few answers come.
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
    /// The port was opened anew: what was open is given up.
    pub fn reopened(&mut self) {
        self.tracker.abandon();
        self.decoder = Decoder::new();
    }

    /// Asks for so many answers at once, in as few packets as they fit in. The port must be open.
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

    /// Reads answers and asks anew. The port must be open.
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
            // What looks like the beginning of a frame may hold back the answers behind it.
            self.decoder.idle();
            self.decode();
        }
        // Now more, now fewer at a time.
        let window = 1 + self.tracker.answered % WINDOW;
        while self.tracker.enabled
            && (self.ignores_window && board.usb().unsent() == 0 || (self.tracker.open.len() as u32) < window)
        {
            let request = self.tracker.next_request(board.now());
            board.usb().write(&request).unwrap();
        }
    }

    /// Takes what has come whole.
    fn decode(&mut self) {
        while let Some(item) = self.decoder.next(&Ling, ()) {
            match item.kind {
                Kind::Frame => self.tracker.hear(item.bytes),
                _ => self.noise_bytes += item.bytes.len() as u32,
            }
        }
    }
}

/// A host on the CAN bus, with one connection for requests, which also reads what the adapter says by the way.
#[derive(Debug)]
pub struct CanHost {
    node: Node,
    endpoint: Endpoint<MAX_FRAME, MAX_FRAME>,
    /// What it asks and gets.
    pub tracker: RequestTracker,
    /// Whether it does nothing at all: frames for it are lost, and it gives no flow control.
    pub hangs: bool,
    /// Whether it stops sending what it has given up.
    pub aborts: bool,
    /// Frames for the arm that go before all tickets, and are not answered.
    pub orders: VecDeque<Vec<u8>>,
    /// Transfers that failed.
    pub failures: Vec<isotp::Error>,
    /// What it was told in plain frames.
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
    /// Samples that came whole.
    pub samples: u32,
    /// Samples before which one is missing, and answers of the arm that came twice or in the wrong order.
    pub gaps: u32,
}

impl Telemetry {
    /// How many polls the arm had answered before that of the last sample.
    pub fn newest(&self) -> Option<u32> {
        self.newest
    }

    fn hear(&mut self, frame: CanFrame) {
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
    /// A host that talks to this node. The bus must have somebody on it.
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

    /// Whether a request of several frames is on its way.
    pub fn is_sending(&self) -> bool {
        self.endpoint.is_sending()
    }

    /// Does what is due on the bus and asks anew.
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
                Some((Function::JointsA | Function::JointsB | Function::State, _)) => self.telemetry.hear(frame),
                Some((Function::Event, _)) => self.can_events.extend(event_from_frame(&frame).map(|(_, event)| event)),
                _ => {}
            }
            if let Some(answer) = self.endpoint.received() {
                self.tracker.hear(answer);
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

/// Those who ask, and nobody.
const INITIATORS: usize = 6;

fn place(initiator: Option<Initiator>) -> usize {
    initiator.map_or(INITIATORS - 1, |initiator| initiator as usize)
}

/// A program at the control interface that is told of everything.
#[derive(Debug)]
pub struct Subscriber {
    /// The interface.
    pub control: Control,
    /// Frames of the arm, by who had asked for them.
    frames: [u32; INITIATORS],
    /// Bytes in these.
    pub frame_bytes: u32,
    bytes: [u32; INITIATORS],
    last: Stamp,
    /// Frames with a stamp before that of the one before.
    pub disorder: u32,
    /// All other events.
    pub events: Vec<(Stamp, Event)>,
}

impl Subscriber {
    /// Opens the interface and subscribes.
    ///
    /// # Panics
    ///
    /// As [`Control::open`] and [`Control::subscribe`].
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

    /// The interface went with the device. What it was told of is kept.
    pub fn away(mut self) -> Self {
        self.control = Control::default();
        self
    }

    /// Opens the interface anew and subscribes.
    ///
    /// # Panics
    ///
    /// As [`open`](Self::open).
    pub fn reopen<A: Arm>(&mut self, board: &mut VirtualBoard<A>) {
        self.control = Control::open(board);
        self.control.subscribe(board);
    }

    /// Forgets what it was told of.
    pub fn forget(&mut self) {
        self.frames = [0; INITIATORS];
        self.frame_bytes = 0;
        self.bytes = [0; INITIATORS];
        self.events.clear();
        (self.last, self.disorder) = (Stamp(0), 0);
    }

    /// Takes what it is told.
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

    /// How many frames it was told of.
    pub fn all_frames(&self) -> u32 {
        self.frames.iter().sum()
    }

    /// How many bytes were in the frames that `initiator` had asked for, or nobody.
    pub fn bytes(&self, initiator: Option<Initiator>) -> u32 {
        self.bytes[place(initiator)]
    }

    /// How many frames of the arm `initiator` had asked for, or nobody.
    pub fn frames(&self, initiator: Option<Initiator>) -> u32 {
        self.frames[place(initiator)]
    }
}

/// All of them. One who is not there does nothing.
#[derive(Debug, Default)]
pub struct Hosts {
    /// At the serial port.
    pub usb: Option<UsbHost>,
    /// On the bus.
    pub can: Option<CanHost>,
    /// At the control interface.
    pub subscriber: Option<Subscriber>,
}

impl Hosts {
    /// Lets them work until `done` says so.
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
            assert!(board.now() < end, "it is not done after {limit}");
        }
    }

    /// Lets them work for `span`.
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

    /// Lets those who are there get what they have asked for, and nobody asks any more.
    ///
    /// # Panics
    ///
    /// If the firmware crashes, or somebody still waits after longer than anybody waits.
    pub fn finish<A: Arm>(&mut self, board: &mut VirtualBoard<A>) {
        self.set_requesting(false);
        self.run_until(board, Nanos(2 * ANSWER_TIMEOUT.0), |hosts, _| hosts.is_done());
        // What is still to come is on its way.
        self.run_for(board, Nanos::from_millis(20));
    }

    /// Whether those who are there ask for more.
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

    /// Everybody does what they have to do now, then the board runs until there may be more.
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
