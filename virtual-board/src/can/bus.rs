//! The wire: who has it, what becomes of each frame, and when (ISO 11898-1).
//!
//! It keeps no clock. [`Bus::poll`] does what is due and says when it wants to be called again; whoever owns the
//! controller calls it then, and after every change in the controller too.
//!
//! | What | When |
//! |---|---|
//! | Arbitration: frames that are ready when the bus becomes free | at the start of frame |
//! | A frame is valid for who receives it | at the last but one bit of its end of frame |
//! | A frame is valid for who sends it | at the end of its end of frame |
//! | No acknowledge, a node's error flag, rates that do not fit | at the acknowledge slot |
//! | A shorted bus | at the first bit, then at every bit of an active error flag |
//! | The end of a frame with an error | six bits of error flag and eight of delimiter later |
//! | The next frame | three bits later, eight more for a sender that is error passive |
//!
//! Left out: two frames that no bit of their arbitration fields tells apart (the board's goes first), and overload
//! frames.

use std::collections::{BTreeMap, VecDeque};

use rigless::chip::can::{ERROR_DELIMITER_BITS, ERROR_FLAG_BITS, Frame, INTERMISSION_BITS, SUSPEND_BITS};

use super::{BusError, Controller, ErrorState, Outcome, Sender, span};
use crate::line::SECOND;
use crate::time::Nanos;

/// How far two rates may differ and still understand each other, in parts per thousand. Oscillators may each be off by
/// 1.58 % at best (ISO 11898-1).
const TOLERANCE: u64 = 10;

/// A frame that was on the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Record {
    /// When the board's controller was asked to send it.
    pub(crate) requested: Option<Nanos>,
    pub(crate) start: Nanos,
    pub(crate) end: Nanos,
    pub(crate) sender: Sender,
    pub(crate) frame: Frame,
    pub(crate) outcome: Outcome,
}

/// A frame on the bus.
#[derive(Clone, Copy, Debug)]
struct Flight {
    sender: Sender,
    frame: Frame,
    requested: Option<Nanos>,
    start: Nanos,
    /// One of its sender's bits, in picoseconds.
    bit: u64,
    phase: Phase,
}

/// What happens next to it, and when.
#[derive(Clone, Copy, Debug)]
enum Phase {
    /// Who receives it has it.
    Valid(Nanos),
    /// The controller finds an error.
    Fault(Nanos, BusError, Outcome),
    /// It is over.
    Close(Nanos, Outcome),
}

/// The bus, and the nodes on it.
#[derive(Debug, Default)]
pub(crate) struct Bus {
    /// One bit of the nodes in picoseconds, while there are any.
    bit: Option<u64>,
    /// Whether the nodes leave the board's frames unacknowledged.
    deaf: bool,
    shorted: bool,
    /// How many more of the board's frames a node destroys.
    failing: u32,
    /// What each node wants to send.
    queues: BTreeMap<u8, VecDeque<Frame>>,
    flood: Option<Frame>,
    /// What the nodes received from the board.
    heard: VecDeque<Frame>,
    /// From when on a frame may begin, and one of the board's.
    free: Nanos,
    free_for_board: Nanos,
    flight: Option<Flight>,
    records: Vec<Record>,
    progress: bool,
}

/// What a program does with the bus. It takes effect at the next [`poll`](Bus::poll).
impl Bus {
    /// Puts nodes of `rate` bits per second on the bus.
    pub(crate) fn attach(&mut self, rate: u32) {
        self.bit = Some(SECOND / u64::from(rate.max(1)));
    }

    /// Takes the nodes off the bus. What they wanted to send is gone.
    pub(crate) fn detach(&mut self) {
        self.bit = None;
        self.queues.clear();
        self.flood = None;
    }

    pub(crate) fn is_attached(&self) -> bool {
        self.bit.is_some()
    }

