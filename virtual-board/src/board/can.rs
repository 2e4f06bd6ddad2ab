//! The CAN bus as a program uses it.

use std::sync::Mutex;

use armwire_bridge::can::Frame;
use armwire_sim::can as wire;

use super::Error;
use crate::can::bus::{Bus, Record};
use crate::can::{BusFrame, ErrorState, NodeConfig};
use crate::shared::lock;

/// The CAN bus and the other nodes on it.
///
/// Nobody is on it until nodes are [attached](Can::attach). What is changed here takes effect when the board next runs.
#[derive(Debug)]
pub struct Can<'a> {
    pub(crate) bus: &'a Mutex<Bus>,
}

impl Can<'_> {
    /// Puts nodes on the bus that know classic frames, run at `rate` bits per second and acknowledge what they
    /// understand.
    pub fn attach(&self, rate: u32) {
        lock(self.bus).attach(rate);
    }

    /// Puts nodes of this kind on the bus, in the place of those that were attached before.
    pub fn attach_as(&self, config: NodeConfig) {
        lock(self.bus).attach_as(config);
    }

    /// Takes the attached nodes off the bus: they acknowledge nothing any more, and what they wanted to send is gone.
    pub fn detach(&self) {
        lock(self.bus).detach();
    }

    /// Puts `node` on the bus as a node of its own, with its own configuration, error counters and received frames. It
    /// takes part after 11 recessive bits. A node of this number that has joined before is replaced.
    pub fn join(&self, node: u8, config: NodeConfig) {
        lock(self.bus).join(node, config);
    }

    /// Takes a node off the bus that joined. What it wanted to send and what it received is gone.
    pub fn leave(&self, node: u8) {
        lock(self.bus).leave(node);
    }

    /// The transmit and the receive error counter of a node that joined, and its state. `None` for any other node.
    pub fn errors(&self, node: u8) -> Option<(u32, u32, ErrorState)> {
        lock(self.bus).errors(node)
    }

    /// Whether there are attached nodes.
    pub fn is_attached(&self) -> bool {
        lock(self.bus).is_attached()
    }

    /// Queues a frame of node 0. It goes when the bus is free and no lower identifier wants it, and again until it got
    /// through.
    ///
    /// # Errors
    ///
    /// [`Error::FdFrame`] for an FD frame of a node that knows none.
    pub fn send(&self, frame: &Frame) -> Result<(), Error> {
        self.send_from(0, frame)
    }

    /// Queues a frame of `node`: a node that joined, or else one of the attached. Each node has a queue of its own; the
    /// fronts of the queues arbitrate. An FD frame switches the bit rate.
    ///
    /// # Errors
    ///
    /// As for [`send`](Self::send).
    pub fn send_from(&self, node: u8, frame: &Frame) -> Result<(), Error> {
        self.send_on_the_wire(node, &(*frame).into())
    }

    /// Queues any frame that the bus carries, as [`send_from`](Self::send_from) does.
    ///
    /// # Errors
    ///
    /// As for [`send`](Self::send).
    pub fn send_on_the_wire(&self, node: u8, frame: &wire::Frame) -> Result<(), Error> {
        let mut bus = lock(self.bus);
        if !bus.can_send(node, frame) {
            return Err(Error::FdFrame);
        }
        bus.send(node, *frame);
        Ok(())
    }

    /// How many frames of the nodes have not gone yet.
    pub fn unsent(&self) -> usize {
        lock(self.bus).unsent()
    }

    /// How many frames of `node` have not gone yet.
    pub fn unsent_by(&self, node: u8) -> usize {
        lock(self.bus).unsent_by(node)
    }

    /// Takes the frames that the attached nodes received from the board, but remote frames and those with 29-bit
    /// identifiers.
    pub fn read(&self) -> Vec<Frame> {
        let heard = lock(self.bus).take_heard();
        heard.iter().filter_map(wire::Frame::to_adapter).collect()
    }

    /// Takes the frames that a node received which joined, whoever sent them.
    pub fn read_by(&self, node: u8) -> Vec<wire::Frame> {
        lock(self.bus).take_heard_by(node)
    }

    /// How many frames the nodes received that were not read yet.
    pub fn unread(&self) -> usize {
        lock(self.bus).unread()
    }

    /// Every frame since the beginning, in the order in which they ended, once for each attempt.
    pub fn frames(&self) -> Vec<BusFrame> {
        let public = |record: &Record| BusFrame {
            requested: record.requested,
            start: record.start,
            end: record.end,
            sender: record.sender,
            frame: record.frame.to_adapter(),
            on_the_wire: record.frame,
            outcome: record.outcome,
        };
        lock(self.bus).records().iter().map(public).collect()
    }

    /// Forgets the frames so far.
    pub fn forget_frames(&self) {
        lock(self.bus).forget_records();
    }

    /// Lets a node destroy the next `count` frames of the board with an error flag, each attempt counted.
    pub fn destroy_next(&self, count: u32) {
        lock(self.bus).destroy(count);
    }

    /// Whether the attached nodes acknowledge the frames of others. They do until told otherwise.
    pub fn set_acknowledging(&self, acknowledging: bool) {
        lock(self.bus).set_acknowledging(acknowledging);
    }

    /// Shorts the bus: it is recessive whoever sends, until [released](Self::release). A controller that sends goes to
    /// bus-off.
    pub fn short(&self) {
        lock(self.bus).set_shorted(true);
    }

    /// Ends the short.
    pub fn release(&self) {
        lock(self.bus).set_shorted(false);
    }

    /// Keeps the board's controller from its initialization mode, as one whose bus or clock does not let it end what it does:
    /// INAK does not come (RM0090, 32.4.1). `false` ends that.
    pub fn keep_from_initialization(&self, keep: bool) {
        lock(self.bus).keep_from_initialization(keep);
    }

    /// Lets another attached node send `frame` again and again, whenever it wins the bus. `None` ends it.
    ///
    /// # Errors
    ///
    /// As for [`send`](Self::send).
    pub fn flood(&self, frame: Option<&Frame>) -> Result<(), Error> {
        let mut bus = lock(self.bus);
        let frame = frame.map(|frame| wire::Frame::from(*frame));
        if frame.is_some_and(|frame| !bus.attached_can_send(&frame)) {
            return Err(Error::FdFrame);
        }
        bus.set_flood(frame);
        Ok(())
    }
}
