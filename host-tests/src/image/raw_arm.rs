//! An arm without a protocol.

use std::collections::VecDeque;
use std::mem;

use armwire_bridge::Instant;
use armwire_sim::serial::SerialDevice;

/// An arm that sends given bytes without a pause, and records received bytes.
#[derive(Debug, Default)]
pub struct RawArm {
    tx_queue: VecDeque<u8>,
    received: Vec<u8>,
}

impl RawArm {
    /// Sends `bytes` after all queued bytes.
    pub fn send(&mut self, bytes: &[u8]) {
        self.tx_queue.extend(bytes);
    }

    /// Bytes received since the last call.
    pub fn take_received(&mut self) -> Vec<u8> {
        mem::take(&mut self.received)
    }
}

impl SerialDevice for RawArm {
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