    pub(crate) fn set_acknowledging(&mut self, acknowledging: bool) {
        self.deaf = !acknowledging;
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

    /// Queues a frame of `node`.
    pub(crate) fn send(&mut self, node: u8, frame: Frame) {
        self.queues.entry(node).or_default().push_back(frame);
    }

    /// How many frames of the nodes wait, the one on the bus included.
    pub(crate) fn unsent(&self) -> usize {
        self.queues.values().map(VecDeque::len).sum()
    }

    /// Takes what the nodes received from the board.
    pub(crate) fn take_heard(&mut self) -> Vec<Frame> {
        self.heard.drain(..).collect()
    }

    pub(crate) fn unread(&self) -> usize {
        self.heard.len()
    }

    pub(crate) fn records(&self) -> &[Record] {
        &self.records
    }

    pub(crate) fn forget_records(&mut self) {
        self.records.clear();
    }

    /// Whether a frame ended since this was last asked.
    pub(crate) fn take_progress(&mut self) -> bool {
        std::mem::take(&mut self.progress)
    }
}

/// What happens on the wire.
impl Bus {
    /// Does what is due by `now`. Returns when it wants to be called again at the latest.
    pub(crate) fn poll(&mut self, now: Nanos, controller: &mut dyn Controller) -> Option<Nanos> {
        self.sense(now, controller);
        loop {
            let wire = match self.flight {
                Some(Flight { phase, .. }) => match phase {
                    Phase::Valid(at) | Phase::Fault(at, ..) | Phase::Close(at, _) => Some(at),
                },
                None => self.next_start(now, controller),
            };
            let due = [wire, controller.due()].into_iter().flatten().min()?;
            if due > now {
                return Some(due);
            }
            if controller.due() == Some(due) {
                controller.tick();
                continue;
            }
            match self.flight {
                Some(flight) => self.carry_on(flight, controller),
                None => self.begin(now, controller),
            }
        }
    }

    /// A frame does not survive that its sender goes, nor a short.
    fn sense(&mut self, now: Nanos, controller: &mut dyn Controller) {
        let Some(flight) = &mut self.flight else {
            return;
        };
        if matches!(flight.phase, Phase::Close(..)) {
            return;
        }
        let gone = match flight.sender {
            Sender::Board => !controller.sends(),
            Sender::Node(_) | Sender::Flood => self.bit.is_none(),
        };
        if gone {
            flight.phase = Phase::Fault(now, BusError::Stuff, Outcome::Cut);
        } else if self.shorted && !matches!(flight.phase, Phase::Fault(_, _, Outcome::Shorted)) {
            flight.phase = Phase::Fault(now, BusError::DominantBit, Outcome::Shorted);
        }
    }

    /// The node's frame that would win against those of the other nodes.
    fn node_offer(&self) -> Option<(Sender, Frame)> {
        let bit = self.bit.filter(|_| !self.shorted);
        let queued = self
            .queues
            .iter()
            .filter_map(|(&node, queue)| Some((Sender::Node(node), *queue.front()?)));
        let flood = self.flood.map(|frame| (Sender::Flood, frame));
        bit.and_then(|_| queued.chain(flood).min_by(|(_, a), (_, b)| a.arbitrates(b)))
    }

    /// When the next frame begins.
    fn next_start(&self, now: Nanos, controller: &dyn Controller) -> Option<Nanos> {
        let board = controller.offer().map(|_| self.free_for_board.max(self.free));
        let nodes = self.node_offer().map(|_| self.free);
        [board, nodes].into_iter().flatten().min().map(|start| start.max(now))
    }

    fn begin(&mut self, now: Nanos, controller: &mut dyn Controller) {
        let board = controller.offer().filter(|_| self.free_for_board <= now);
        let nodes = self.node_offer();
        let nodes_win = |&(_, frame): &(Sender, Frame)| board.is_none_or(|own| frame.arbitrates(&own).is_lt());
        match (board, nodes.filter(nodes_win)) {
            (own, Some((sender, frame))) => {
                if own.is_some() {
                    controller.lose();
                }
                controller.begin(false);
                let bit = self.bit.unwrap_or_default();
                self.flight = Some(self.node_flight(sender, frame, now, bit, controller));
            }
            (Some(frame), None) => {
                controller.begin(true);
                self.flight = Some(self.board_flight(frame, now, controller));
            }
            (None, None) => {}
        }
    }

