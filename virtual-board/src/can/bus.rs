//! The wire: arbitration, the outcome of each frame, and its timing (ISO 11898-1).
//!
//! It has no clock. [`Bus::poll`] executes the due events and returns the time of its next call. The owner of the
//! controller also calls it after every change in the controller.
//!
//! | Event | Time |
//! |---|---|
//! | Arbitration: all frames that are ready when the bus becomes free | at the start of frame |
//! | A frame is valid for its receivers | at the last but one bit of its end of frame |
//! | A frame is valid for its sender | at the end of its end of frame |
//! | No acknowledge, a node's error flag, incompatible nominal rates | at the acknowledge slot |
//! | An FD frame at a classic node, incompatible data rates | at the CRC delimiter |
//! | A shorted bus | at the first bit, then at every bit of an active error flag |
//! | The end of a frame with an error | six bits of error flag and eight of delimiter later |
//! | The next frame | three bits later, eight more for an error passive sender |
//!
//! Not modelled: two frames with identical arbitration fields (the board's goes first), and overload frames.

use std::collections::{BTreeMap, VecDeque};

use armwire_sim::can::{
    BitTimes, ERROR_DELIMITER_BITS, ERROR_FLAG_BITS, Frame, INTERMISSION_BITS, OnTheWire, SUSPEND_BITS,
};

use super::node::{Node, NodeConfig, Reception, reception, times};
use super::wait::Wait;
use super::{BusError, Controller, ErrorState, Fault, Outcome, Sender, span};
use crate::time::Nanos;

/// Number of times 11 recessive bits for a recovery from bus-off (ISO 11898-1).
const RECOVERY: u32 = 128;

/// A frame that was on the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Record {
    /// Time of the request to the board's controller.
    pub(crate) requested: Option<Nanos>,
    pub(crate) start: Nanos,
    pub(crate) end: Nanos,
    pub(crate) sender: Sender,
    pub(crate) frame: Frame,
    pub(crate) outcome: Outcome,
}

/// A frame on the bus.
#[derive(Clone, Debug)]
struct Flight {
    sender: Sender,
    frame: Frame,
    requested: Option<Nanos>,
    start: Nanos,
    /// The bit times of its sender.
    times: BitTimes,
    /// Reception by the attached nodes, if there are any.
    attached: Option<Reception>,
    /// Reception by each joined node that takes part.
    joined: Vec<(u8, Reception)>,
    phase: Phase,
}

impl Flight {
    /// The end of its first `bits` bits.
    fn after(&self, bits: u32) -> Nanos {
        self.start + Nanos(self.frame.picoseconds(bits, self.times).div_ceil(1_000))
    }
}

/// The next event of a frame, and its time.
#[derive(Clone, Copy, Debug)]
enum Phase {
    /// The frame is valid for its receivers.
    Valid(Nanos),
    /// An error occurs in the frame.
    Fault(Nanos, FrameError),
    /// The frame ends.
    Close(Nanos, Outcome),
}

#[derive(Clone, Copy, Debug)]
struct FrameError {
    /// The error as seen by the sender.
    error: BusError,
    in_data_phase: bool,
    outcome: Outcome,
}

impl FrameError {
    const fn new(error: BusError, outcome: Outcome) -> Self {
        Self {
            error,
            in_data_phase: false,
            outcome,
        }
    }

    fn to_sender(self) -> Fault {
        Fault {
            error: self.error,
            in_data_phase: self.in_data_phase,
            is_own: true,
        }
    }

    /// The error as seen by a node with this reception. `None` if it sees none.
    fn to_receiver(self, reception: Reception) -> Option<Fault> {
        let fails = match reception {
            Reception::Ignores => return None,
            Reception::Follows => false,
            Reception::Fails(_) => true,
        };
        Some(Fault {
            error: match self.outcome {
                Outcome::Shorted => self.error,
                _ => BusError::Stuff,
            },
            in_data_phase: self.in_data_phase,
            is_own: match self.outcome {
                Outcome::Garbled => fails,
                Outcome::Destroyed | Outcome::Unacknowledged => false,
                Outcome::Sent | Outcome::Shorted | Outcome::Cut => true,
            },
        })
    }
}

/// A pending frame of another node.
struct Offer {
    sender: Sender,
    frame: Frame,
    times: BitTimes,
    /// The earliest start of its transmission.
    from: Nanos,
}

