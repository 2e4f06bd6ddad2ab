//! The initiator that may send next.

use armwire::time::Instant;

use crate::control::Initiator;

use super::arbiter::Contender;
use super::requests::StopRequest;
use super::{Outbox, View};

impl Outbox {
    /// The initiator that may send now, if there is one.
    pub(in crate::line) fn next(&self, line: View<'_>, now: Instant) -> Option<Initiator> {
        if self.requests.is_urgent() && !self.from_host.is_in_sequence() {
            return Some(Initiator::Adapter);
        }
        // The arm may take whatever follows a part of the zeros for the rest of a frame.
        if self.from_host.is_voiding() && line.guard.rate.is_arms() {
            return Some(Initiator::Adapter);
        }
        if line.wire.is_anothers() {
            return None;
        }
        // The host continues its sequence, or sends more requests while no other initiator has one.
        if self.from_host.is_in_sequence() || self.are_others_idle(now) {
            return self.contender(line, Initiator::Usb, now).map(|_| Initiator::Usb);
        }
        if line.wire.open_initiator().is_some() {
            return None;
        }
        if self.is_stop_first(line) {
            return self.may_go(line, Initiator::Adapter).then_some(Initiator::Adapter);
        }
        self.arbiter
            .next(&Initiator::ALL.map(|initiator| self.contender(line, initiator, now)))
    }

    /// Returns true if a request of a stop goes before all others: its hold, and its first reading.
    fn is_stop_first(&self, line: View<'_>) -> bool {
        match self.requests.stop {
            Some(StopRequest::Hold(_)) => true,
            Some(StopRequest::Reading(_)) => !line.guard.stop.has_read(),
            None => false,
        }
    }

    /// Returns true if no initiator but the host on USB is ready, which is the usual case.
    pub(super) fn are_others_idle(&self, now: Instant) -> bool {
        self.requests.is_empty() && self.poll.due_since(now).is_none()
    }

    /// The initiator, if it is ready for a turn.
    fn contender(&self, line: View<'_>, initiator: Initiator, now: Instant) -> Option<Contender> {
        let since = self.since(initiator, now)?;
        let may_go = match initiator {
            Initiator::Usb => line.guard.rate.change(self.from_host.len()).is_none() && self.may_host_go(line, now),
            Initiator::Command => true,
            Initiator::Adapter if self.requests.is_urgent() => true,
            Initiator::Can | Initiator::Poll | Initiator::Adapter => self.may_go(line, initiator),
        };
        may_go.then_some(Contender {
            since,
            is_urgent: initiator == Initiator::Poll && self.poll.is_urgent(),
        })
    }

    /// The start of an initiator's wait.
    fn since(&self, initiator: Initiator, now: Instant) -> Option<Instant> {
        match initiator {
            Initiator::Usb => (self.from_host.len() > 0).then(|| self.from_host.moved()),
            Initiator::Can => self.requests.can.front().map(|request| request.since),
            Initiator::Command => self.requests.command.as_ref().map(|request| request.since),
            Initiator::Poll => self.poll.due_since(now),
            Initiator::Adapter => self.requests.of_adapter(),
        }
    }

    /// Returns true if the answer to an initiator's request could be distinguished from all answers that may still
    /// arrive.
    fn may_go(&self, line: View<'_>, initiator: Initiator) -> bool {
        // Usually no answer is missing, and the request does not matter.
        if line.wire.is_idle() {
            return true;
        }
        self.waiting_request(line.kind, initiator)
            .is_some_and(|(_, info)| info.is_none_or(|info| line.wire.can_send(&info, initiator)))
    }

    /// Returns true if the host on USB may send. Alone on the line it always may, as it receives every answer. On a
    /// shared line it is limited to the number of tracked requests, and to requests whose answer cannot be another's.
    fn may_host_go(&self, line: View<'_>, now: Instant) -> bool {
        // A sequence in progress is not delayed, and no arm answers at another rate.
        if line.wire.is_idle() || self.from_host.is_in_sequence() || !line.guard.rate.is_arms() {
            return true;
        }
        let is_alone = !self.arbiter.is_shared(now) && self.are_others_idle(now);
        is_alone
            || self
                .from_host
                .peek_request(line.kind)
                .is_none_or(|info| line.wire.can_send(&info, Initiator::Usb))
    }

    /// The time at which the host on USB, which has paused, loses its turn to others that wait.
    pub(in crate::line) fn turn_timeout(&self, line: View<'_>) -> Option<Instant> {
        if !self.from_host.is_in_sequence() || line.wire.open_initiator().is_some() && !self.requests.is_urgent() {
            return None;
        }
        if self.are_others_idle(Instant::ZERO) {
            return None;
        }
        let [_, others @ ..] = Initiator::ALL;
        let ready = others.map(|initiator| self.contender(line, initiator, Instant::ZERO));
        let since = ready.iter().flatten().map(|contender| contender.since).min()?;
        Some(self.from_host.turn_timeout(since, line.wire.last_byte()))
    }

    /// Ends the turn of a host on USB that has paused, if others wait.
    pub(in crate::line) fn tick_turn(&mut self, line: View<'_>, now: Instant) {
        if self.turn_timeout(line).is_some_and(|at| at <= now) {
            self.from_host.end_turn();
        }
    }
}
