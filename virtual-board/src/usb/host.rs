//! The host controller: frames, transactions and transfers on the wire (USB 2.0, chapters 5, 8 and 11).
//!
//! It has no clock. [`Host::poll`] executes the due events and returns the time of its next call. The owner of the
//! device also calls it after every change in the device.
//!
//! A host polls an idle endpoint continuously. These tokens would take most of the simulation time, and their NAKs
//! change nothing. The host therefore sends a token only once the endpoint is [`ready`](Function::ready), at the
//! instant at which its polling would have sent it: every [`Host::poll_interval`] since the last use of the wire.

use std::collections::{BTreeMap, VecDeque};

use super::descriptor::{Endpoint, Transfer};
use super::timing::{self, GUARD, HANDSHAKE, RESET, RESUME, SUSPEND, TIMEOUT, TOKEN, TURNAROUND};
use super::{Direction, Function, Handshake, Reply};
use crate::time::Nanos;

/// Number of attempts of an unanswered transaction (USB 2.0, 10.2.6).
const ATTEMPTS: u8 = 3;

/// A control transfer: the setup packet, and its data.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Request {
    setup: [u8; 8],
    data: Vec<u8>,
}

impl Request {
    /// A request that sends `data`, which may be empty. It is limited to 65535 bytes.
    pub fn write(kind: u8, request: u8, value: u16, index: u16, mut data: Vec<u8>) -> Self {
        data.truncate(usize::from(u16::MAX));
        let length = u16::try_from(data.len()).unwrap_or(u16::MAX);
        Self::new(kind, request, value, index, length, data)
    }

    /// A request that reads at most `length` bytes.
    pub fn read(kind: u8, request: u8, value: u16, index: u16, length: u16) -> Self {
        Self::new(kind, request, value, index, length, Vec::new())
    }

    fn new(kind: u8, request: u8, value: u16, index: u16, length: u16, data: Vec<u8>) -> Self {
        let [value0, value1] = value.to_le_bytes();
        let [index0, index1] = index.to_le_bytes();
        let [length0, length1] = length.to_le_bytes();
        Self {
            setup: [kind, request, value0, value1, index0, index1, length0, length1],
            data,
        }
    }

    /// The setup packet (USB 2.0, 9.3).
    pub const fn setup(&self) -> [u8; 8] {
        self.setup
    }

    fn reads(&self) -> bool {
        self.setup[0] & 0x80 != 0
    }

    fn length(&self) -> usize {
        usize::from(u16::from_le_bytes([self.setup[6], self.setup[7]]))
    }
}

/// The error of a transfer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TransferError {
    /// The device stalled.
    #[error("the device stalled")]
    Stalled,
    /// No answer, three times.
    #[error("the device did not answer")]
    NoResponse,
    /// The device is disconnected, or the bus was reset meanwhile.
    #[error("the device is gone")]
    Disconnected,
    /// It did not complete within the caller's time limit.
    #[error("the device answered NAK for too long")]
    TimedOut,
}

/// An acknowledged data packet, on any endpoint except 0.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Packet {
    /// The endpoint's number.
    pub endpoint: u8,
    /// Its direction.
    pub direction: Direction,
    /// Start of its token.
    pub start: Nanos,
    /// End of its handshake.
    pub end: Nanos,
    /// Time at which the firmware had it ready. `None` for an OUT packet.
    pub armed: Option<Nanos>,
    /// Its data.
    pub data: Vec<u8>,
}

/// The state of the wire.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Link {
    /// Idle: no cable, no reset yet, or suspended.
    Quiet { since: Nanos, suspended: bool },
    /// The host holds the bus in reset.
    Reset { ends: Nanos },
    /// The host drives resume.
    Resume { ends: Nanos },
    /// A start of frame every millisecond.
    Running { next_frame: Nanos },
}

/// The program's request for the wire.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum BusRequest {
    Reset,
    Suspend,
    Resume,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    Setup,
    Data,
    Status,
}

