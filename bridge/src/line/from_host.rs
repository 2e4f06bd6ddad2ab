//! The serial port from the host: the bytes that wait for the arm, and the requests among those that go out.

use core::ops::Range;

use armwire::decoder::{Decoder, Item, Kind};
use armwire::dialect::Dialect;
use armwire::framing::{Framing, Scan};

use crate::arm::Info;
use crate::config::ArmKind;
use crate::control::MAX_FRAME;
use crate::queue::Queue;
use armwire::time::{Duration, Instant};

/// Room for bytes of the host on USB that have not gone out yet: enough to keep a 2 Mbaud line busy while USB brings more.
pub const TO_ARM_BUFFER: usize = 512;

/// How long the host may pause inside a request before others get their turn.
const STALL_TIMEOUT: Duration = Duration::from_millis(10);

/// How long the line must be quiet, both ways, after bytes that are no request.
const QUIET_TIME: Duration = Duration::from_millis(5);

/// How long others wait at most for a host that sends bytes that are no request.
const RAW_TURN: Duration = Duration::from_millis(100);

/// Bytes from the host on USB.
pub(crate) struct FromHost {
    bytes: Queue<TO_ARM_BUFFER>,
    /// Reads the bytes as they go out.
    decoder: Decoder<MAX_FRAME>,
    /// The last bytes that went out are in no request.
    is_raw: bool,
    /// The arm may wait for the rest of a frame: the last request was cut short, or went out at another rate.
    pub(crate) is_cut: bool,
    /// When the host took its turn.
    began: Instant,
    /// When bytes last went out, or began to wait.
    moved: Instant,
    /// When the oldest and the newest of the bytes that wait came, as far as that is known.
    oldest: Instant,
    newest: Instant,
    /// How long the first byte of the request that goes out has waited.
    waited: Duration,
}

impl FromHost {
    pub(crate) const fn new() -> Self {
        Self {
            bytes: Queue::new(),
            decoder: Decoder::new(),
            is_raw: false,
            is_cut: false,
            began: Instant::ZERO,
            moved: Instant::ZERO,
            oldest: Instant::ZERO,
            newest: Instant::ZERO,
            waited: Duration::ZERO,
        }
    }

    /// How many bytes wait.
    pub(crate) const fn len(&self) -> usize {
        self.bytes.len()
    }

    /// How many more bytes fit.
    pub(crate) const fn room(&self) -> usize {
        self.bytes.room()
    }

    /// When bytes last went out, or began to wait.
    pub(crate) const fn moved(&self) -> Instant {
        self.moved
    }

    /// How long the first byte of the last request waited.
    pub(crate) const fn waited(&self) -> Duration {
        self.waited
    }

    /// Whether the host is in the middle of something that is not to be mixed with others' requests.
    pub(crate) const fn is_speaking(&self) -> bool {
        self.is_raw || self.decoder.pending() > 0
    }

    /// The host sent a packet. Returns the number of bytes that did not fit.
    pub(crate) fn push(&mut self, packet: &[u8], now: Instant) -> usize {
        self.touch(now);
        self.bytes.push(packet)
    }

    /// Something that waits came from the host.
    pub(crate) const fn touch(&mut self, now: Instant) {
        self.newest = now;
        if self.bytes.is_empty() {
            (self.oldest, self.moved) = (now, now);
        }
    }

    /// Copies the bytes that go out next to the front of `out` and returns their number: up to the end of a request if only
    /// `one` is to go.
    pub(crate) fn peek(&self, kind: ArmKind, one: bool, out: &mut [u8]) -> usize {
        let len = self.bytes.peek(out);
        let out = out.get(..len).unwrap_or_default();
        match (one, self.decoder.pending()) {
            (false, _) => len,
            (true, 0) => first_request(kind, out).map_or(len, |request| request.end),
            (true, _) => len.min(self.decoder.need(&kind, kind.requests()).max(1)),
        }
    }

    /// The first whole request of those that wait.
    pub(crate) fn peek_request(&self, kind: ArmKind) -> Option<Info> {
        let mut next = [0; MAX_FRAME];
        let len = self.bytes.peek(&mut next);
        let place = first_request(kind, next.get(..len)?)?;
        kind.request(next.get(place)?)
    }

    /// Bytes go out.
    pub(crate) fn begin(&mut self, now: Instant) {
        if !self.is_speaking() {
            self.began = now;
        }
    }

    /// Moves up to `len` of the bytes that went out to the decoder, and returns their number. Take all
    /// [items](Self::next_item) before the next.
    pub(crate) fn sent(&mut self, len: usize, now: Instant) -> usize {
        if self.decoder.pending() == 0 {
            self.waited = now.since(self.oldest);
        }
        (self.oldest, self.moved) = (self.newest, now);
        let space = self.decoder.space();
        let len = len.min(space.len());
        let len = self.bytes.pop(space.get_mut(..len).unwrap_or_default());
        // There is room for them.
        let _ = self.decoder.commit(len);
        len
    }

    /// The next item of the bytes that went out, and how many of them are behind it.
    pub(crate) fn next_item(&mut self, kind: ArmKind) -> Option<(Item<'_>, usize)> {
        let span = self.decoder.advance(&kind, kind.requests())?;
        self.is_raw = span.kind != Kind::Frame;
        let behind = self.decoder.pending();
        Some((self.decoder.item(span), behind))
    }

    /// The host's turn is over: the rest of a request that went out in part is not waited for.
    pub(crate) fn cut(&mut self) {
        self.is_cut |= self.decoder.pending() > 0;
        self.decoder.clear();
    }

    /// The host's turn is over, raw bytes included.
    pub(crate) fn end_turn(&mut self) {
        self.cut();
        self.is_raw = false;
    }

    /// The host's turn is over, and it does not matter what the arm may wait for.
    pub(crate) fn forget_turn(&mut self) {
        self.decoder.clear();
        self.is_raw = false;
    }

    /// Drops the bytes behind the first `len` and returns their number.
    pub(crate) fn truncate(&mut self, len: usize) -> usize {
        let before = self.bytes.len();
        self.bytes.truncate(len);
        before.saturating_sub(len)
    }

    /// When the host loses its turn to those who wait `since` then, where the arm was last heard at `last_rx`.
    pub(crate) fn turn_timeout(&self, since: Instant, last_rx: Instant) -> Instant {
        let quiet = match self.decoder.pending() {
            0 => self.moved.max(last_rx) + QUIET_TIME,
            _ => self.moved + STALL_TIMEOUT,
        };
        quiet.min(since.max(self.began) + RAW_TURN)
    }
}

/// The place of the first request in these bytes.
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