/// The bus, and the nodes on it.
#[derive(Debug, Default)]
pub(crate) struct Bus {
    /// The configuration of the attached nodes, if there are any.
    attached: Option<NodeConfig>,
    /// True if they do not acknowledge the frames of others.
    withholds_acknowledge: bool,
    shorted: bool,
    /// True while the board's controller is kept out of initialization mode.
    keeps_from_initialization: bool,
    /// Number of the board's next frames that a node destroys.
    failing: u32,
    joined: BTreeMap<u8, Node>,
    /// The queue of each node.
    queues: BTreeMap<u8, VecDeque<Frame>>,
    flood: Option<Frame>,
    /// Frames from the board that the attached nodes received.
    received: VecDeque<Frame>,
    /// The earliest start of a frame, and of a frame of the board.
    free: Nanos,
    free_for_board: Nanos,
    flight: Option<Flight>,
    records: Vec<Record>,
    progress: bool,
}

/// The program's interface. Changes take effect at the next [`poll`](Bus::poll).
impl Bus {
    /// Attaches classic nodes at `rate` bits per second.
    pub(crate) fn attach(&mut self, rate: u32) {
        self.attach_as(NodeConfig::classic(rate));
    }

    /// Attaches nodes of this kind.
    pub(crate) fn attach_as(&mut self, config: NodeConfig) {
        self.attached = Some(config);
    }

    /// Detaches the attached nodes. Their pending frames are dropped.
    pub(crate) fn detach(&mut self) {
        self.attached = None;
        self.queues.retain(|node, _| self.joined.contains_key(node));
        self.flood = None;
    }

    pub(crate) fn is_attached(&self) -> bool {
        self.attached.is_some()
    }

    /// Adds a separate node. It takes part after 11 recessive bits.
    pub(crate) fn join(&mut self, node: u8, config: NodeConfig) {
        let since = self.flight.is_none().then_some(self.free);
        self.joined.insert(node, Node::new(config, since));
    }

    /// Removes a joined node. Its pending and received frames are dropped.
    pub(crate) fn leave(&mut self, node: u8) {
        if self.joined.remove(&node).is_some() {
            self.queues.remove(&node);
        }
    }

    /// The transmit and receive error counters of a joined node, and its state.
    pub(crate) fn errors(&self, node: u8) -> Option<(u32, u32, ErrorState)> {
        let Node { confinement, .. } = self.joined.get(&node)?;
        Some((confinement.transmit(), confinement.receive(), confinement.state()))
    }

    /// Takes the frames that a joined node received.
    pub(crate) fn take_received_by(&mut self, node: u8) -> Vec<Frame> {
        let node = self.joined.get_mut(&node);
        node.map_or_else(Vec::new, |node| node.received.drain(..).collect())
    }

    pub(crate) fn set_acknowledging(&mut self, acknowledging: bool) {
        self.withholds_acknowledge = !acknowledging;
    }

    pub(crate) fn keep_from_initialization(&mut self, keep: bool) {
        self.keeps_from_initialization = keep;
    }

    pub(crate) fn keeps_from_initialization(&self) -> bool {
        self.keeps_from_initialization
    }

    pub(crate) fn set_shorted(&mut self, shorted: bool) {
        self.shorted = shorted;
    }

    pub(crate) fn destroy(&mut self, count: u32) {
        self.failing = count;
    }

    pub(crate) fn set_flood(&mut self, frame: Option<Frame>) {
        self.flood = frame;
    }

    /// Returns true if `node` supports this kind of frame and may send.
    pub(crate) fn can_send(&self, node: u8, frame: &Frame) -> bool {
        match self.joined.get(&node) {
            Some(node) => node.config.sends(frame),
            None => self.attached_can_send(frame),
        }
    }

    /// Returns true if the attached nodes support this kind of frame and may send; without nodes, if the frame is
    /// classic.
    pub(crate) fn attached_can_send(&self, frame: &Frame) -> bool {
        self.attached.map_or(frame.fd.is_none(), |config| config.sends(frame))
    }

    /// Queues a frame of `node`.
    pub(crate) fn send(&mut self, node: u8, frame: Frame) {
        self.queues.entry(node).or_default().push_back(frame);
    }

    /// Number of pending frames of the nodes, including the one on the bus.
    pub(crate) fn unsent(&self) -> usize {
        self.queues.values().map(VecDeque::len).sum()
    }

    /// Number of pending frames of `node`, including the one on the bus.
    pub(crate) fn unsent_by(&self, node: u8) -> usize {
        self.queues.get(&node).map_or(0, VecDeque::len)
    }