/// The present control transfer.
#[derive(Debug)]
struct Control {
    address: u8,
    packet: usize,
    request: Request,
    stage: Stage,
    sent: usize,
    received: Vec<u8>,
    toggle: bool,
    attempts: u8,
    /// The program abandoned it during a transaction, which continues to its end.
    abandoned: bool,
}

impl Control {
    /// The direction of its present stage.
    fn direction(&self) -> Direction {
        let reads = match self.stage {
            Stage::Setup => false,
            Stage::Data => self.request.reads(),
            // The status stage has the opposite direction; without a data stage, it comes from the device (8.5.3).
            Stage::Status => !self.request.reads() || self.request.length() == 0,
        };
        if reads { Direction::In } else { Direction::Out }
    }

    /// The data of its next OUT packet.
    fn output(&self) -> Vec<u8> {
        match self.stage {
            Stage::Data => self.request.data[self.sent..]
                .iter()
                .copied()
                .take(self.packet)
                .collect(),
            Stage::Setup | Stage::Status => Vec::new(),
        }
    }
}

/// One direction of an open endpoint.
#[derive(Debug, Default)]
struct Pipe {
    address: u8,
    packet: usize,
    toggle: bool,
    /// Frames between two polls, for an interrupt endpoint.
    interval: Option<u16>,
    /// True if an interrupt endpoint was ready when it was polled in this frame.
    due: bool,
    /// Packets to send.
    outbox: VecDeque<Vec<u8>>,
    /// True if IN tokens are sent.
    reading: bool,
    /// True while no token is sent, because a request in progress changes the endpoint.
    paused: bool,
    /// Received bytes that were not read yet.
    inbox: VecDeque<u8>,
    /// Number of further transactions that end in a NAK, independent of the device.
    naks: u32,
    attempts: u8,
    failed: Option<TransferError>,
}

/// The purpose of a transaction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Job {
    Control,
    Pipe(u8, Direction),
}

/// The device's answer.
#[derive(Debug)]
enum Answer {
    Done,
    Data { toggle: bool, bytes: Vec<u8>, armed: Nanos },
    Nak,
    Stall,
    NoResponse,
}

/// A transaction on the wire.
#[derive(Debug)]
struct Transaction {
    job: Job,
    start: Nanos,
    phase: Phase,
}

#[derive(Debug)]
enum Phase {
    /// The device answers at this instant.
    Answer(Nanos),
    /// The wire is free again at this instant.
    Close(Nanos, Answer),
}

/// The host and its one root port.
#[derive(Debug)]
pub struct Host {
    /// The polling interval of an idle endpoint, after the last use of the wire and after each poll.
    ///
    /// An idle host controller polls almost at once: a NAKed IN takes 5.1 us on the wire.
    pub poll_interval: Nanos,
    cable: bool,
    powered: bool,
    connected: bool,
    bus_request: Option<BusRequest>,
    link: Link,
    frame: u16,
    /// The time from which the wire is free.
    free: Nanos,
    transaction: Option<Transaction>,
    control: Option<Control>,
    /// The control transfer that begins once the abandoned one is off the wire.
    next_control: Option<Control>,
    result: Option<Result<Vec<u8>, TransferError>>,
    pipes: BTreeMap<(u8, Direction), Pipe>,
    /// The last pipe on the wire: pipes take turns.
    last: (u8, Direction),
    packets: Vec<Packet>,
    epoch: u64,
    progress: bool,
}

impl Default for Host {
    fn default() -> Self {
        Self {
            poll_interval: Nanos(8_000),
            cable: false,
            powered: false,
            connected: false,
            bus_request: None,
            link: Link::Quiet {
                since: Nanos(0),
                suspended: true,
            },
            frame: 0,
            free: Nanos(0),
            transaction: None,
            control: None,
            next_control: None,
            result: None,
            pipes: BTreeMap::new(),
            last: (0, Direction::Out),
            packets: Vec::new(),
            epoch: 0,
            progress: false,
        }
    }
}

/// The program's interface. Changes take effect at the next [`poll`](Host::poll).
impl Host {
    /// Plugs the cable in or out.
    pub fn set_cable(&mut self, plugged: bool) {
        self.cable = plugged;
    }

