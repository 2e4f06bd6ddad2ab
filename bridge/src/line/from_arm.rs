//! Bytes from the arm: frames, answers and their initiators.

use armwire::decoder::Kind;
use armwire::exchange::{FirstByte, Match};
use armwire::framing::Framing;
use armwire::time::Instant;

use crate::control::{Failure, FrameBytes, Initiator};
use crate::counters::{UartErrors, count};
use crate::events::Queued;

use super::Line;
use super::to_arm::on_wire;

/// Maximum age of the known state of the line while bytes arrive, in nanoseconds.
const MAX_AGE_NANOS: u32 = 1_000_000;

/// The number of bytes that the UART must receive before any work can be due, apart from an idle line and errors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct RxThreshold {
    /// This many bytes of any value, at least 1.
    pub max: usize,
    /// At least this many if the last of them is the terminator.
    pub min: usize,
    /// The last byte of the next frame. `None` if it is unknown, or if the number of missing bytes is known.
    pub terminator: Option<u8>,
}

impl RxThreshold {
    /// Returns true if these `bytes`, the last of which is `last`, reach the threshold.
    pub fn is_met(&self, bytes: usize, last: u8) -> bool {
        bytes >= self.max || bytes >= self.min && self.terminator == Some(last)
    }
}

impl Line {
    /// Handles bytes from the UART, the last of which arrived at `at`. Returns the number of frames that ended.
    pub(crate) fn received(&mut self, bytes: &[u8], at: Instant) -> usize {
        self.last_rx_poll = at;
        if bytes.is_empty() {
            return 0;
        }
        self.last_rx = at;
        count(&mut self.counters.arm_to_host_bytes, bytes.len());
        let mut frames: usize = 0;
        let mut rest = bytes;
        while !rest.is_empty() {
            rest = self.decoder.push(rest);
            self.pass();
            frames = frames.saturating_add(self.take_items(at));
        }
        if frames > 0 {
            self.to_host.release(self.decoder.offset());
        }
        frames
    }

    /// The line was idle for one byte time: received bytes become due. Returns the number of frames that this ended.
    pub(crate) fn idle(&mut self, now: Instant) -> usize {
        self.decoder.idle();
        let frames = self.take_items(now);
        self.to_host.release(self.decoder.offset());
        frames
    }

    /// The UART reported errors. The bytes received with them are passed on unchanged.
    pub(crate) fn errors(&mut self, errors: &UartErrors) {
        let c = &mut self.counters;
        for (counter, errors) in [
            (&mut c.framing_errors, errors.framing),
            (&mut c.parity_errors, errors.parity),
            (&mut c.noise_errors, errors.noise),
            (&mut c.overrun_errors, errors.overrun),
            (&mut c.ring_overruns, errors.ring_overrun),
            (&mut c.late_stamps, errors.late_stamps),
        ] {
            *counter = counter.wrapping_add(errors);
        }
    }

