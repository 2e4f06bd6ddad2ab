//! The serial port from the host: the bytes that wait for the arm, and the requests in the bytes that go out.

use core::ops::Range;

use armwire::correlation::Correlation;
use armwire::decoder::{Decoder, Kind, Span};
use armwire::framing::{Framing, Scan};

use crate::arm::Info;
use crate::config::ArmKind;
use crate::control::MAX_FRAME;
use crate::queue::Queue;
use armwire::time::{Duration, Instant};

/// Capacity for bytes of the host on USB that have not gone out yet: enough to keep a 2 Mbaud line busy between USB
/// packets.
pub const TO_ARM_BUFFER: usize = 512;

/// Time that the host may pause inside a request before others get their turn.
const STALL_TIMEOUT: Duration = Duration::from_millis(10);

/// Time that the line must be quiet, in both directions, after bytes outside of requests.
const QUIET_TIME: Duration = Duration::from_millis(5);

/// Maximum time that others wait for a host that sends bytes outside of requests.
const RAW_TURN: Duration = Duration::from_millis(100);

/// The length of a void in bytes: zeros that end every incomplete request in the arm's receiver.
pub(crate) const VOID: usize = ArmKind::VOID.expect("zeros void a request to every arm");

/// Bytes from the host on USB.
pub(crate) struct FromHost {
    bytes: Queue<TO_ARM_BUFFER>,
    /// Decodes the bytes as they go out.
    decoder: Decoder<ArmKind, MAX_FRAME>,
    /// The last bytes that went out belong to no request.
    is_raw: bool,
    /// The number of zeros that are due before the next request of another: up to [`VOID`] if the arm may wait for the
    /// rest of a frame, because the last request was truncated or went out at another rate.
    void_due: usize,
    /// The number of zeros at the end of the bytes that went out, at most [`VOID`].
    zeros: usize,
    /// Start of the host's turn.
    began: Instant,
    /// The last time that bytes went out or were queued on an empty buffer.
    moved: Instant,
    /// Arrival of the oldest and the newest queued bytes, as far as known.
    oldest: Instant,
    newest: Instant,
    /// Waiting time of the first byte of the request in transmission.
    waited: Duration,
}

impl FromHost {
    pub(crate) const fn new() -> Self {
        Self {
            bytes: Queue::new(),
            decoder: Decoder::new(),
            is_raw: false,
            void_due: 0,
            zeros: 0,
            began: Instant::ZERO,
            moved: Instant::ZERO,
            oldest: Instant::ZERO,
            newest: Instant::ZERO,
            waited: Duration::ZERO,
        }
    }

    /// Number of queued bytes.
    pub(crate) const fn len(&self) -> usize {
        self.bytes.len()
    }

    /// Free space in bytes.
    pub(crate) const fn room(&self) -> usize {
        self.bytes.room()
    }

    /// The last time that bytes went out or were queued on an empty buffer.
    pub(crate) const fn moved(&self) -> Instant {
        self.moved
    }

    /// Waiting time of the first byte of the last request.
    pub(crate) const fn waited(&self) -> Duration {
        self.waited
    }

    /// Returns true while the host is inside a sequence that must not be mixed with the requests of others.
    pub(crate) const fn is_in_sequence(&self) -> bool {
        self.is_raw || self.decoder.pending() > 0
    }

    /// The host sent a packet. Returns the number of bytes that did not fit.
    pub(crate) fn push(&mut self, packet: &[u8], now: Instant) -> usize {
        self.touch(now);
        self.bytes.push(packet)
    }

    /// Records the arrival of bytes that wait.
    pub(crate) const fn touch(&mut self, now: Instant) {
        self.newest = now;
        if self.bytes.is_empty() {
            (self.oldest, self.moved) = (now, now);
        }
    }

    /// Copies the next bytes to the front of `out` and returns their number. With `one` they end at the end of a
    /// request.
    pub(crate) fn peek(&self, kind: ArmKind, one: bool, out: &mut [u8]) -> usize {
        let len = self.bytes.peek(out);
        let out = out.get(..len).unwrap_or_default();
        match (one, self.decoder.pending()) {
            (false, _) => len,
            (true, 0) => first_request(kind, out).map_or(len, |request| request.end),
            (true, _) => len.min(self.decoder.need(&kind, kind.requests()).max(1)),
        }
    }

    /// The first complete request in the queue.
    pub(crate) fn peek_request(&self, kind: ArmKind) -> Option<Info> {
        let mut next = [0; MAX_FRAME];
        let len = self.bytes.peek(&mut next);
        let place = first_request(kind, next.get(..len)?)?;
        kind.request(next.get(place)?)
    }

    /// Records the start of a transmission.
    pub(crate) fn begin(&mut self, now: Instant) {
        if !self.is_in_sequence() {
            self.began = now;
        }
    }