    /// Returns true if a device is connected: the cable is plugged in and D+ is pulled up.
    pub fn connected(&self) -> bool {
        self.connected
    }

    /// Returns true while frames are sent, and no [reset](Self::reset), suspend or resume is requested.
    pub fn running(&self) -> bool {
        self.bus_request.is_none() && matches!(self.link, Link::Running { .. })
    }

    /// A number that changes with every connect, disconnect or reset: state of the device is then outdated.
    pub fn epoch(&self) -> u64 {
        self.epoch
    }

    /// Resets the bus. All pipes close.
    pub fn reset(&mut self) {
        self.bus_request = Some(BusRequest::Reset);
    }

    /// Stops the frames: the device suspends after 3 ms.
    pub fn suspend(&mut self) {
        self.bus_request = Some(BusRequest::Suspend);
    }

    /// Wakes a suspended bus.
    pub fn resume(&mut self) {
        self.bus_request = Some(BusRequest::Resume);
    }

    /// Starts a control transfer with the device at `address`, whose endpoint 0 has packets of `packet` bytes. A
    /// transfer in progress is abandoned.
    pub fn start_control(&mut self, address: u8, packet: u8, request: Request) {
        self.abandon_control();
        self.result = None;
        let control = Control {
            address,
            packet: usize::from(packet.max(8)),
            request,
            stage: Stage::Setup,
            sent: 0,
            received: Vec::new(),
            toggle: true,
            attempts: 0,
            abandoned: false,
        };
        if self.control.is_some() {
            self.next_control = Some(control);
        } else {
            self.control = Some(control);
        }
    }

    /// Abandons the control transfer in progress. A transaction on the wire continues to its end.
    pub fn abandon_control(&mut self) {
        self.next_control = None;
        let is_on_the_wire = self.transaction.as_ref().is_some_and(|one| one.job == Job::Control);
        match &mut self.control {
            Some(control) if is_on_the_wire => control.abandoned = true,
            control => *control = None,
        }
    }

    /// The result of the last control transfer, returned once: the bytes sent by the device.
    pub fn take_control(&mut self) -> Option<Result<Vec<u8>, TransferError>> {
        self.result.take()
    }

    /// Opens `endpoint` of the device at `address`. An IN endpoint is polled from now on.
    pub fn open(&mut self, address: u8, endpoint: Endpoint) {
        let interrupt = endpoint.transfer == Transfer::Interrupt;
        self.pipes.insert(
            (endpoint.number, endpoint.direction),
            Pipe {
                address,
                packet: usize::from(endpoint.packet.max(1)),
                interval: interrupt.then(|| u16::from(endpoint.interval.max(1))),
                reading: true,
                ..Pipe::default()
            },
        );
    }

    /// Returns true if a direction of `endpoint` is open: there was no reset or disconnect since.
    pub fn is_open(&self, endpoint: u8, direction: Direction) -> bool {
        self.pipes.contains_key(&(endpoint, direction))
    }

    /// Queues `bytes` for OUT `endpoint`, in packets of its maximum size. Returns false if it is not open.
    pub fn write(&mut self, endpoint: u8, bytes: &[u8]) -> bool {
        let Some(pipe) = self.pipes.get_mut(&(endpoint, Direction::Out)) else {
            return false;
        };
        pipe.outbox.extend(bytes.chunks(pipe.packet).map(<[u8]>::to_vec));
        true
    }

    /// Number of bytes queued for OUT `endpoint`.
    pub fn unsent(&self, endpoint: u8) -> usize {
        let pipe = self.pipes.get(&(endpoint, Direction::Out));
        pipe.map_or(0, |pipe| pipe.outbox.iter().map(Vec::len).sum())
    }

    /// Takes the bytes received from IN `endpoint`.
    pub fn read(&mut self, endpoint: u8) -> Vec<u8> {
        let pipe = self.pipes.get_mut(&(endpoint, Direction::In));
        pipe.map_or_else(Vec::new, |pipe| pipe.inbox.drain(..).collect())
    }

