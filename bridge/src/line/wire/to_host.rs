//! The serial port towards the host: its queued bytes, and the moment at which a packet is due.

use crate::counters::{Counters, count};
use crate::queue::Queue;

/// Bytes in a full USB packet (full speed, bulk).
pub const PACKET: usize = 64;

/// Capacity for bytes of the arm that the host on USB has not read yet: 20 ms of a saturated 1 Mbaud line.
pub const TO_HOST_BUFFER: usize = 2048;

/// The queue towards the host, up to [`TO_HOST_BUFFER`] bytes.
pub(crate) struct ToHost {
    bytes: Queue<TO_HOST_BUFFER>,
    /// The next packet, in one piece. To clear it for each packet would take longer than the copy.
    packet: [u8; PACKET],
    /// The watermark: the first byte of the arm that was not passed, by the decoder's offset.
    passed: u64,
    /// Number of bytes at the front that no longer wait for a full packet.
    due: usize,
    transfer: Transfer,
    state: State,
}

/// The state of the USB transfer towards the host. A short packet ends a transfer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Transfer {
    /// The last packet was short.
    Closed,
    /// The last packet was full, and more bytes are arriving.
    Open,
    /// The last packet was full and took the last bytes: a zero-length packet is due.
    Unterminated,
}

/// The state of the port at the host's end.
///
/// Some hosts never raise DTR: a low DTR means a closed port only after it has been high.
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
            packet: [0; PACKET],
            passed: 0,
            due: 0,
            transfer: Transfer::Closed,
            state: State::Detached,
        }
    }

    /// Returns true if a host has configured the adapter.
    pub(crate) fn is_attached(&self) -> bool {
        self.state != State::Detached
    }

    /// Returns true if a host has the port open, as far as DTR shows.
    pub(crate) fn is_open(&self) -> bool {
        self.state == State::Open
    }

    /// The host enabled or disabled the adapter's configuration.
    pub(crate) fn configured(&mut self, configured: bool, counters: &mut Counters) {
        self.forget(counters);
        self.state = if configured { State::Attached } else { State::Detached };
    }

    /// The host raised or lowered DTR. Returns true if this opened or closed the port.
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

    /// Passes bytes of the arm that were not passed before. The first of `bytes` has this offset.
    pub(crate) fn pass(&mut self, offset: u64, bytes: &[u8], counters: &mut Counters) {
        let passed = self.passed.saturating_sub(offset) as usize;
        if let Some(bytes) = bytes.get(passed..).filter(|bytes| !bytes.is_empty()) {
            self.skip(offset, passed.saturating_add(bytes.len()));
            self.push(bytes, counters);
        }
    }

    /// Skips `len` bytes from this offset on: they belong to another initiator.
    pub(crate) const fn skip(&mut self, offset: u64, len: usize) {
        self.passed = offset.wrapping_add(len as u64);
    }

    /// Queues as many bytes as fit, if there is a host.
    fn push(&mut self, bytes: &[u8], counters: &mut Counters) {
        match self.state {
            State::Detached | State::Closed => count(&mut counters.undelivered_bytes, bytes.len()),
            State::Attached | State::Open => {
                let dropped = self.bytes.push(bytes);
                count(&mut counters.dropped_bytes, dropped);
            }
        }
    }

    /// Makes the bytes before this offset due. The bytes after it begin the next frame.
    pub(crate) fn release(&mut self, offset: u64) {
        let begun = self.passed.saturating_sub(offset) as usize;
        self.due = self.due.max(self.bytes.len().saturating_sub(begun));
        if self.due == 0 && self.transfer == Transfer::Open {
            self.transfer = Transfer::Unterminated;
        }
    }

    /// Returns true if bytes wait for the end of theirs, or a transfer for its next bytes.
    pub(crate) fn waits_for_idle(&self) -> bool {
        self.bytes.len() > self.due || self.transfer == Transfer::Open
    }

    /// Number of bytes that fill up a packet, at least 1.
    pub(crate) fn to_full_packet(&self) -> usize {
        match PACKET.checked_sub(self.bytes.len()) {
            None | Some(0) => PACKET,
            Some(need) => need,
        }
    }

    /// Returns true if [`transmit`](Self::transmit) has a packet.
    pub(crate) fn is_due(&self) -> bool {
        self.next_len().is_some()
    }

    /// The length of the next packet, 0 for a zero-length packet. `None` if none is due.
    fn next_len(&self) -> Option<usize> {
        match self.due {
            _ if self.bytes.len() >= PACKET => Some(PACKET),
            0 if self.transfer == Transfer::Unterminated => Some(0),
            0 => None,
            due => Some(due),
        }
    }

    /// Passes the next packet to `send`, and removes it if that returns true. Returns the length of a packet that was
    /// sent, `None` for none.
    pub(crate) fn transmit(&mut self, send: impl FnOnce(&[u8]) -> bool, counters: &mut Counters) -> Option<usize> {
        let len = self.next_len()?;
        let packet = self.packet.get_mut(..len)?;
        let len = self.bytes.peek(packet);
        if !send(packet) {
            return None;
        }
        self.bytes.skip(len);
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

    /// Drops the bytes queued for the previous host.
    fn forget(&mut self, counters: &mut Counters) {
        count(&mut counters.undelivered_bytes, self.bytes.len());
        self.bytes.clear();
        self.due = 0;
        self.transfer = Transfer::Closed;
    }
}
