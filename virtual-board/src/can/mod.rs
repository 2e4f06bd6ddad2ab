//! The CAN bus at the board's edge: other nodes, faults, and a record of every frame.
//!
//! `bus` is the wire and the nodes on it. It drives any `Controller`, independent of registers and emulator. It carries
//! whole frames, classic or FD, with their exact number of bits including stuff bits ([`armwire_sim::can`]).
//!
//! There are two kinds of other nodes. The attached nodes are a group of any size with one [`NodeConfig`]: they
//! acknowledge each other, even if the board does not listen, and they are never error passive. A joined node is a
//! single node with its own configuration, error counters and received frames.

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

/// The sender of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Sender {
    /// The board.
    Board,
    /// A node of this number.
    Node(u8),
    /// The node that floods the bus.
    Flood,
}

/// The outcome of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Outcome {
    /// Acknowledged: all other nodes have received it.
    Sent,
    /// No node acknowledged it.
    Unacknowledged,
    /// A node destroyed it with an error flag.
    Destroyed,
    /// A node could not decode it, because of other rates or missing FD support. The frame ended in an error.
    Garbled,
    /// The bus was shorted.
    Shorted,
    /// Its sender left the bus.
    Cut,
}

/// A frame that was on the bus, once for each attempt.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BusFrame {
    /// Time of the firmware's request to its controller. `None` for a frame of another node.
    pub requested: Option<Nanos>,
    /// Beginning of its start of frame.
    pub start: Nanos,
    /// End of its end of frame, or of the error frame that destroyed it.
    pub end: Nanos,
    /// Its sender.
    pub sender: Sender,
    /// The frame. `None` for a remote frame or one with a 29-bit identifier.
    pub frame: Option<Frame>,
    /// The complete frame: 29-bit identifiers, remote frames, and the flags of FD frames.
    pub on_the_wire: wire::Frame,
    /// Its outcome.
    pub outcome: Outcome,
}

/// Bus errors of a controller, by the codes of its last-error field (32.9.2 ESR; the same in an FDCAN).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum BusError {
    Stuff = 1,
    Acknowledge = 3,
    /// It sent a recessive bit and saw a dominant one.
    RecessiveBit = 4,
    /// It sent a dominant bit and saw a recessive one.
    DominantBit = 5,
}

/// An error in a frame, as seen by a controller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Fault {
    pub(crate) error: BusError,
    /// True for an error in the data phase of a frame that switches the bit rate.
    pub(crate) in_data_phase: bool,
    /// True if the controller detected it. Otherwise it saw another node's error flag.
    pub(crate) is_own: bool,
}

/// The error state of a node (ISO 11898-1, fault confinement).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ErrorState {
    /// Error active: it destroys invalid frames.
    Active,
    /// Error passive: it destroys nothing, and waits longer before it sends.
    Passive,
    /// Bus-off: it takes no part in the bus.
    BusOff,
}

/// The frames that a node supports (ISO 11898-1: the three implementations).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Capability {
    /// Classic frames. An FD frame is an error to it.
    Classic,
    /// Classic frames. It neither receives nor disturbs an FD frame.
    FdTolerant,
    /// Classic and FD frames, with this bit time in picoseconds in the data phase.
    Fd {
        /// One bit of the data phase.
        data_bit: u64,
    },
}

/// A controller, as seen by the bus.
///
/// Calls are made at their instant on the bus, in order.
pub(crate) trait Controller {
    /// Its nominal bit time in picoseconds, 0 without a clock.
    fn bit(&self) -> u64;

    /// The frames that it supports in its present configuration.
    fn capability(&self) -> Capability;

    /// Returns true if it receives. Never in bus-off.
    fn listens(&self) -> bool;

    /// Returns true if it drives the bus: it acknowledges, and destroys invalid frames while it is error active.
    fn drives(&self) -> bool;

    fn state(&self) -> ErrorState;

    /// The frame that it would send now. An FD frame only with FD capability.
    fn offer(&self) -> Option<wire::Frame>;

    /// The time of the request for the frame that it sends.
    fn requested(&self) -> Option<Nanos>;

    /// Returns true while its frame is on the bus.
    fn sends(&self) -> bool;

    /// A frame begins, its own offered frame if `own`.
    fn begin(&mut self, own: bool);

    /// Its offered frame lost arbitration.
    fn lose(&mut self);

    /// A frame of another node is valid.
    fn receive(&mut self, frame: &wire::Frame);

    /// There is an error in the frame of another node.
    fn receive_error(&mut self, fault: Fault);

    /// There is an error in its own frame.
    fn transmit_error(&mut self, fault: Fault);

    /// The frame has ended, and the next may begin at `free`. `sent` is true for a successful frame of its own.
    fn end(&mut self, sent: bool, free: Nanos);

    /// The time of its next internal event.
    fn due(&self) -> Option<Nanos>;

    /// Executes its due internal events.
    fn tick(&mut self);
}

/// The span of `bits` bits of `bit` picoseconds.
pub(crate) fn span(bits: u32, bit: u64) -> Nanos {
    Nanos((u64::from(bits) * bit).div_ceil(1_000))
}
