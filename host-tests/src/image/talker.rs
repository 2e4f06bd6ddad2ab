//! An arm that says what it is told.

use std::collections::VecDeque;
use std::mem;

use armwire_bridge::Instant;
use armwire_sim::serial::SerialDevice;

/// Says what it is told, without a pause, and keeps what it hears.
#[derive(Debug, Default)]
pub struct Talker {
    says: VecDeque<u8>,
    heard: Vec<u8>,
}

impl Talker {
    /// Says `bytes` after what it has still to say.
    pub fn say(&mut self, bytes: &[u8]) {
        self.says.extend(bytes);
    }

    /// What it has heard since this was last asked.
    pub fn take_heard(&mut self) -> Vec<u8> {
        mem::take(&mut self.heard)
    }
}

impl SerialDevice for Talker {
    fn receive(&mut self, _: Instant, byte: u8) {
        self.heard.push(byte);
    }

    fn transmit(&mut self, _: Instant) -> Option<u8> {
        self.says.pop_front()
    }

    fn poll_timeout(&self) -> Option<Instant> {
        (!self.says.is_empty()).then_some(Instant::ZERO)
    }
}