    /// Number of bytes received from IN `endpoint` that were not read yet.
    pub fn unread(&self, endpoint: u8) -> usize {
        self.pipes
            .get(&(endpoint, Direction::In))
            .map_or(0, |pipe| pipe.inbox.len())
    }

    /// Enables IN tokens to `endpoint`. A host stops them if its program does not read.
    pub fn set_reading(&mut self, endpoint: u8, reading: bool) {
        if let Some(pipe) = self.pipes.get_mut(&(endpoint, Direction::In)) {
            pipe.reading = reading;
        }
    }

    /// Ends the next `count` transactions with an endpoint in a NAK, independent of the device.
    pub fn inject_naks(&mut self, endpoint: u8, direction: Direction, count: u32) {
        if let Some(pipe) = self.pipes.get_mut(&(endpoint, direction)) {
            pipe.naks += count;
        }
    }

    /// Stops tokens to an endpoint until it is started again, because a request that changes it is pending.
    pub fn pause(&mut self, endpoint: u8, direction: Direction) {
        if let Some(pipe) = self.pipes.get_mut(&(endpoint, direction)) {
            pipe.paused = true;
        }
    }

    /// Serves an endpoint again after a request that reset it to DATA0 (USB 2.0, 9.1.1.5, 9.4.5, 9.4.10).
    pub fn start_anew(&mut self, endpoint: u8, direction: Direction) {
        if let Some(pipe) = self.pipes.get_mut(&(endpoint, direction)) {
            pipe.paused = false;
            pipe.toggle = false;
            pipe.failed = None;
        }
    }

    /// The open endpoints.
    pub fn open_endpoints(&self) -> Vec<(u8, Direction)> {
        self.pipes.keys().copied().collect()
    }

    /// The data toggle of an open endpoint: true for DATA1.
    pub fn toggle(&self, endpoint: u8, direction: Direction) -> Option<bool> {
        self.pipes.get(&(endpoint, direction)).map(|pipe| pipe.toggle)
    }

    /// The reason why an endpoint is no longer served, if any.
    pub fn failure(&self, endpoint: u8, direction: Direction) -> Option<TransferError> {
        self.pipes.get(&(endpoint, direction)).and_then(|pipe| pipe.failed)
    }

    /// Every packet since the beginning, in order.
    pub fn packets(&self) -> &[Packet] {
        &self.packets
    }

    /// Clears the record of packets.
    pub fn forget_packets(&mut self) {
        self.packets.clear();
    }

    /// Returns true if an event that a program may wait for occurred since the last call: the end of a transfer, a
    /// packet, a connect or disconnect, the end of a reset or resume.
    pub fn take_progress(&mut self) -> bool {
        std::mem::take(&mut self.progress)
    }
}

/// Events on the wire.
impl Host {
    /// Executes the events due by `now`. Returns the latest time of the next call.
    pub fn poll(&mut self, now: Nanos, device: &mut dyn Function) -> Option<Nanos> {
        self.sense(now, device);
        loop {
            let due = self.due(now, device)?;
            if due > now {
                return Some(due);
            }
            self.step(now, device);
        }
    }

    /// Handles the cable, the pull-up and the program's requests.
    fn sense(&mut self, now: Nanos, device: &mut dyn Function) {
        if self.cable != self.powered {
            self.powered = self.cable;
            device.power(self.powered);
        }
        let connected = self.powered && device.pulls_up();
        if connected != self.connected {
            self.connected = connected;
            self.close(TransferError::Disconnected);
            self.quiet(now);
            self.progress = true;
        }
        match self.bus_request.take() {
            Some(BusRequest::Reset) if connected => {
                self.close(TransferError::Disconnected);
                device.reset();
                self.link = Link::Reset { ends: now + RESET };
            }
            Some(BusRequest::Suspend) if self.running() => self.quiet(now),
            Some(BusRequest::Resume) if connected => {
                device.resume();
                self.link = Link::Resume { ends: now + RESUME };
            }
            _ => {}
        }
    }

    fn quiet(&mut self, since: Nanos) {
        self.transaction = None;
        self.link = Link::Quiet {
            since,
            suspended: false,
        };
    }

