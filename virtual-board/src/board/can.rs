//! The CAN bus as a program uses it.

use std::sync::Mutex;

use armwire_bridge::can::Frame;

use super::Error;
use crate::can::bus::{Bus, Record};
use crate::can::{self, BusFrame};
use crate::stm32f405::port::lock;

/// The CAN bus and the other nodes on it.
///
/// Nobody is on it until nodes are [attached](Can::attach). What is changed here takes effect when the board next runs.
#[derive(Debug)]
pub struct Can<'a> {
    pub(super) bus: &'a Mutex<Bus>,
}

impl Can<'_> {
    /// Puts nodes on the bus that run at `rate` bits per second and acknowledge what they understand.
    pub fn attach(&self, rate: u32) {
        lock(self.bus).attach(rate);
    }

    /// Takes the nodes off the bus: nobody acknowledges any more, and what they wanted to send is gone.
    pub fn detach(&self) {
        lock(self.bus).detach();
    }

    /// Whether there are nodes.
    pub fn is_attached(&self) -> bool {
        lock(self.bus).is_attached()
    }

    /// Queues a frame of node 0. It goes when the bus is free and no lower identifier wants it, and again until it got
    /// through.
    ///
    /// # Errors
    ///
    /// [`Error::FdFrame`] for one that a classic bus does not carry.
    pub fn send(&self, frame: &Frame) -> Result<(), Error> {
        self.send_from(0, frame)
    }

    /// Queues a frame of `node`. Each node has a queue of its own; the fronts of the queues arbitrate.
    ///
    /// # Errors
    ///
    /// As for [`send`](Self::send).
    pub fn send_from(&self, node: u8, frame: &Frame) -> Result<(), Error> {
        let frame = can::to_wire(frame).ok_or(Error::FdFrame)?;
        lock(self.bus).send(node, frame);
        Ok(())
    }

    /// How many frames of the nodes have not gone yet.
    pub fn unsent(&self) -> usize {
        lock(self.bus).unsent()
    }

    /// Takes the frames that the nodes received from the board, but remote frames and those with 29-bit identifiers.
    pub fn read(&self) -> Vec<Frame> {
        lock(self.bus).take_heard().iter().filter_map(can::from_wire).collect()
    }

    /// How many frames the nodes received from the board that were not read yet.
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
            frame: can::from_wire(&record.frame),
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

    /// Whether nodes acknowledge the board's frames. They do until told otherwise.
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

    /// Lets another node send `frame` again and again, whenever it wins the bus. `None` ends it.
    ///
    /// # Errors
    ///
    /// As for [`send`](Self::send).
    pub fn flood(&self, frame: Option<&Frame>) -> Result<(), Error> {
        let frame = frame
            .map(|frame| can::to_wire(frame).ok_or(Error::FdFrame))
            .transpose()?;
        lock(self.bus).set_flood(frame);
        Ok(())
    }
}
