//! Reports of the line: counters, latencies, and the frames and events for the hosts' side.

use armwire::time::Instant;

use crate::control::{Event, FrameBytes, Initiator, Latencies, Refusal};
use crate::counters::{Counters, UartErrors, count};
use crate::events::{EventQueue, Queued};

/// The reports. All owners of the line's state write into them, and none decides by them.
pub(crate) struct Journal {
    pub(super) counters: Counters,
    pub(super) latencies: Latencies,
    deliveries: EventQueue,
    /// Receivers other than the host on USB get all frames.
    is_watched: bool,
}

impl Journal {
    pub(super) fn new() -> Self {
        Self {
            counters: Counters::default(),
            latencies: Latencies::default(),
            deliveries: EventQueue::new(),
            is_watched: false,
        }
    }

    /// A frame that answers a request of this initiator arrived. It is delivered if it has a receiver other than the
    /// host on USB.
    pub(super) fn frame(&mut self, initiator: Option<Initiator>, bytes: &[u8], at: Instant) {
        let is_wanted = self.is_watched || matches!(initiator, Some(Initiator::Can));
        if is_wanted && !self.deliveries.push_frame(at, initiator, bytes) {
            let dropped = match initiator {
                Some(Initiator::Can) => &mut self.counters.dropped_can_answers,
                _ => &mut self.counters.dropped_events,
            };
            count(dropped, 1);
        }
    }

    /// A request was refused.
    #[cold]
    pub(super) fn refused(&mut self, initiator: Initiator, reason: Refusal, now: Instant) {
        self.count_refusal(reason);
        self.report(&Event::Refused { initiator, reason }, now);
    }

    pub(super) const fn count_refusal(&mut self, reason: Refusal) {
        let c = &mut self.counters;
        let counter = match reason {
            Refusal::QueueFull => &mut c.refused_can_requests,
            Refusal::NotAFrame => &mut c.refused_can_frames,
            Refusal::Incomplete => &mut c.commands_incomplete,
            Refusal::Stale => &mut c.commands_stale,
            Refusal::OutOfRange => &mut c.commands_out_of_range,
            Refusal::LineReserved => &mut c.refused_line_reserved,
            Refusal::OtherRate => &mut c.refused_other_rate,
            Refusal::Stopped => &mut c.refused_stopped,
        };
        *counter = counter.wrapping_add(1);
    }

    /// An event other than a frame.
    pub(super) fn report(&mut self, event: &Event, at: Instant) {
        if !self.deliveries.push(at, event) {
            count(&mut self.counters.dropped_events, 1);
        }
    }

    pub(super) fn count_errors(&mut self, errors: &UartErrors) {
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

    /// The next frame, with its bytes in `bytes`, or event.
    pub(super) fn delivery(&mut self, bytes: &mut FrameBytes) -> Option<(Instant, Queued)> {
        self.deliveries.pop(bytes)
    }

    /// Returns true if the frames of any packet fit.
    pub(super) const fn has_room(&self) -> bool {
        self.deliveries.has_room()
    }

    pub(super) const fn has_delivery(&self) -> bool {
        !self.deliveries.is_empty()
    }

    /// Enables the delivery of all frames to receivers other than the host on USB.
    pub(super) const fn watch(&mut self, is_watched: bool) {
        self.is_watched = is_watched;
    }
}