    /// Ends every transfer and closes every endpoint.
    fn close(&mut self, error: TransferError) {
        self.epoch += 1;
        self.transaction = None;
        self.pipes.clear();
        let control = self.control.take().filter(|control| !control.abandoned);
        if control.or(self.next_control.take()).is_some() {
            self.result = Some(Err(error));
        }
    }

    /// The time of the next event.
    fn due(&self, now: Nanos, device: &dyn Function) -> Option<Nanos> {
        match self.link {
            Link::Quiet { since, suspended } => (!suspended).then(|| since + SUSPEND),
            Link::Reset { ends } | Link::Resume { ends } => Some(ends),
            Link::Running { next_frame } => {
                let wire = match &self.transaction {
                    Some(transaction) => match transaction.phase {
                        Phase::Answer(at) | Phase::Close(at, _) => Some(at),
                    },
                    None => self.pick(now, next_frame, device).map(|(start, _)| start),
                };
                Some(wire.map_or(next_frame, |at| at.min(next_frame)))
            }
        }
    }

    fn step(&mut self, now: Nanos, device: &mut dyn Function) {
        match self.link {
            Link::Quiet { since, .. } => {
                self.link = Link::Quiet { since, suspended: true };
                device.suspend();
            }
            Link::Reset { ends } => {
                device.reset_done();
                self.link = Link::Running { next_frame: ends };
                self.progress = true;
            }
            Link::Resume { ends } => {
                self.link = Link::Running { next_frame: ends };
                self.progress = true;
            }
            Link::Running { next_frame } => match self.transaction.take() {
                Some(transaction) => self.carry_on(transaction, device),
                None => match self.pick(now, next_frame, device) {
                    Some((start, job)) if start < next_frame => self.begin(start, job),
                    _ => self.begin_frame(next_frame, device),
                },
            },
        }
    }

    fn begin_frame(&mut self, at: Nanos, device: &mut dyn Function) {
        self.frame = (self.frame + 1) & 0x7FF;
        self.free = at + TOKEN + TURNAROUND;
        self.link = Link::Running {
            next_frame: at + timing::FRAME,
        };
        device.start_of_frame(self.frame);
        for (&(endpoint, direction), pipe) in &mut self.pipes {
            if let Some(interval) = pipe.interval {
                pipe.due = self.frame.is_multiple_of(interval) && device.ready(endpoint, direction);
            }
        }
    }

    /// The next transaction, and the start of its token.
    fn pick(&self, now: Nanos, next_frame: Nanos, device: &dyn Function) -> Option<(Nanos, Job)> {
        let job = self.pick_job(device)?;
        let polled = !matches!(&self.control, Some(control) if job == Job::Control && control.stage == Stage::Setup);
        // A token in flight when the endpoint becomes ready still finds it ready; but a host sends no token for bytes
        // that it does not have yet.
        let underway = match job {
            Job::Pipe(_, Direction::Out) => Nanos(0),
            Job::Pipe(_, Direction::In) | Job::Control => TOKEN,
        };
        let late = now.since(self.free + underway).0;
        let start = if polled {
            self.free + Nanos(late.div_ceil(self.poll_interval.0.max(1)) * self.poll_interval.0.max(1))
        } else {
            self.free.max(now)
        };
        let fits = start + self.longest(job) + GUARD <= next_frame;
        Some(if fits {
            (start, job)
        } else {
            (next_frame + TOKEN + TURNAROUND, job)
        })
    }

    fn pick_job(&self, device: &dyn Function) -> Option<Job> {
        if let Some(control) = &self.control
            && (control.stage == Stage::Setup || device.ready(0, control.direction()))
        {
            return Some(Job::Control);
        }
        let wants = |(&(endpoint, direction), pipe): (&(u8, Direction), &Pipe)| {
            let busy = match direction {
                Direction::Out => !pipe.outbox.is_empty(),
                Direction::In => pipe.reading,
            };
            let turn = pipe.interval.is_none() || pipe.due;
            (pipe.failed.is_none() && !pipe.paused && busy && turn && device.ready(endpoint, direction))
                .then_some(Job::Pipe(endpoint, direction))
        };
        let (after, before) = (
            self.pipes
                .range((std::ops::Bound::Excluded(self.last), std::ops::Bound::Unbounded)),
            self.pipes.range(..=self.last),
        );
        after.chain(before).find_map(wants)
    }

