//! The CAN bus at the board's edge: other nodes, faults, and a record of every frame.
//!
//! `bus` is the wire and the nodes on it. It drives any `Controller`; nothing here knows a register or an emulator.
//! Whole frames cross it, each as long as its bits with the stuff bits that they really have.
//!
//! The other nodes are one party of any size: they acknowledge each other, so that a frame of theirs passes even if the
//! board does not listen.

pub(crate) mod bus;

use armwire_bridge::can::{Frame, Id};
use rigless::chip::can as wire;

use crate::time::Nanos;

/// Who sent a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Sender {
    /// The board.
    Board,
    /// A node of this number.
    Node(u8),
    /// The node that floods the bus.
    Flood,
}

/// What became of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Outcome {
    /// It was acknowledged: everybody else on the bus has it.
    Sent,
    /// Nobody acknowledged it.
    Unacknowledged,
    /// A node destroyed it with an error flag.
    Destroyed,
    /// The two sides run at different rates: it ended in an error.
    Garbled,
    /// The bus was shorted.
    Shorted,
    /// Its sender went away in the middle of it.
    Cut,
}

/// A frame that was on the bus, once for each attempt.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BusFrame {
    /// When the firmware had asked its controller to send it. `None` for a frame of another node.
    pub requested: Option<Nanos>,
    /// When its start of frame began.
    pub start: Nanos,
    /// When its end of frame, or the error frame that destroyed it, ended.
    pub end: Nanos,
    /// Who sent it.
    pub sender: Sender,
    /// The frame. `None` for a remote frame or one with a 29-bit identifier, which only a board's firmware can send.
    pub frame: Option<Frame>,
    /// What became of it.
    pub outcome: Outcome,
}

/// What a controller finds wrong on the bus, by the codes of its last-error field (32.9.2 ESR).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum BusError {
    Stuff = 1,
    Acknowledge = 3,
    /// It sent a recessive bit and saw a dominant one.
    RecessiveBit = 4,
    /// It sent a dominant bit and saw a recessive one.
    DominantBit = 5,
}

/// How much a controller may still say (ISO 11898-1, fault confinement).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ErrorState {
    Active,
    Passive,
    BusOff,
}

/// A controller as the bus sees it.
///
/// Every call happens at its instant on the bus, in order.
pub(crate) trait Controller {
    /// One of its bits in picoseconds, 0 while it has no clock.
    fn bit(&self) -> u64;

    /// Whether it hears the bus.
    fn listens(&self) -> bool;

    /// Whether it drives the bus: it acknowledges, and destroys what it finds wrong while it is error active.
    fn drives(&self) -> bool;

    /// How much it may say.
    fn state(&self) -> ErrorState;

    /// The frame that it would send now.
    fn offer(&self) -> Option<wire::Frame>;

    /// When the frame that it sends was requested.
    fn requested(&self) -> Option<Nanos>;

    /// Whether its frame is on the bus.
    fn sends(&self) -> bool;

    /// A frame begins: the one that it offered if `own`.
    fn begin(&mut self, own: bool);

    /// The frame that it offered began together with one that has the bus now.
    fn lose(&mut self);

    /// A frame of another node is valid.
    fn receive(&mut self, frame: &wire::Frame);

    /// It found an error in the frame of another node.
    fn receive_error(&mut self, error: BusError);

    /// It found an error in its own frame.
    fn transmit_error(&mut self, error: BusError);

    /// The frame is over, and the next may begin at `free`. `sent` says whether it was its own and everybody has it.
    fn end(&mut self, sent: bool, free: Nanos);

    /// When something happens within it, whatever the bus does.
    fn due(&self) -> Option<Nanos>;

    /// What is due within it happens.
    fn tick(&mut self);
}

/// The span of `bits` bits of `bit` picoseconds.
pub(crate) fn span(bits: u32, bit: u64) -> Nanos {
    Nanos((u64::from(bits) * bit).div_ceil(1_000))
}

/// The frame as the wire has it, `None` for an FD frame.
pub(crate) fn to_wire(frame: &Frame) -> Option<wire::Frame> {
    let data = frame.data();
    (!frame.is_fd()).then(|| wire::Frame::data_frame(wire::Id::Standard(frame.id().get()), data))
}

/// The frame as a program has it, if it can.
pub(crate) fn from_wire(frame: &wire::Frame) -> Option<Frame> {
    match frame.id {
        wire::Id::Standard(id) if !frame.remote => Frame::new(Id::new(id).ok()?, frame.payload()).ok(),
        _ => None,
    }
}
