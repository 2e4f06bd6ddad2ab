//! The next burst, and the request in it.

use armwire::correlation::{Correlation, Effect};
use armwire::decoder::Kind;
use armwire::time::Instant;

use crate::arm::{Info, OwnRequest};
use crate::config::ArmKind;
use crate::control::{Initiator, MAX_FRAME};
use crate::counters::count;

use super::burst::{Burst, BurstKind};
use super::requests::StopRequest;
use super::{Outbox, View};
use crate::line::journal::Journal;

/// A request of the host on USB that went out.
pub(crate) struct HostRequest<'a> {
    pub(crate) bytes: &'a [u8],
    pub(crate) info: Option<Info>,
    /// Number of bytes behind it that were moved with it.
    pub(crate) behind: usize,
}

impl HostRequest<'_> {
    pub(crate) fn is_motion(&self) -> bool {
        self.info.is_some_and(|info| info.effect == Effect::Motion)
    }
}

impl Outbox {
    /// Copies the next burst to the front of `out`. `None` if nothing is due now.
    pub(in crate::line) fn next_burst(
        &mut self,
        line: View<'_>,
        out: &mut [u8; MAX_FRAME],
        now: Instant,
    ) -> Option<Burst> {
        let initiator = self.next(line, now)?;
        let burst = if initiator == Initiator::Usb {
            let len = self.copy_host_bytes(line, out, now);
            Burst::of_bytes(initiator, BurstKind::Host, len)
        } else if self.from_host.is_cut() {
            // No frame ends with zeros. Without them, an arm that waits for the rest of a frame would take the next
            // request for it.
            let len = self.from_host.void_due().min(MAX_FRAME);
            out.get_mut(..len)?.fill(0);
            Burst::of_bytes(initiator, BurstKind::Zeros, len)
        } else {
            self.take_request(line.kind, initiator, out, now)?
        };
        Some(burst).filter(|burst| burst.len > 0)
    }

    /// Copies bytes of the host on USB, and returns their number.
    fn copy_host_bytes(&self, line: View<'_>, out: &mut [u8], now: Instant) -> usize {
        // One request at a time while others use the line.
        let one = !self.are_others_idle(now) || self.arbiter.is_shared(now);
        let len = line.guard.rate.before_change(out.len());
        self.from_host
            .peek(line.kind, one, out.get_mut(..len).unwrap_or_default())
    }

    /// The pending request of an initiator other than the host on USB.
    pub(super) fn waiting_request(&self, kind: ArmKind, initiator: Initiator) -> Option<(&[u8], Option<Info>)> {
        let own = match initiator {
            Initiator::Can | Initiator::Command => {
                let request = self.requests.of(initiator)?;
                return Some((&request.bytes, request.info));
            }
            Initiator::Poll => OwnRequest::Poll,
            _ if self.requests.torque_off.is_some() => OwnRequest::TorqueOff,
            _ => match &self.requests.stop {
                Some(StopRequest::Hold(hold)) => return Some((&hold.bytes, hold.info)),
                Some(StopRequest::Reading(_)) => OwnRequest::Poll,
                None => OwnRequest::Identify,
            },
        };
        let bytes = kind.own(own)?;
        Some((bytes, kind.request(bytes)))
    }

    /// Moves the pending request of an initiator other than the host on USB to the front of `out`.
    fn take_request(&mut self, kind: ArmKind, initiator: Initiator, out: &mut [u8], now: Instant) -> Option<Burst> {
        let (bytes, info) = self.waiting_request(kind, initiator)?;
        out.get_mut(..bytes.len())?.copy_from_slice(bytes);
        let len = bytes.len();
        let slot = match initiator {
            Initiator::Poll => self.poll.slot(),
            _ => None,
        };
        let (since, burst) = self.remove_request(kind, initiator);
        Some(Burst {
            initiator,
            len,
            start: slot.filter(|slot| *slot > now),
            info,
            since,
            kind: burst,
        })
    }

