//! Requests of initiators other than the host on USB, and refusals.

use armwire::time::Instant;

use crate::arm::OwnRequest;
use crate::control::{Event, Failure, Initiator, Refusal};
use crate::counters::count;

use super::Line;
use super::requests::Request;

/// The reason for a request that was not accepted.
pub(crate) enum NotTaken {
    /// The queue is full now.
    Full,
    Refused(Refusal),
}

impl Line {
    /// Queues a request of a host on CAN that was complete at `arrived`.
    pub(crate) fn request(&mut self, bytes: &[u8], arrived: Instant) -> Result<(), NotTaken> {
        if self.requests.can.is_full() {
            return Err(NotTaken::Full);
        }
        let request = Some(bytes).filter(|bytes| self.kind.is_request(bytes));
        let Some(request) = request.and_then(|bytes| Request::new(self.kind, bytes, arrived)) else {
            return Err(NotTaken::Refused(Refusal::NotAFrame));
        };
        if self.is_held {
            return Err(NotTaken::Refused(Refusal::LineHeld));
        }
        if self.stop.refuses_motion() && request.is_motion() {
            return Err(NotTaken::Refused(Refusal::Stopped));
        }
        if request.is_motion() {
            self.dead_man.motion(Initiator::Can, arrived);
        }
        // The queue is not full.
        let _ = self.requests.can.push_back(request);
        Ok(())
    }

    /// Queues a motion request of cyclic commands. It replaces the one that waits.
    pub(crate) fn command(&mut self, bytes: &[u8], now: Instant) {
        if self.is_held {
            return self.refuse(Initiator::Command, Refusal::LineHeld, now);
        }
        if self.stop.refuses_motion() {
            return self.refuse(Initiator::Command, Refusal::Stopped, now);
        }
        let waiting = self.requests.command.take();
        self.requests.command = Request::new(self.kind, bytes, now);
        self.dead_man.motion(Initiator::Command, now);
        if waiting.is_some() {
            self.refuse(Initiator::Command, Refusal::QueueFull, now);
        }
    }

    /// Queues an identification request. Its result is [`identified`](Self::identified).
    pub(crate) fn identify(&mut self, now: Instant) {
        if self.kind.own(OwnRequest::Identify).is_none() {
            self.identified = Some(Ok(None));
        } else if self.is_held {
            self.refuse(Initiator::Adapter, Refusal::LineHeld, now);
            self.identified = Some(Err(Failure::LineHeld));
        } else {
            self.requests.identify = Some(now);
        }
    }

    /// Drops the requests of hosts on CAN, because the bus is reconfigured.
    pub(crate) fn drop_can_requests(&mut self) {
        count(&mut self.counters.refused_can_requests, self.requests.can.len());
        self.requests.can.clear();
    }

    pub(super) fn refuse_can_requests(&mut self, reason: Refusal, now: Instant) {
        while self.requests.can.pop_front().is_some() {
            self.refuse(Initiator::Can, reason, now);
        }
    }

    pub(super) fn refuse_command(&mut self, reason: Refusal, now: Instant) {
        if self.requests.command.take().is_some() {
            self.refuse(Initiator::Command, reason, now);
        }
    }

    #[cold]
    pub(super) fn refuse(&mut self, initiator: Initiator, reason: Refusal, now: Instant) {
        self.count_refusal(reason);
        self.deliver(&Event::Refused { initiator, reason }, now);
    }

    /// Counts a refusal, on behalf of the hosts' side too.
    pub(crate) const fn count_refusal(&mut self, reason: Refusal) {
        let c = &mut self.counters;
        let counter = match reason {
            Refusal::QueueFull => &mut c.refused_can_requests,
            Refusal::NotAFrame => &mut c.refused_can_frames,
            Refusal::Incomplete => &mut c.commands_incomplete,
            Refusal::Stale => &mut c.commands_stale,
            Refusal::OutOfRange => &mut c.commands_out_of_range,
            Refusal::LineHeld => &mut c.refused_line_held,
            Refusal::OtherRate => &mut c.refused_other_rate,
            Refusal::Stopped => &mut c.refused_stopped,
        };
        *counter = counter.wrapping_add(1);
    }

    pub(super) fn deliver(&mut self, event: &Event, at: Instant) {
        if !self.deliveries.push(at, event) {
            count(&mut self.counters.dropped_events, 1);
        }
    }

    /// The time at which the pending command becomes too old to move the arm.
    pub(super) fn command_timeout(&self) -> Option<Instant> {
        let command = self.requests.command.as_ref()?;
        Some(command.since + self.command_timeout)
    }

    /// Expires late answers, makes polls due, and drops old commands.
    pub(super) fn tick_requests(&mut self, now: Instant) {
        while let Some(initiator) = self.exchange.on_timeout(now) {
            count(&mut self.counters.unanswered_requests, 1);
            if self.holder().is_none() {
                self.exchange_ended(initiator, now);
            }
        }
        let missed = self.poll.tick(now);
        count(&mut self.counters.missed_polls, missed);
        if self.command_timeout().is_some_and(|at| at <= now) {
            self.refuse_command(Refusal::Stale, now);
        }
    }
}
