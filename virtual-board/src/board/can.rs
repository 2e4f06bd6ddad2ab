//! The API of the CAN bus.

use std::sync::Mutex;

use armwire_bridge::can::Frame;
use armwire_sim::can as wire;

use crate::can::bus::{Bus, Record};
use crate::can::{BusFrame, ErrorState, NodeConfig};
use crate::error::Error;
use crate::shared::lock;

/// The CAN bus and the other nodes on it.
///
/// The bus is empty until nodes are [attached](Can::attach). Changes take effect when the board next runs.
#[derive(Debug)]
pub struct Can<'a> {
    pub(crate) bus: &'a Mutex<Bus>,
}

impl Can<'_> {
    /// Attaches classic nodes at `rate` bits per second, which acknowledge the frames that they receive.
    pub fn attach(&self, rate: u32) {
        lock(self.bus).attach(rate);
    }

    /// Attaches nodes of this kind, in place of the nodes attached before.
    pub fn attach_as(&self, config: NodeConfig) {
        lock(self.bus).attach_as(config);
    }

    /// Detaches the attached nodes: they no longer acknowledge, and their pending frames are dropped.
    pub fn detach(&self) {
        lock(self.bus).detach();
    }

    /// Adds `node` to the bus as a separate node, with its own configuration, error counters and received frames. It
    /// takes part after 11 recessive bits. It replaces a joined node of the same number.
    pub fn join(&self, node: u8, config: NodeConfig) {
        lock(self.bus).join(node, config);
    }

    /// Removes a joined node. Its pending and received frames are dropped.
    pub fn leave(&self, node: u8) {
        lock(self.bus).leave(node);
    }

    /// The transmit and receive error counters of a joined node, and its state. `None` for any other node.
    pub fn errors(&self, node: u8) -> Option<(u32, u32, ErrorState)> {
        lock(self.bus).errors(node)
    }

    /// Returns true if there are attached nodes.
    pub fn is_attached(&self) -> bool {
        lock(self.bus).is_attached()
    }

    /// Queues a frame of node 0. It is sent when it wins arbitration, and retransmitted until it succeeds.
    ///
    /// # Errors
    ///
    /// [`Error::FdFrame`] for an FD frame of a classic node.
    pub fn send(&self, frame: &Frame) -> Result<(), Error> {
        self.send_from(0, frame)
    }

    /// Queues a frame of `node`: a joined node, or else one of the attached. Each node has its own queue; the first
    /// frames of the queues arbitrate. An FD frame switches the bit rate.
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

    /// Number of frames of the nodes that were not sent yet.
    pub fn unsent(&self) -> usize {
        lock(self.bus).unsent()
    }

    /// Number of frames of `node` that were not sent yet.
    pub fn unsent_by(&self, node: u8) -> usize {
        lock(self.bus).unsent_by(node)
    }

    /// Takes the frames that the attached nodes received from the board, except remote frames and those with 29-bit
    /// identifiers.
    pub fn read(&self) -> Vec<Frame> {
        let received = lock(self.bus).take_received();
        received.iter().filter_map(wire::Frame::to_adapter).collect()
    }

    /// Takes the frames that a joined node received, of any sender.
    pub fn read_by(&self, node: u8) -> Vec<wire::Frame> {
        lock(self.bus).take_received_by(node)
    }

    /// Number of received frames of the nodes that were not read yet.
    pub fn unread(&self) -> usize {
        lock(self.bus).unread()
    }

    /// Every frame since the beginning, in the order of their ends, once for each attempt.
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

    /// Clears the record of frames.
    pub fn forget_frames(&self) {
        lock(self.bus).forget_records();
    }

    /// Destroys the next `count` frames of the board with an error flag of a node, counting each attempt.
    pub fn destroy_next(&self, count: u32) {
        lock(self.bus).destroy(count);
    }

    /// Sets whether the attached nodes acknowledge the frames of others. They do by default.
    pub fn set_acknowledging(&self, acknowledging: bool) {
        lock(self.bus).set_acknowledging(acknowledging);
    }

    /// Shorts the bus: it stays recessive until [released](Self::release). A controller that sends goes bus-off.
    pub fn short(&self) {
        lock(self.bus).set_shorted(true);
    }

    /// Ends the short.
    pub fn release(&self) {
        lock(self.bus).set_shorted(false);
    }

    /// Keeps the board's controller out of its initialization mode, as a bus or clock fault can: INAK is not set
    /// (RM0090, 32.4.1). `false` ends that.
    pub fn keep_from_initialization(&self, keep: bool) {
        lock(self.bus).keep_from_initialization(keep);
    }

    /// Makes another attached node send `frame` repeatedly, whenever it wins arbitration. `None` ends it.
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
