//! An arm that says what it is told.

use std::collections::VecDeque;
use std::mem;

use armwire_bridge::Instant;
use armwire_sim::serial::SerialDevice;

/// Says what it is told, without a pause, and keeps what it hears.
#[derive(Debug, Default)]
pub struct Talker {
    tx_queue: VecDeque<u8>,
    received: Vec<u8>,
}

impl Talker {
    /// Says `bytes` after what it has still to say.
    pub fn send(&mut self, bytes: &[u8]) {
        self.tx_queue.extend(bytes);
    }

    /// What it has heard since this was last asked.
    pub fn take_received(&mut self) -> Vec<u8> {
        mem::take(&mut self.received)
    }
}

impl SerialDevice for Talker {
    fn receive(&mut self, _: Instant, byte: u8) {
        self.received.push(byte);
    }

    fn transmit(&mut self, _: Instant) -> Option<u8> {
        self.tx_queue.pop_front()
    }

    fn poll_timeout(&self) -> Option<Instant> {
        (!self.tx_queue.is_empty()).then_some(Instant::ZERO)
    }
}