    /// Takes the frames that the attached nodes received from the board.
    pub(crate) fn take_received(&mut self) -> Vec<Frame> {
        self.received.drain(..).collect()
    }

    /// Number of received frames of the nodes that were not taken yet.
    pub(crate) fn unread(&self) -> usize {
        self.received.len() + self.joined.values().map(|node| node.received.len()).sum::<usize>()
    }

    pub(crate) fn records(&self) -> &[Record] {
        &self.records
    }

    pub(crate) fn forget_records(&mut self) {
        self.records.clear();
    }

    /// Returns true if a frame ended since the last call.
    pub(crate) fn take_progress(&mut self) -> bool {
        std::mem::take(&mut self.progress)
    }
}

/// Events on the wire.
impl Bus {
    /// Executes the events due by `now`. Returns the latest time of the next call.
    pub(crate) fn poll(&mut self, now: Nanos, controller: &mut dyn Controller) -> Option<Nanos> {
        self.sense(now, controller);
        loop {
            let wire = match &self.flight {
                Some(Flight { phase, .. }) => match *phase {
                    Phase::Valid(at) | Phase::Fault(at, _) | Phase::Close(at, _) => Some(at),
                },
                None => self.next_start(now, controller),
            };
            let waited = self.joined.values().filter_map(Node::due).min();
            let due = [wire, waited, controller.due()].into_iter().flatten().min()?;
            if due > now {
                return Some(due);
            }
            if controller.due() == Some(due) {
                controller.tick();
                continue;
            }
            if waited == Some(due) {
                let over = self.joined.values_mut().filter(|node| node.due() == Some(due));
                over.for_each(Node::waited);
                continue;
            }
            match self.flight.take() {
                Some(flight) => self.carry_on(flight, controller),
                None => self.begin(now, controller),
            }
        }
    }

    /// Aborts a frame whose sender is gone, or on a shorted bus.
    fn sense(&mut self, now: Nanos, controller: &mut dyn Controller) {
        let Some(Flight { sender, phase, .. }) = &self.flight else {
            return;
        };
        let gone = match *sender {
            Sender::Board => !controller.sends(),
            Sender::Node(node) => self.config(node).is_none(),
            Sender::Flood => self.attached.is_none(),
        };
        let frame_error = match *phase {
            Phase::Close(..) => return,
            _ if gone => FrameError::new(BusError::Stuff, Outcome::Cut),
            Phase::Fault(_, frame_error) if frame_error.outcome == Outcome::Shorted => return,
            _ if self.shorted => FrameError::new(BusError::DominantBit, Outcome::Shorted),
            _ => return,
        };
        if let Some(flight) = &mut self.flight {
            flight.phase = Phase::Fault(now, frame_error);
        }
    }

    /// The configuration of a node: joined, or one of the attached.
    fn config(&self, node: u8) -> Option<NodeConfig> {
        self.joined.get(&node).map(|node| node.config).or(self.attached)
    }

    /// The frame that each node would send on a free bus.
    fn offers(&self) -> impl Iterator<Item = Offer> {
        let flood = self.flood.iter().filter_map(|frame| {
            self.attached.filter(|config| config.sends(frame)).map(|config| Offer {
                sender: Sender::Flood,
                frame: *frame,
                times: config.times(),
                from: self.free,
            })
        });
        let queued = self.queues.iter().filter_map(|(&node, queue)| {
            let mut frame = *queue.front()?;
            let config = self.config(node).filter(|config| config.sends(&frame))?;
            let mut from = self.free;
            if let Some(joined) = self.joined.get(&node) {
                if !joined.takes_part() {
                    return None;
                }
                from = from.max(joined.free);
                if let Some(flags) = &mut frame.fd {
                    flags.error_passive |= joined.confinement.state() == ErrorState::Passive;
                }
            }
            Some(Offer {
                sender: Sender::Node(node),
                frame,
                times: config.times(),
                from,
            })
        });
        queued.chain(flood).filter(|_| !self.shorted)
    }

    /// The start of the next frame.
    fn next_start(&self, now: Nanos, controller: &dyn Controller) -> Option<Nanos> {
        let board = controller.offer().map(|_| self.free_for_board.max(self.free));
        let nodes = self.offers().map(|offer| offer.from).min();
        [board, nodes].into_iter().flatten().min().map(|start| start.max(now))
    }