    pub(crate) fn rx_threshold(&self) -> RxThreshold {
        let expect = self.exchange.expect(&self.kind);
        let max_unread = MAX_AGE_NANOS.checked_div(self.rate.byte_nanos()).unwrap_or(0) as usize;
        let room = self.to_host.to_full_packet();
        let need = self.decoder.need(&self.kind, expect).max(1);
        // The terminator may also occur inside a frame: it marks the end only where the length is unknown.
        match self.kind.terminator(expect).filter(|_| self.decoder.pending() == 0) {
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

    /// Passes undecided bytes to the host on USB, unless they may belong to another initiator.
    pub(super) fn pass(&mut self) {
        if self.decoder.pending() > 0 && !self.is_anothers() {
            let (offset, window) = (self.decoder.offset(), self.decoder.window());
            self.to_host.pass(offset, window, &mut self.counters);
        }
    }

    /// Takes the decoder's items, and returns the number of frames.
    pub(super) fn take_items(&mut self, at: Instant) -> usize {
        let mut frames: usize = 0;
        while let Some(span) = self.decoder.advance(&self.kind, self.exchange.expect(&self.kind)) {
            let item = self.decoder.item(span);
            if item.kind != Kind::Frame {
                if let Kind::Noise(_) = item.kind {
                    count(&mut self.counters.noise_bytes, item.bytes.len());
                }
                self.to_host.pass(item.offset, item.bytes, &mut self.counters);
                continue;
            }
            frames = frames.saturating_add(1);
            count(&mut self.counters.frames, 1);
            let before = on_wire(self.rate.byte_nanos(), item.bytes.len().saturating_sub(1));
            let first = FirstByte {
                offset: item.offset,
                at: Some(at - before),
            };
            self.exchange.expire(at - before);
            let initiator = match self.exchange.on_frame(&self.kind, item.bytes, first, at) {
                Match::Answer { who, sent } => {
                    self.latencies.answer.add(at.since(sent));
                    Some(who)
                }
                Match::Late(_) => {
                    count(&mut self.counters.late_answers, 1);
                    None
                }
                Match::Unsolicited => {
                    count(&mut self.counters.unsolicited_frames, 1);
                    None
                }
            };
            match initiator {
                None | Some(Initiator::Usb) => self.to_host.pass(item.offset, item.bytes, &mut self.counters),
                Some(_) => self.to_host.skip(item.offset, item.bytes.len()),
            }
            let is_wanted = self.is_watched || matches!(initiator, Some(Initiator::Can));
            if is_wanted && !self.deliveries.push_frame(at, initiator, item.bytes) {
                let dropped = match initiator {
                    Some(Initiator::Can) => &mut self.counters.dropped_can_answers,
                    _ => &mut self.counters.dropped_events,
                };
                count(dropped, 1);
            }
            let is_reading = self.stop.is_running() && self.stop.on_frame(initiator, item.bytes, at);
            if initiator == Some(Initiator::Adapter) && self.is_identifying {
                self.identified = Some(Ok(FrameBytes::from_slice(item.bytes).ok()));
            }
            if let Some(initiator) = initiator.filter(|_| self.holder().is_none()) {
                self.exchange_ended(initiator, at);
            }
            if is_reading {
                self.step_stop(at);
            }
        }
        frames
    }

    /// The next frame, with its bytes in `bytes`, or event for the hosts' side.
    pub(crate) fn delivery(&mut self, bytes: &mut FrameBytes) -> Option<(Instant, Queued)> {
        self.deliveries.pop(bytes)
    }

    /// Returns true if the frames of any packet fit.
    pub(crate) const fn has_delivery_room(&self) -> bool {
        self.deliveries.has_room()
    }

    pub(crate) const fn has_delivery(&self) -> bool {
        !self.deliveries.is_empty()
    }

    /// Enables the delivery of all frames to receivers other than the host on USB.
    pub(crate) const fn watch(&mut self, is_watched: bool) {
        self.is_watched = is_watched;
    }

    /// The result of an [identification](Self::identify), returned once: `None` in it if the arm did not answer.
    pub(crate) const fn identified(&mut self) -> Option<Result<Option<FrameBytes>, Failure>> {
        self.identified.take()
    }

    /// The initiator whose request is in flight.
    pub(crate) fn holder(&self) -> Option<Initiator> {
        self.exchange.holder()
    }

    /// Returns true if the next answer is for an initiator other than the host on USB: the arm's bytes are held back
    /// until their frame is known.
    pub(super) fn is_anothers(&self) -> bool {
        self.holder().is_some_and(|holder| holder != Initiator::Usb)
    }

    /// The last request of an initiator is answered, or its answer is missing.
    pub(super) fn exchange_ended(&mut self, initiator: Initiator, now: Instant) {
        self.last_tx = now;
        match initiator {
            Initiator::Poll => {
                let missed = self.poll.ended(now);
                count(&mut self.counters.missed_polls, missed);
            }
            Initiator::Adapter => {
                if core::mem::take(&mut self.is_identifying) {
                    self.identified.get_or_insert(Ok(None));
                }
            }
            Initiator::Usb | Initiator::Can | Initiator::Command => {}
        }
        self.pass();
    }
}