    /// The maximum duration of a transaction of `job`.
    fn longest(&self, job: Job) -> Nanos {
        let packet = match job {
            Job::Control => self.control.as_ref().map_or(0, |control| control.packet),
            Job::Pipe(endpoint, direction) => self.pipes.get(&(endpoint, direction)).map_or(0, |pipe| pipe.packet),
        };
        TOKEN + TURNAROUND + timing::data(packet) + TURNAROUND + HANDSHAKE
    }

    fn begin(&mut self, start: Nanos, job: Job) {
        let sent = match job {
            Job::Control => self.control.as_ref().and_then(|control| match control.direction() {
                Direction::Out if control.stage == Stage::Setup => Some(control.request.setup.len()),
                Direction::Out => Some(control.output().len()),
                Direction::In => None,
            }),
            Job::Pipe(endpoint, direction) => {
                self.last = (endpoint, direction);
                let pipe = self
                    .pipes
                    .get(&(endpoint, Direction::Out))
                    .filter(|_| direction == Direction::Out);
                pipe.and_then(|pipe| pipe.outbox.front()).map(Vec::len)
            }
        };
        let answer = start + TOKEN + TURNAROUND + sent.map_or(Nanos(0), timing::data);
        self.transaction = Some(Transaction {
            job,
            start,
            phase: Phase::Answer(answer),
        });
    }

    fn carry_on(&mut self, transaction: Transaction, device: &mut dyn Function) {
        let Transaction { job, start, phase } = transaction;
        match phase {
            Phase::Answer(at) => {
                let answer = match job {
                    Job::Control => self.transact_control(device),
                    Job::Pipe(endpoint, direction) => self.transact_pipe(endpoint, direction, device),
                };
                let Some((direction, answer)) = answer else {
                    // The answer is no longer expected.
                    self.free = at;
                    return;
                };
                let tail = match (direction, &answer) {
                    (_, Answer::NoResponse) => TIMEOUT,
                    (Direction::Out, _) => TURNAROUND + HANDSHAKE,
                    (Direction::In, Answer::Data { bytes, .. }) => timing::data(bytes.len()) + TURNAROUND + HANDSHAKE,
                    (Direction::In, _) => HANDSHAKE,
                };
                self.transaction = Some(Transaction {
                    job,
                    start,
                    phase: Phase::Close(at + tail, answer),
                });
            }
            Phase::Close(at, answer) => {
                self.free = at + TURNAROUND;
                match job {
                    Job::Control => self.close_control(answer, device),
                    Job::Pipe(endpoint, direction) => {
                        self.close_pipe((endpoint, direction), (start, at), answer, device);
                    }
                }
            }
        }
    }

    fn transact_control(&mut self, device: &mut dyn Function) -> Option<(Direction, Answer)> {
        let control = self.control.as_ref()?;
        let direction = control.direction();
        let answer = match (control.stage, direction) {
            (Stage::Setup, _) => {
                if device.setup(control.address, control.request.setup) {
                    Answer::Done
                } else {
                    Answer::NoResponse
                }
            }
            (_, Direction::Out) => output(device, control.address, 0, control.toggle, &control.output()),
            (_, Direction::In) => input(device, control.address, 0),
        };
        Some((direction, answer))
    }

