//! Bytes of the arm: those for the host on USB, frames, and the requests that they answer.

mod rx_threshold;
mod to_host;

use armwire::decoder::{Decoder, Kind, Span};
use armwire::exchange::{Exchange, FirstByte, Handover, Match};
use armwire::framing::{Framing, Length};
use armwire::time::{Duration, Instant};

use crate::arm::Info;
use crate::config::ArmKind;
use crate::control::{Initiator, MAX_FRAME};
use crate::counters::count;

use super::byte_time::ByteTime;
use super::journal::Journal;
use to_host::ToHost;

pub use rx_threshold::RxThreshold;
pub use to_host::{PACKET, TO_HOST_BUFFER};

/// Maximum number of requests in flight that are tracked one by one.
const MAX_PENDING: usize = 8;

/// Time after its timeout during which an answer may still arrive.
const STALE_WINDOW: Duration = Duration::from_millis(50);

/// Maximum age of the known state of the line while bytes arrive, in nanoseconds.
const MAX_AGE_NANOS: u32 = 1_000_000;

/// The adapter's own share of an answer's time: two bytes in the transmitter, and the latency of the receiver.
const MARGIN: Duration = Duration::from_millis(1);

/// A request that a frame answers.
#[derive(Clone, Copy)]
pub(crate) struct Answered {
    /// Its initiator.
    pub(super) by: Initiator,
    /// The time of its last byte on the line.
    pub(super) sent: Instant,
    /// It had timed out before.
    pub(super) is_late: bool,
}

/// The arm's bytes, the requests in flight, and the serial port towards the host on USB.
pub(crate) struct Wire {
    decoder: Decoder<ArmKind, MAX_FRAME>,
    exchange: Exchange<ArmKind, Initiator, MAX_PENDING>,
    to_host: ToHost,
    last_read: Instant,
    last_byte: Instant,
}

impl Wire {
    pub(super) const fn new() -> Self {
        Self {
            decoder: Decoder::new(),
            exchange: Exchange::new(STALE_WINDOW),
            to_host: ToHost::new(),
            last_read: Instant::ZERO,
            last_byte: Instant::ZERO,
        }
    }

    // ---- Bytes of the arm ----

    /// The UART was read, with or without bytes.
    pub(super) const fn read(&mut self, bytes: usize, at: Instant) {
        self.last_read = at;
        if bytes > 0 {
            self.last_byte = at;
        }
    }

    /// The time of the last read of the UART.
    pub(super) const fn last_read(&self) -> Instant {
        self.last_read
    }

    /// The time of the arm's last byte.
    pub(super) const fn last_byte(&self) -> Instant {
        self.last_byte
    }