    /// Moves up to `len` of the sent bytes to the decoder, as many as fit beside [items](Self::next_span) that were not
    /// taken, and returns their number.
    pub(crate) fn sent(&mut self, len: usize, now: Instant) -> usize {
        if self.decoder.pending() == 0 {
            self.waited = now.since(self.oldest);
        }
        (self.oldest, self.moved) = (self.newest, now);
        let space = self.decoder.space();
        let len = len.min(space.len());
        let len = self.bytes.pop(space.get_mut(..len).unwrap_or_default());
        let sent = space.get(..len).unwrap_or_default();
        let zeros = sent.iter().rev().take_while(|byte| **byte == 0).count();
        let before = if zeros == len { self.zeros } else { 0 };
        self.zeros = before.saturating_add(zeros).min(VOID);
        // The decoder has room for them.
        let _ = self.decoder.commit(len);
        len
    }

    /// Ends the turn of a host that has sent a void. Returns true if it has, once.
    pub(crate) fn end_void(&mut self) -> bool {
        let is_void = self.zeros == VOID && self.is_in_sequence();
        if is_void {
            self.forget_turn();
            self.void_due = 0;
        }
        is_void
    }

    /// Returns true if the arm may wait for the rest of a frame.
    pub(crate) const fn is_cut(&self) -> bool {
        self.void_due > 0
    }

    /// Returns true while zeros are due that must follow others directly.
    pub(crate) const fn is_voiding(&self) -> bool {
        self.void_due > 0 && self.void_due < VOID
    }

    /// The number of zeros that are due before the next request of another.
    pub(crate) const fn void_due(&self) -> usize {
        self.void_due
    }

    /// The arm may wait for the rest of a frame, or no longer does.
    pub(crate) const fn set_cut(&mut self, is_cut: bool) {
        self.void_due = if is_cut { VOID } else { 0 };
    }

    /// This many of the zeros that are due went out.
    pub(crate) const fn voided(&mut self, zeros: usize) {
        self.void_due = self.void_due.saturating_sub(zeros);
    }

    /// The next item of the sent bytes, and the number of bytes after it.
    pub(crate) fn next_span(&mut self, kind: ArmKind) -> Option<(Span, usize)> {
        let span = self.decoder.advance(&kind, kind.requests())?;
        self.is_raw = span.kind != Kind::Frame;
        Some((span, self.decoder.pending()))
    }

    /// The bytes of an item.
    pub(crate) fn bytes(&self, span: Span) -> &[u8] {
        self.decoder.item(span).bytes
    }

    /// The first bytes of a request that went out in part.
    pub(crate) fn begun(&self) -> &[u8] {
        self.decoder.window()
    }

    /// Takes bytes from the front of the queue that are not to go out, and returns their number.
    pub(crate) fn take(&mut self, out: &mut [u8]) -> usize {
        self.bytes.pop(out)
    }

    /// Queues bytes that were [taken](Self::take), or room for which was kept.
    pub(crate) fn admit(&mut self, bytes: &[u8]) {
        self.bytes.push(bytes);
    }

    /// Ends the host's turn. The rest of an incomplete request is no longer expected.
    pub(crate) fn cut(&mut self) {
        if self.decoder.pending() > 0 {
            self.set_cut(true);
        }
        self.decoder.clear();
    }

    /// Ends the host's turn, including raw bytes.
    pub(crate) fn end_turn(&mut self) {
        self.cut();
        self.is_raw = false;
    }

    /// Ends the host's turn. An incomplete request in the arm's receiver no longer matters.
    pub(crate) fn forget_turn(&mut self) {
        self.decoder.clear();
        self.is_raw = false;
    }

    /// Drops all bytes and returns their number.
    pub(crate) fn clear(&mut self) -> usize {
        let dropped = self.bytes.len();
        self.bytes.clear();
        dropped
    }

    /// The time at which the host loses its turn to others that wait `since` then. The arm last sent a byte at
    /// `last_rx`.
    pub(crate) fn turn_timeout(&self, since: Instant, last_rx: Instant) -> Instant {
        let quiet = match self.decoder.pending() {
            0 => self.moved.max(last_rx) + QUIET_TIME,
            _ => self.moved + STALL_TIMEOUT,
        };
        quiet.min(since.max(self.began) + RAW_TURN)
    }
}

fn first_request(kind: ArmKind, bytes: &[u8]) -> Option<Range<usize>> {
    let mut start: usize = 0;
    loop {
        match kind.scan(bytes.get(start..)?, kind.requests()) {
            Scan::Frame(len) => return Some(start..start.saturating_add(len)),
            Scan::Noise(len, _) | Scan::Padding(len) => start = start.saturating_add(len),
            Scan::Need(_) | Scan::Broken(_) => return None,
        }
    }
}