    fn close_control(&mut self, answer: Answer, device: &mut dyn Function) {
        let Some(mut control) = self.control.take() else {
            return;
        };
        if control.abandoned {
            if let Answer::Data { .. } = answer {
                device.acknowledged(0);
            }
            self.control = self.next_control.take();
            return;
        }
        match answer {
            Answer::Nak => {}
            Answer::Stall => return self.finish_control(Err(TransferError::Stalled)),
            Answer::NoResponse => {
                control.attempts += 1;
                if control.attempts == ATTEMPTS {
                    return self.finish_control(Err(TransferError::NoResponse));
                }
            }
            Answer::Done | Answer::Data { .. } => {
                control.attempts = 0;
                let mut last = false;
                if let Answer::Data { toggle, bytes, .. } = answer {
                    device.acknowledged(0);
                    if toggle == control.toggle {
                        last = bytes.len() < control.packet;
                        control.received.extend(bytes);
                        control.toggle = !control.toggle;
                    }
                } else if control.stage == Stage::Data {
                    control.sent += control.output().len();
                    control.toggle = !control.toggle;
                }
                let length = control.request.length();
                control.stage = match control.stage {
                    Stage::Setup if length == 0 => Stage::Status,
                    Stage::Setup => Stage::Data,
                    Stage::Data if last || control.sent.max(control.received.len()) >= length => {
                        control.toggle = true;
                        Stage::Status
                    }
                    Stage::Data => Stage::Data,
                    Stage::Status => return self.finish_control(Ok(control.received)),
                };
            }
        }
        self.control = Some(control);
    }

    fn finish_control(&mut self, result: Result<Vec<u8>, TransferError>) {
        self.result = Some(result);
        self.progress = true;
    }

    fn transact_pipe(
        &mut self,
        endpoint: u8,
        direction: Direction,
        device: &mut dyn Function,
    ) -> Option<(Direction, Answer)> {
        let pipe = self.pipes.get_mut(&(endpoint, direction))?;
        pipe.due = false;
        if pipe.naks > 0 {
            pipe.naks -= 1;
            return Some((direction, Answer::Nak));
        }
        let answer = match direction {
            Direction::Out => output(device, pipe.address, endpoint, pipe.toggle, pipe.outbox.front()?),
            Direction::In => input(device, pipe.address, endpoint),
        };
        Some((direction, answer))
    }

    fn close_pipe(
        &mut self,
        key: (u8, Direction),
        (start, end): (Nanos, Nanos),
        answer: Answer,
        device: &mut dyn Function,
    ) {
        let Some(pipe) = self.pipes.get_mut(&key) else {
            return;
        };
        let (endpoint, direction) = key;
        let (armed, data) = match answer {
            Answer::Nak => return,
            Answer::Stall => {
                pipe.failed = Some(TransferError::Stalled);
                self.progress = true;
                return;
            }
            Answer::NoResponse => {
                pipe.attempts += 1;
                if pipe.attempts == ATTEMPTS {
                    pipe.failed = Some(TransferError::NoResponse);
                    self.progress = true;
                }
                return;
            }
            Answer::Done => (None, pipe.outbox.pop_front().unwrap_or_default()),
            Answer::Data { toggle, bytes, armed } => {
                device.acknowledged(endpoint);
                if toggle != pipe.toggle {
                    // A packet received before: its acknowledgement was lost (8.6.4).
                    return;
                }
                pipe.inbox.extend(&bytes);
                (Some(armed), bytes)
            }
        };
        pipe.toggle = !pipe.toggle;
        pipe.attempts = 0;
        self.progress = true;
        self.packets.push(Packet {
            endpoint,
            direction,
            start,
            end,
            armed,
            data,
        });
    }
}

fn output(device: &mut dyn Function, address: u8, endpoint: u8, toggle: bool, data: &[u8]) -> Answer {
    match device.output(address, endpoint, toggle, data) {
        Handshake::Ack => Answer::Done,
        Handshake::Nak => Answer::Nak,
        Handshake::Stall => Answer::Stall,
        Handshake::NoResponse => Answer::NoResponse,
    }
}

fn input(device: &mut dyn Function, address: u8, endpoint: u8) -> Answer {
    match device.input(address, endpoint) {
        Reply::Data { toggle, bytes, armed } => Answer::Data { toggle, bytes, armed },
        Reply::Nak => Answer::Nak,
        Reply::Stall => Answer::Stall,
        Reply::NoResponse => Answer::NoResponse,
    }
}

#[cfg(test)]
mod tests;