    fn node_flight(&self, sender: Sender, frame: Frame, start: Nanos, bit: u64, controller: &dyn Controller) -> Flight {
        let destroyed = controller.listens()
            && controller.drives()
            && controller.state() == ErrorState::Active
            && !fit(bit, controller.bit());
        let phase = if destroyed {
            let at = start + span(frame.bits_through_acknowledge(), bit);
            Phase::Fault(at, BusError::Stuff, Outcome::Garbled)
        } else {
            Phase::Valid(start + span(frame.bits_until_valid(), bit))
        };
        Flight {
            sender,
            frame,
            requested: None,
            start,
            bit,
            phase,
        }
    }

    fn board_flight(&mut self, frame: Frame, start: Nanos, controller: &dyn Controller) -> Flight {
        let bit = controller.bit();
        let slot = start + span(frame.bits_through_acknowledge(), bit);
        let phase = match self.bit {
            _ if self.shorted => Phase::Fault(start + span(1, bit), BusError::DominantBit, Outcome::Shorted),
            _ if self.failing > 0 => {
                self.failing -= 1;
                Phase::Fault(slot, BusError::RecessiveBit, Outcome::Destroyed)
            }
            Some(nodes) if !fit(nodes, bit) => Phase::Fault(slot, BusError::RecessiveBit, Outcome::Garbled),
            Some(_) if !self.deaf => Phase::Valid(start + span(frame.bits_until_valid(), bit)),
            _ => Phase::Fault(slot, BusError::Acknowledge, Outcome::Unacknowledged),
        };
        Flight {
            sender: Sender::Board,
            frame,
            requested: controller.requested(),
            start,
            bit,
            phase,
        }
    }

    fn carry_on(&mut self, mut flight: Flight, controller: &mut dyn Controller) {
        match flight.phase {
            Phase::Valid(_) => {
                match flight.sender {
                    Sender::Board => self.heard.push_back(flight.frame),
                    Sender::Node(_) | Sender::Flood if !controller.listens() => {}
                    Sender::Node(_) | Sender::Flood if fit(flight.bit, controller.bit()) => {
                        controller.receive(&flight.frame);
                    }
                    Sender::Node(_) | Sender::Flood => controller.receive_error(BusError::Stuff),
                }
                let end = flight.start + span(flight.frame.bits_on_the_wire(), flight.bit);
                flight.phase = Phase::Close(end, Outcome::Sent);
                self.flight = Some(flight);
            }
            Phase::Fault(at, error, outcome) => {
                if flight.sender != Sender::Board {
                    if controller.listens() {
                        controller.receive_error(error);
                    }
                } else if controller.sends() {
                    controller.transmit_error(error);
                }
                // An active error flag that a short swallows is an error at each of its bits.
                let swallowed = outcome == Outcome::Shorted
                    && self.shorted
                    && controller.sends()
                    && controller.state() == ErrorState::Active;
                flight.phase = if swallowed {
                    Phase::Fault(at + span(1, flight.bit), error, outcome)
                } else {
                    Phase::Close(at + span(ERROR_FLAG_BITS + ERROR_DELIMITER_BITS, flight.bit), outcome)
                };
                self.flight = Some(flight);
            }
            Phase::Close(end, outcome) => self.close(flight, end, outcome, controller),
        }
    }

    fn close(&mut self, flight: Flight, end: Nanos, outcome: Outcome, controller: &mut dyn Controller) {
        self.flight = None;
        self.free = end + span(INTERMISSION_BITS, flight.bit);
        let sent = outcome == Outcome::Sent;
        match flight.sender {
            Sender::Board if controller.state() == ErrorState::Passive => {
                self.free_for_board = self.free + span(SUSPEND_BITS, flight.bit);
            }
            Sender::Node(node) if sent => {
                if let Some(queue) = self.queues.get_mut(&node) {
                    queue.pop_front();
                }
            }
            _ => {}
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

/// Whether bits of `a` and `b` picoseconds understand each other.
fn fit(a: u64, b: u64) -> bool {
    a.abs_diff(b) * 1_000 <= TOLERANCE * a.max(b)
}
