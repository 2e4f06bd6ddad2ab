//! Bytes from the arm, and what follows from its frames.

use armwire::decoder::Span;
use armwire::framing::Length;
use armwire::time::Instant;

use crate::arm::OwnRequest;
use crate::control::{FrameBytes, Initiator};
use crate::counters::{UartErrors, count};
use crate::events::Queued;

use super::Line;
use super::wire::RxThreshold;

/// A frame that is not accounted for.
pub(super) struct OpenFrame {
    span: Span,
    at: Instant,
    /// The host on USB has its bytes.
    pub(super) is_passed: bool,
}

impl Line {
    /// Handles bytes from the UART, the last of which arrived at `at`. Returns the number of frames that ended. The last
    /// of them is returned to be [settled](Self::settle) later if nothing that was received depends on it, and something
    /// can be done before: its packet, or the next poll.
    pub(super) fn received(&mut self, bytes: &[u8], at: Instant) -> (usize, Option<OpenFrame>) {
        self.wire.read(bytes.len(), at);
        count(&mut self.journal.counters.arm_to_host_bytes, bytes.len());
        let mut frames: usize = 0;
        let mut open = None;
        let mut rest = bytes;
        while !rest.is_empty() {
            rest = self.wire.push(rest, &mut self.journal);
            while let Some(span) = self.wire.next_frame(self.kind, &mut self.journal) {
                frames = frames.saturating_add(1);
                let is_passed = !self.wire.is_anothers();
                if rest.is_empty() && self.wire.is_decided() && (is_passed || self.outbox.polls_only()) {
                    open = Some(OpenFrame { span, at, is_passed });
                    break;
                }
                self.frame_ended(span, at);
            }
        }
        if frames > 0 {
            self.wire.release();
        }
        (frames, open)
    }

    /// Accounts for a frame.
    pub(super) fn settle(&mut self, frame: OpenFrame) {
        self.frame_ended(frame.span, frame.at);
        if !frame.is_passed {
            // They may be for the host on USB after all.
            self.wire.release();
        }
    }

    /// The poll that is due with a frame that is not accounted for: the frame answers the last poll, which is all that
    /// the adapter does on the line.
    pub(super) fn poll_after(&self, frame: &OpenFrame) -> Option<&'static [u8]> {
        let OpenFrame { span, at, .. } = *frame;
        let byte_time = self.guard.rate.byte_time();
        let is_due = self.outbox.polls_only()
            && !self.guard.stop.is_running()
            && self.guard.rate.change(0).is_none()
            && self
                .wire
                .is_last_answer(Initiator::Poll, span, self.kind, byte_time, at);
        self.kind.own(OwnRequest::Poll).filter(|_| is_due)
    }

    /// The line was idle for one byte time: received bytes become due. Returns the number of frames that this ended.
    pub(crate) fn idle(&mut self, now: Instant) -> usize {
        self.wire.idle();
        let mut frames: usize = 0;
        while let Some(span) = self.wire.next_frame(self.kind, &mut self.journal) {
            frames = frames.saturating_add(1);
            self.frame_ended(span, now);
        }
        self.wire.release();
        frames
    }

    /// The UART reported errors. The bytes received with them are passed on unchanged.
    pub(crate) fn errors(&mut self, errors: &UartErrors) {
        self.journal.count_errors(errors);
    }

    pub(crate) fn rx_threshold(&self) -> RxThreshold {
        self.wire.rx_threshold(self.kind, self.guard.rate.byte_time())
    }

    /// The place of the next frame's length, if none of its bytes was received.
    pub(crate) fn rx_length(&self) -> Option<Length> {
        self.wire.rx_length(self.kind)
    }

    /// Returns true if an idle line can change anything.
    pub(crate) fn waits_for_idle(&self) -> bool {
        self.wire.waits_for_idle()
    }

    /// Handles a frame whose last byte arrived at `at`.
    fn frame_ended(&mut self, span: Span, at: Instant) {
        let byte_time = self.guard.rate.byte_time();
        let answered = self.wire.assign(span, self.kind, byte_time, at, &mut self.journal);
        let mut is_reading = false;
        if let Some(request) = answered {
            let frame = self.wire.bytes(span);
            is_reading = self.guard.stop.is_running() && self.guard.stop.on_frame(request, frame, at);
            if !request.is_late {
                if request.by == Initiator::Adapter {
                    self.outbox.adapter_answered(frame);
                }
                self.end_exchange(request.by, at);
            }
        }
        if is_reading {
            self.step_stop(at);
        }
    }

    /// A request of an initiator is answered, or its answer is missing. The last one ends the exchange.
    pub(super) fn end_exchange(&mut self, initiator: Initiator, now: Instant) {
        if self.wire.open_initiator().is_none() {
            self.outbox.exchange_ended(initiator, now, &mut self.journal);
            self.wire.pass(&mut self.journal);
        }
    }

    /// Ends the exchanges whose answers are missing at `now`.
    pub(super) fn tick_exchange(&mut self, now: Instant) {
        while let Some(initiator) = self.wire.next_missing(now, &mut self.journal) {
            self.end_exchange(initiator, now);
        }
    }

    /// The next frame, with its bytes in `bytes`, or event for the hosts' side.
    pub(crate) fn delivery(&mut self, bytes: &mut FrameBytes) -> Option<(Instant, Queued)> {
        self.journal.delivery(bytes)
    }

    /// Returns true if the frames of any packet fit.
    pub(crate) const fn has_delivery_room(&self) -> bool {
        self.journal.has_room()
    }

    pub(crate) const fn has_delivery(&self) -> bool {
        self.journal.has_delivery()
    }

    /// Enables the delivery of all frames to receivers other than the host on USB.
    pub(crate) const fn watch(&mut self, is_watched: bool) {
        self.journal.watch(is_watched);
    }

    /// The initiator whose request is in flight.
    pub(crate) fn open_initiator(&self) -> Option<Initiator> {
        self.wire.open_initiator()
    }
}
