//! The wait of a node that joins the bus or recovers from bus-off (ISO 11898-1): a number of times 11 recessive bits.

use armwire_sim::can::BUS_IDLE_BITS;

use super::span;
use crate::time::Nanos;

/// A wait for `left` times 11 recessive bits in a row.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Wait {
    left: u32,
    /// The start of the recessive state, unless a frame is on the bus.
    since: Option<Nanos>,
}

impl Wait {
    /// A wait for `times` times 11 bits, on a bus that is recessive `since` then.
    pub(crate) fn new(times: u32, since: Option<Nanos>) -> Self {
        Self { left: times, since }
    }

    /// A frame begins. The recessive bits so far, of `bit` picoseconds each, count in whole elevens.
    pub(crate) fn begin(&mut self, now: Nanos, bit: u64) {
        if let Some(since) = self.since.take() {
            let eleven = span(BUS_IDLE_BITS, bit).0.max(1);
            let passed = u32::try_from(now.since(since).0 / eleven).unwrap_or(u32::MAX);
            self.left = self.left.saturating_sub(passed).max(1);
        }
    }

    /// A frame has ended, and the next may begin at `free`. The 11 recessive bits at the end of every frame have then
    /// passed and count, unless the wait began after that frame.
    pub(crate) fn end(&mut self, free: Nanos) {
        if self.since.is_none() {
            self.left = self.left.saturating_sub(1);
            self.since = Some(free);
        }
    }

    /// The end of the wait, if no other frame comes. `None` during a frame, or without a clock.
    pub(crate) fn due(&self, bit: u64) -> Option<Nanos> {
        let since = self.since.filter(|_| bit > 0)?;
        Some(since + span(self.left * BUS_IDLE_BITS, bit))
    }
}