    /// Takes as many bytes as fit, and returns the rest, which fits once the [frames](Self::next_frame) were taken.
    pub(super) fn push<'b>(&mut self, bytes: &'b [u8], journal: &mut Journal) -> &'b [u8] {
        let rest = self.decoder.push(bytes);
        self.pass(journal);
        rest
    }

    /// The line is idle: the rest of an unfinished frame is no longer expected.
    pub(super) const fn idle(&mut self) {
        self.decoder.idle();
    }

    /// The place of the next frame's length, if none of its bytes was received.
    pub(super) fn rx_length(&self, kind: ArmKind) -> Option<Length> {
        let is_between = self.decoder.pending() == 0 && self.decoder.skipping() == 0;
        is_between.then(|| kind.length(self.exchange.expect(&kind)))?
    }

    /// Returns true if an idle line can change anything.
    pub(super) fn waits_for_idle(&self) -> bool {
        self.decoder.pending() > 0 || self.decoder.skipping() > 0 || self.to_host.waits_for_idle()
    }

    /// Passes undecided bytes to the host on USB, unless they may belong to another initiator.
    pub(super) fn pass(&mut self, journal: &mut Journal) {
        if self.decoder.pending() > 0 && !self.is_anothers() {
            let (offset, window) = (self.decoder.offset(), self.decoder.window());
            self.to_host.pass(offset, window, &mut journal.counters);
        }
    }

    /// The next frame. Bytes before it are passed to the host on USB.
    pub(super) fn next_frame(&mut self, kind: ArmKind, journal: &mut Journal) -> Option<Span> {
        loop {
            let span = self.decoder.advance(&kind, self.exchange.expect(&kind))?;
            let item = self.decoder.item(span);
            if item.kind == Kind::Frame {
                return Some(span);
            }
            if let Kind::Noise(_) = item.kind {
                count(&mut journal.counters.noise_bytes, item.bytes.len());
            }
            self.to_host.pass(item.offset, item.bytes, &mut journal.counters);
        }
    }

    /// Returns true if no byte waits for a verdict.
    pub(super) const fn is_decided(&self) -> bool {
        self.decoder.pending() == 0
    }

    /// Returns true if a frame answers the only request in flight, which is the initiator's.
    pub(super) fn is_last_answer(
        &self,
        initiator: Initiator,
        span: Span,
        kind: ArmKind,
        byte_time: ByteTime,
        at: Instant,
    ) -> bool {
        let (first, frame) = (first_byte(span, byte_time, at), self.bytes(span));
        self.exchange.is_last_answer(&kind, initiator, frame, first)
    }

    /// Finds the request that a frame answers, and passes the frame to its receivers. Its last byte arrived at `at`.
    pub(super) fn assign(
        &mut self,
        span: Span,
        kind: ArmKind,
        byte_time: ByteTime,
        at: Instant,
        journal: &mut Journal,
    ) -> Option<Answered> {
        let item = self.decoder.item(span);
        count(&mut journal.counters.frames, 1);
        let first = first_byte(span, byte_time, at);
        let answered = match self.exchange.on_frame(&kind, item.bytes, first, at) {
            Match::Answer { who, sent } => {
                journal.latencies.answer.add(at.since(sent));
                let is_late = false;
                Some(Answered { by: who, sent, is_late })
            }
            Match::Late { who, sent } => {
                count(&mut journal.counters.late_answers, 1);
                let is_late = true;
                Some(Answered { by: who, sent, is_late })
            }
            Match::Unsolicited => {
                count(&mut journal.counters.unsolicited_frames, 1);
                None
            }
        };
        let in_time = answered.filter(|request| !request.is_late);
        let initiator = in_time.map(|request| request.by);
        match initiator {
            None | Some(Initiator::Usb) => self.to_host.pass(item.offset, item.bytes, &mut journal.counters),
            Some(_) => self.to_host.skip(item.offset, item.bytes.len()),
        }
        journal.frame(initiator, item.bytes, at);
        answered
    }

    /// The bytes of a frame. They are valid until the next bytes are pushed.
    pub(super) fn bytes(&self, span: Span) -> &[u8] {
        self.decoder.item(span).bytes
    }

    /// Makes decided bytes due for the host on USB.
    pub(super) fn release(&mut self) {
        self.to_host.release(self.decoder.offset());
    }

    pub(super) fn rx_threshold(&self, kind: ArmKind, byte_time: ByteTime) -> RxThreshold {
        let expect = self.exchange.expect(&kind);
        let max_unread = byte_time.bytes_in(MAX_AGE_NANOS);
        let room = self.to_host.to_full_packet();
        let need = self.decoder.need(&kind, expect).max(1);
        // The terminator may also occur inside a frame: it marks the end only where the length is unknown.
        match kind.terminator(expect).filter(|_| self.decoder.pending() == 0) {
            Some(terminator) => RxThreshold {
                max: max_unread.max(need).min(room),
                min: need,
                terminator: Some(terminator),
            },
            None => {
                let max = need.min(max_unread.max(1)).min(room);
                RxThreshold {
                    max,
                    min: max,
                    terminator: None,
                }
            }
        }
    }

    // ---- Requests in flight ----

    /// The initiator of the oldest open exchange: its request is in flight.
    pub(super) fn open_initiator(&self) -> Option<Initiator> {
        self.exchange.open_initiator()
    }

    /// Returns true if the next answer is for an initiator other than the host on USB: the arm's bytes are kept
    /// until their frame is known.
    pub(super) fn is_anothers(&self) -> bool {
        self.open_initiator()
            .is_some_and(|initiator| initiator != Initiator::Usb)
    }

    /// Returns true if no answer is missing.
    pub(super) fn is_idle(&self) -> bool {
        self.exchange.is_idle()
    }

    /// Returns true if the answer to a request could be distinguished from all answers that may still arrive.
    pub(super) fn can_send(&self, info: &Info, initiator: Initiator) -> bool {
        self.exchange.can_send(info, initiator)
    }

    /// Tracks a request whose last byte is out at `end`, if it has an answer.
    pub(super) fn track(
        &mut self,
        initiator: Initiator,
        info: Option<Info>,
        end: Instant,
        byte_time: ByteTime,
        journal: &mut Journal,
    ) {
        let Some((info, response)) = info.and_then(|info| Some((info, info.response?))) else {
            return;
        };
        let longest = usize::from(response.longest).min(MAX_FRAME);
        let handover = Handover {
            offset: self.decoder.received(),
            at: end,
            due: end + response.turnaround + byte_time.times(longest) + MARGIN,
        };
        self.exchange.begin(info, initiator, handover);
        count(
            &mut journal.counters.untracked_requests,
            self.exchange.is_saturated().into(),
        );
    }

    /// The initiator of the next request whose answer is missing at `now`, each once.
    pub(super) fn next_missing(&mut self, now: Instant, journal: &mut Journal) -> Option<Initiator> {
        let initiator = self.exchange.on_timeout(now)?;
        count(&mut journal.counters.unanswered_requests, 1);
        Some(initiator)
    }

    /// The time of the next missing answer, or of the end of a wait for a late one.
    pub(super) fn timeout(&self) -> Option<Instant> {
        self.exchange.timeout()
    }

    /// Ends all exchanges, for another kind of arm. Returns the initiator whose request was in flight.
    pub(super) fn end_exchanges(&mut self, journal: &mut Journal) -> Option<Initiator> {
        let initiator = self.open_initiator();
        let missing = self.exchange.clear();
        count(&mut journal.counters.unanswered_requests, missing);
        initiator
    }

    /// Drops the bytes of an unfinished frame, for another kind of arm.
    pub(super) fn drop_unfinished(&mut self) {
        self.decoder.clear();
    }

    // ---- The serial port towards the host on USB ----

    pub(super) const fn to_host(&self) -> &ToHost {
        &self.to_host
    }

    /// The host enabled or disabled the adapter's configuration.
    pub(super) fn usb_configured(&mut self, configured: bool, journal: &mut Journal) {
        self.to_host.configured(configured, &mut journal.counters);
    }

    /// The host raised or lowered DTR. Returns true if this opened or closed the port.
    pub(super) fn dtr(&mut self, high: bool, journal: &mut Journal) -> bool {
        self.to_host.dtr(high, &mut journal.counters)
    }

    /// Passes the next packet for the host to `send`, and removes it if that returns true.
    pub(super) fn send_packet(&mut self, send: impl FnOnce(&[u8]) -> bool, journal: &mut Journal) -> Option<usize> {
        self.to_host.transmit(send, &mut journal.counters)
    }
}

/// The first byte of a frame whose last byte arrived at `at`.
fn first_byte(frame: Span, byte_time: ByteTime, at: Instant) -> FirstByte {
    FirstByte {
        offset: frame.offset,
        at: Some(at - byte_time.times(frame.len().saturating_sub(1))),
    }
}