    fn begin(&mut self, now: Nanos, controller: &mut dyn Controller) {
        let board = controller.offer().filter(|_| self.free_for_board <= now);
        let ready = self.offers().filter(|offer| offer.from <= now);
        let nodes = ready.min_by(|a, b| a.frame.arbitrates(&b.frame));
        let nodes_win = |offer: &Offer| board.is_none_or(|own| offer.frame.arbitrates(&own).is_lt());
        let (sender, frame, times) = match (board, nodes.filter(nodes_win)) {
            (own, Some(offer)) => {
                if own.is_some() {
                    controller.lose();
                }
                (offer.sender, offer.frame, offer.times)
            }
            (Some(own), None) => (Sender::Board, own, times(controller.bit(), controller.capability())),
            (None, None) => return,
        };
        controller.begin(sender == Sender::Board);
        for node in self.joined.values_mut() {
            let bit = node.config.bit;
            if let Some(wait) = &mut node.wait {
                wait.begin(now, bit);
            }
        }
        let others = self.joined.iter().filter(|(node, _)| sender != Sender::Node(**node));
        let mut flight = Flight {
            sender,
            frame,
            requested: controller.requested().filter(|_| sender == Sender::Board),
            start: now,
            times,
            attached: self.attached.map(|config| config.reception(&frame, times)),
            joined: others
                .filter(|(_, node)| node.takes_part())
                .map(|(&id, node)| (id, node.config.reception(&frame, times)))
                .collect(),
            phase: Phase::Valid(now),
        };
        flight.phase = self.first_phase(&flight, controller);
        self.flight = Some(flight);
    }

    /// The first phase of a frame that begins.
    fn first_phase(&mut self, flight: &Flight, controller: &dyn Controller) -> Phase {
        let slot = flight.after(flight.frame.bits_through_acknowledge());
        let is_board = flight.sender == Sender::Board;
        if self.shorted {
            let frame_error = FrameError::new(BusError::DominantBit, Outcome::Shorted);
            return Phase::Fault(flight.after(1), frame_error);
        }
        if is_board && self.failing > 0 {
            self.failing -= 1;
            return Phase::Fault(slot, FrameError::new(BusError::RecessiveBit, Outcome::Destroyed));
        }
        let board =
            (!is_board && controller.listens() && controller.drives()).then(|| reception_of(controller, flight));

        let destroyed = |reception: Reception| match reception {
            Reception::Fails(bits) => Some(bits),
            Reception::Follows | Reception::Ignores => None,
        };
        let by_board = board.filter(|_| controller.state() == ErrorState::Active);
        let by_joined = flight.joined.iter().filter(|(node, _)| self.joined[node].destroys());
        let by_joined = by_joined.map(|&(_, reception)| reception);
        let by_attached = flight.attached.filter(|_| !self.is_silent());
        let destroyers = by_joined.chain(by_board).chain(by_attached);
        if let Some(bits) = destroyers.filter_map(destroyed).min() {
            let frame_error = FrameError {
                in_data_phase: flight.frame.switches_bit_rate() && bits == flight.frame.bits_before_crc_delimiter(),
                ..FrameError::new(BusError::RecessiveBit, Outcome::Garbled)
            };
            return Phase::Fault(flight.after(bits), frame_error);
        }

        let is_attached = match flight.sender {
            Sender::Board => false,
            Sender::Node(node) => !self.joined.contains_key(&node),
            Sender::Flood => true,
        };
        let follows = |reception: Reception| reception == Reception::Follows;
        let by_joined = flight.joined.iter();
        let is_acknowledged = is_attached
            || board.is_some_and(follows)
            || flight.attached.is_some_and(follows) && !self.withholds_acknowledge && !self.is_silent()
            || by_joined
                .into_iter()
                .any(|&(node, reception)| follows(reception) && !self.joined[&node].config.is_silent);
        if is_acknowledged {
            Phase::Valid(flight.after(flight.frame.bits_until_valid()))
        } else {
            Phase::Fault(slot, FrameError::new(BusError::Acknowledge, Outcome::Unacknowledged))
        }
    }

    /// Returns true if the attached nodes are listen-only.
    fn is_silent(&self) -> bool {
        self.attached.is_some_and(|config| config.is_silent)
    }