    /// Removes the pending request of an initiator. Returns the start of its wait.
    fn remove_request(&mut self, kind: ArmKind, initiator: Initiator) -> (Option<Instant>, BurstKind) {
        let requests = &mut self.requests;
        match initiator {
            Initiator::Usb | Initiator::Poll => (None, BurstKind::Request),
            Initiator::Can => match requests.can.pop_front() {
                Some(request) if kind.is_torque_on(&request.bytes) => (Some(request.since), BurstKind::TorqueOn),
                request => (request.map(|request| request.since), BurstKind::Request),
            },
            Initiator::Command => {
                let since = requests.command.take().map(|request| request.since);
                (since, BurstKind::Request)
            }
            Initiator::Adapter => match requests.torque_off.take() {
                Some(since) => (Some(since), BurstKind::Request),
                None => match requests.stop.take() {
                    Some(StopRequest::Hold(hold)) => (Some(hold.since), BurstKind::Hold),
                    Some(StopRequest::Reading(since)) => (Some(since), BurstKind::Reading),
                    None => (requests.identification.take(), BurstKind::Request),
                },
            },
        }
    }

    /// Accounts for a burst that the UART has been sending since `now`, apart from the [bytes](Self::host_sent) of the host
    /// on USB.
    pub(in crate::line) fn transmitted(&mut self, burst: &Burst, now: Instant, journal: &mut Journal) {
        count(&mut journal.counters.host_to_arm_bytes, burst.len);
        let began = burst.began(now);
        self.last_sent = began;
        match burst.kind {
            BurstKind::Zeros => {
                self.from_host.voided(burst.len);
                count(&mut journal.counters.requests_adapter, 1);
                self.arbiter.sent_raw(Initiator::Adapter);
            }
            BurstKind::Host => {
                self.from_host.begin(now);
                self.arbiter.taken(Initiator::Usb, false, now);
            }
            _ => self.request_sent(burst, began, now, journal),
        }
    }

    /// Accounts for a request of an initiator other than the host on USB.
    fn request_sent(&mut self, burst: &Burst, began: Instant, now: Instant, journal: &mut Journal) {
        let c = &mut journal.counters;
        let counter = match burst.initiator {
            Initiator::Usb => &mut c.requests_usb,
            Initiator::Can => &mut c.requests_can,
            Initiator::Poll => &mut c.requests_poll,
            Initiator::Command => &mut c.requests_command,
            Initiator::Adapter => &mut c.requests_adapter,
        };
        count(counter, 1);
        let is_poll = burst.initiator == Initiator::Poll;
        if is_poll {
            if let Some(slot) = self.poll.slot() {
                journal.latencies.poll.add(now.since(slot));
                count(&mut journal.counters.late_polls, usize::from(now > slot));
            }
            self.poll.began();
        }
        if let Some(since) = burst.since {
            journal.latencies.turn.add(now.since(since));
        }
        self.arbiter
            .taken(burst.initiator, is_poll && self.poll.is_urgent(), began);
    }

    /// Moves up to `len` bytes of the host that went out from the queue, as many as fit beside
    /// [requests](Self::next_host_request) that were not taken, and returns their number.
    pub(in crate::line) fn host_sent(&mut self, len: usize, now: Instant) -> usize {
        self.from_host.sent(len, now)
    }

    /// The next request in these bytes. The arm may receive bytes at another rate than its own as the beginning of a
    /// frame.
    pub(in crate::line) fn next_host_request(
        &mut self,
        kind: ArmKind,
        is_at_arms_rate: bool,
        journal: &mut Journal,
    ) -> Option<HostRequest<'_>> {
        let (span, behind) = loop {
            let (span, behind) = self.from_host.next_span(kind)?;
            if span.kind == Kind::Frame {
                break (span, behind);
            }
        };
        self.from_host.set_cut(!is_at_arms_rate);
        count(&mut journal.counters.requests_usb, 1);
        journal.latencies.turn.add(self.from_host.waited());
        let bytes = self.from_host.bytes(span);
        Some(HostRequest {
            bytes,
            info: kind.request(bytes),
            behind,
        })
    }

    /// Ends the turn of a host that has sent a void.
    pub(in crate::line) fn end_void(&mut self, journal: &mut Journal) {
        if self.from_host.end_void() {
            count(&mut journal.counters.voids_usb, 1);
        }
    }

    /// Bytes of the host went out at another rate than the arm's.
    pub(in crate::line) const fn sent_at_other_rate(&mut self) {
        self.from_host.set_cut(true);
    }
}
