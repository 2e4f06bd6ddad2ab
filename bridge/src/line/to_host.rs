//! The serial port towards the host: which bytes wait for it, and when a packet of them is due.

use crate::counters::{Counters, count};
use crate::queue::Queue;

/// Bytes in a full USB packet (full speed, bulk).
pub const PACKET: usize = 64;

/// Room for bytes of the arm that the host on USB has not read yet: 20 ms of a saturated 1 Mbaud line.
pub const TO_HOST_BUFFER: usize = 2048;

/// Bytes for the host, up to [`TO_HOST_BUFFER`] of them.
pub(crate) struct ToHost {
    bytes: Queue<TO_HOST_BUFFER>,
    /// The watermark: the first byte of the arm that was not passed, by the decoder's offset.
    passed: u64,
    /// How many of them, from the front, no longer wait for more to fill the packet.
    due: usize,
    transfer: Transfer,
    state: State,
}

/// The USB transfer towards the host. A host waits for more until a packet is short.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Transfer {
    /// The last packet was short.
    Closed,
    /// The last packet was full and what follows it is still arriving.
    Open,
    /// The last packet was full and ended what there was to say.
    Unterminated,
}

/// Whether somebody listens at the host's end.
///
/// Some hosts never raise DTR, so a low DTR means a closed port only after it has been high.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    /// No host has configured the adapter.
    Detached,
    /// Configured by a host that has not raised DTR so far.
    Attached,
    /// DTR is high.
    Open,
    /// DTR went low again.
    Closed,
}

impl ToHost {
    pub(crate) const fn new() -> Self {
        Self {
            bytes: Queue::new(),
            passed: 0,
            due: 0,
            transfer: Transfer::Closed,
            state: State::Detached,
        }
    }

    /// Whether a host has configured the adapter.
    pub(crate) fn is_attached(&self) -> bool {
        self.state != State::Detached
    }

    /// The host enabled or disabled the adapter's configuration.
    pub(crate) fn configured(&mut self, configured: bool, counters: &mut Counters) {
        self.forget(counters);
        self.state = if configured { State::Attached } else { State::Detached };
    }

    /// The host raised or lowered DTR. Whether it opened or closed the port by that.
    pub(crate) fn dtr(&mut self, high: bool, counters: &mut Counters) -> bool {
        let state = match (self.state, high) {
            (State::Detached, _) => State::Detached,
            (State::Attached, false) => State::Attached,
            (_, true) => State::Open,
            (_, false) => State::Closed,
        };
        let changed = state != self.state;
        if changed {
            self.forget(counters);
            self.state = state;
        }
        changed
    }

    /// Passes bytes of the arm, the first of which has this offset, to the host: those that were not passed before.
    pub(crate) fn pass(&mut self, offset: u64, bytes: &[u8], counters: &mut Counters) {
        let passed = self.passed.saturating_sub(offset) as usize;
        if let Some(bytes) = bytes.get(passed..).filter(|bytes| !bytes.is_empty()) {
            self.skip(offset, passed.saturating_add(bytes.len()));
            self.push(bytes, counters);
        }
    }

    /// Passes none of the `len` bytes from this offset on: they are another's.
    pub(crate) const fn skip(&mut self, offset: u64, len: usize) {
        self.passed = offset.wrapping_add(len as u64);
    }

    /// Queues bytes for the host, as far as there is one and room.
    fn push(&mut self, bytes: &[u8], counters: &mut Counters) {
        match self.state {
            State::Detached | State::Closed => count(&mut counters.unheard_bytes, bytes.len()),
            State::Attached | State::Open => {
                let dropped = self.bytes.push(bytes);
                count(&mut counters.dropped_bytes, dropped);
            }
        }
    }

    /// Bytes before this offset wait no longer. Those behind it begin the next frame.
    pub(crate) fn release(&mut self, offset: u64) {
        let begun = self.passed.saturating_sub(offset) as usize;
        self.due = self.due.max(self.bytes.len().saturating_sub(begun));
        if self.due == 0 && self.transfer == Transfer::Open {
            self.transfer = Transfer::Unterminated;
        }
    }

    /// How many more bytes fill a packet, at least 1.
    pub(crate) fn to_full_packet(&self) -> usize {
        match PACKET.checked_sub(self.bytes.len()) {
            None | Some(0) => PACKET,
            Some(need) => need,
        }
    }

    /// Whether [`transmit`](Self::transmit) has a packet.
    pub(crate) fn is_due(&self) -> bool {
        self.bytes.len() >= PACKET || self.due > 0 || self.transfer == Transfer::Unterminated
    }

    /// Moves the next packet into `packet` and returns its length, 0 for one without data. `None` when none is due.
    pub(crate) fn transmit(&mut self, packet: &mut [u8; PACKET], counters: &mut Counters) -> Option<usize> {
        let len = match self.due {
            _ if self.bytes.len() >= PACKET => PACKET,
            0 if self.transfer == Transfer::Unterminated => 0,
            0 => return None,
            due => due,
        };
        let len = self.bytes.pop(packet.get_mut(..len).unwrap_or_default());
        self.transfer = match len {
            PACKET if self.due == PACKET => Transfer::Unterminated,
            PACKET => Transfer::Open,
            _ => Transfer::Closed,
        };
        self.due = self.due.saturating_sub(len);
        count(&mut counters.packets_to_host, 1);
        count(&mut counters.empty_packets_to_host, usize::from(len == 0));
        Some(len)
    }

    /// Drops what was queued for the host that was.
    fn forget(&mut self, counters: &mut Counters) {
        count(&mut counters.unheard_bytes, self.bytes.len());
        self.bytes.clear();
        self.due = 0;
        self.transfer = Transfer::Closed;
    }
}