    fn carry_on(&mut self, mut flight: Flight, controller: &mut dyn Controller) {
        match flight.phase {
            Phase::Valid(_) => {
                self.hand_over(&flight, controller);
                let end = flight.after(flight.frame.bits_on_the_wire());
                flight.phase = Phase::Close(end, Outcome::Sent);
                self.flight = Some(flight);
            }
            Phase::Fault(at, frame_error) => {
                self.fail(&flight, frame_error, controller);
                // An active error flag on a shorted bus is an error at each of its bits.
                let is_repeated = frame_error.outcome == Outcome::Shorted
                    && self.shorted
                    && controller.sends()
                    && controller.state() == ErrorState::Active;
                let bit = flight.times.nominal;
                flight.phase = if is_repeated {
                    Phase::Fault(at + span(1, bit), frame_error)
                } else {
                    Phase::Close(
                        at + span(ERROR_FLAG_BITS + ERROR_DELIMITER_BITS, bit),
                        frame_error.outcome,
                    )
                };
                self.flight = Some(flight);
            }
            Phase::Close(end, outcome) => self.close(&flight, end, outcome, controller),
        }
    }

    /// The frame is valid for its receivers. A node that cannot decode it and may not destroy it has an error of its
    /// own.
    fn hand_over(&mut self, flight: &Flight, controller: &mut dyn Controller) {
        let error = FrameError::new(BusError::Stuff, Outcome::Garbled);
        if flight.sender == Sender::Board {
            if flight.attached == Some(Reception::Follows) {
                self.received.push_back(flight.frame);
            }
        } else if controller.listens() {
            match reception_of(controller, flight) {
                Reception::Follows => controller.receive(&flight.frame),
                reception => error
                    .to_receiver(reception)
                    .into_iter()
                    .for_each(|fault| controller.receive_error(fault)),
            }
        }
        for &(node, reception) in &flight.joined {
            let Some(node) = self.joined.get_mut(&node) else {
                continue;
            };
            match error.to_receiver(reception) {
                _ if reception == Reception::Follows => {
                    node.received.push_back(flight.frame);
                    node.confinement.received();
                }
                Some(fault) => node.confinement.receive_fault(fault),
                None => {}
            }
        }
    }

    /// All nodes see the error in the frame.
    fn fail(&mut self, flight: &Flight, frame_error: FrameError, controller: &mut dyn Controller) {
        if flight.sender != Sender::Board {
            let fault = frame_error.to_receiver(reception_of(controller, flight));
            if let Some(fault) = fault.filter(|_| controller.listens()) {
                controller.receive_error(fault);
            }
        } else if controller.sends() {
            controller.transmit_error(frame_error.to_sender());
        }
        for &(node, reception) in &flight.joined {
            if let Some(node) = self.joined.get_mut(&node)
                && let Some(fault) = frame_error.to_receiver(reception)
            {
                node.confinement.receive_fault(fault);
            }
        }
        if let Sender::Node(node) = flight.sender
            && let Some(node) = self.joined.get_mut(&node)
        {
            node.confinement.transmit_error(frame_error.error);
            if node.confinement.state() == ErrorState::BusOff {
                node.wait = Some(Wait::new(RECOVERY, None));
            }
        }
    }

    fn close(&mut self, flight: &Flight, end: Nanos, outcome: Outcome, controller: &mut dyn Controller) {
        let bit = flight.times.nominal;
        self.free = end + span(INTERMISSION_BITS, bit);
        let suspended = self.free + span(SUSPEND_BITS, bit);
        let sent = outcome == Outcome::Sent;
        match flight.sender {
            Sender::Board if controller.state() == ErrorState::Passive => self.free_for_board = suspended,
            Sender::Node(node) => {
                if sent && let Some(queue) = self.queues.get_mut(&node) {
                    queue.pop_front();
                }
                if let Some(node) = self.joined.get_mut(&node) {
                    if sent {
                        node.confinement.transmitted();
                    }
                    if node.confinement.state() == ErrorState::Passive {
                        node.free = suspended;
                    }
                }
            }
            _ => {}
        }
        for node in self.joined.values_mut() {
            if let Some(wait) = &mut node.wait {
                wait.end(self.free);
            }
        }
        controller.end(sent && flight.sender == Sender::Board, self.free);
        self.records.push(Record {
            requested: flight.requested,
            start: flight.start,
            end,
            sender: flight.sender,
            frame: flight.frame,
            outcome,
        });
        self.progress = true;
    }
}

/// The reception of a frame by the board's controller.
fn reception_of(controller: &dyn Controller, flight: &Flight) -> Reception {
    reception(&flight.frame, flight.times, controller.bit(), controller.capability())
}
