//! The CAN bus at the board's edge: other nodes, faults, and a record of every frame.
//!
//! `bus` is the wire and the nodes on it. It drives any `Controller`; nothing here knows a register or an emulator.
//! Whole frames cross it, classic or FD, each as long as its bits with the stuff bits that they really have
//! ([`armwire_sim::can`]).
//!
//! There are two kinds of other nodes. The attached nodes are one party of any size with one [`NodeConfig`]: they
//! acknowledge each other, so that a frame of theirs passes even if the board does not listen, and they are never error
//! passive. A joined node is one node with its own configuration, error counters and received frames.

#[cfg(any(test, unix))]
pub(crate) mod absent;
pub(crate) mod bus;
pub(crate) mod confinement;
mod node;
#[cfg(test)]
mod tests;
pub(crate) mod wait;

use armwire_bridge::can::Frame;
use armwire_sim::can as wire;

pub use node::NodeConfig;

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
    /// A node did not understand it: its rates are others, or it knows no FD frames. The frame ended in an error.
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
    /// The frame. `None` for a remote frame or one with a 29-bit identifier.
    pub frame: Option<Frame>,
    /// The frame with all that the bus carries: 29-bit identifiers, remote frames, and the flags of FD frames.
    pub on_the_wire: wire::Frame,
    /// What became of it.
    pub outcome: Outcome,
}

/// What a controller finds wrong on the bus, by the codes of its last-error field (32.9.2 ESR; an FDCAN has the same).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum BusError {
    Stuff = 1,
    Acknowledge = 3,
    /// It sent a recessive bit and saw a dominant one.
    RecessiveBit = 4,
    /// It sent a dominant bit and saw a recessive one.
    DominantBit = 5,
}

/// An error in a frame, as a controller finds it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Fault {
    pub(crate) error: BusError,
    /// Whether it is in the data phase of a frame that switches the bit rate.
    pub(crate) in_data_phase: bool,
    /// Whether the controller found it itself. Otherwise it saw the error flag of a node that did.
    pub(crate) is_own: bool,
}

/// How much a node may still say (ISO 11898-1, fault confinement).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ErrorState {
    /// It destroys a frame that it finds wrong.
    Active,
    /// It destroys nothing, and waits longer before it sends.
    Passive,
    /// It takes no part in the bus.
    BusOff,
}

/// Which frames a node knows (ISO 11898-1: the three implementations).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Capability {
    /// Classic frames. An FD frame is an error to it.
    Classic,
    /// Classic frames. It neither receives nor disturbs an FD frame.
    FdTolerant,
    /// Classic and FD frames, with bits of so many picoseconds in the data phase.
    Fd {
        /// One bit of the data phase.
        data_bit: u64,
    },
}

/// A controller as the bus sees it.
///
/// Every call happens at its instant on the bus, in order.
pub(crate) trait Controller {
    /// One of its nominal bits in picoseconds, 0 while it has no clock.
    fn bit(&self) -> u64;

    /// Which frames it knows, as it is configured now.
    fn capability(&self) -> Capability;

    /// Whether it hears the bus. Never in bus-off.
    fn listens(&self) -> bool;

    /// Whether it drives the bus: it acknowledges, and destroys what it finds wrong while it is error active.
    fn drives(&self) -> bool;

    /// How much it may say.
    fn state(&self) -> ErrorState;

    /// The frame that it would send now. An FD frame only if its capability is FD.
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

    /// There is an error in the frame of another node.
    fn receive_error(&mut self, fault: Fault);

    /// There is an error in its own frame.
    fn transmit_error(&mut self, fault: Fault);

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
