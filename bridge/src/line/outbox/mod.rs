//! Bytes for the arm: those of the host on USB, the requests of all others, and whose turn it is.

mod arbiter;
mod burst;
mod from_host;
mod gate;
mod poll;
mod requests;
mod to_arm;
mod turns;

use armwire::time::{Duration, Instant};

use crate::arm::OwnRequest;
use crate::config::{self, ArmKind, Config};
use crate::control::{Event, Failure, FrameBytes, Initiator, Refusal};
use crate::counters::count;

use super::guard::Guard;
use super::journal::Journal;
use super::wire::{PACKET, Wire};
use arbiter::Arbiter;
use from_host::FromHost;
use gate::Gate;
use poll::Poll;
use requests::{Identification, Request, Requests, StopRequest};

pub use burst::Transmit;
pub(super) use burst::{Burst, BurstKind};
pub use from_host::TO_ARM_BUFFER;
pub use poll::POLL_LEAD_TIME;

/// The reason for a request that was not accepted.
pub(crate) enum NotTaken {
    /// The queue is full now.
    Full,
    Refused(Refusal),
}

/// State of the other owners on which a turn depends.
#[derive(Clone, Copy)]
pub(crate) struct View<'a> {
    pub(crate) kind: ArmKind,
    pub(crate) wire: &'a Wire,
    pub(crate) guard: &'a Guard,
}

/// All that waits for the arm.
pub(crate) struct Outbox {
    from_host: FromHost,
    /// Bytes of the host on USB that wait for the rest of their request while motion is refused.
    gate: Gate,
    requests: Requests,
    command_timeout: Duration,
    poll: Poll,
    arbiter: Arbiter,
    /// The start of the last burst, or the end of the last exchange.
    last_sent: Instant,
}

impl Outbox {
    pub(super) fn new(config: &Config) -> Self {
        Self {
            from_host: FromHost::new(),
            gate: Gate::new(&[]),
            requests: Requests::default(),
            command_timeout: command_timeout(config),
            poll: Poll::new(config.poll, POLL_LEAD_TIME),
            arbiter: Arbiter::new(),
            last_sent: Instant::ZERO,
        }
    }

    // ---- Configuration ----

    pub(super) fn configure(&mut self, config: &Config) {
        self.command_timeout = command_timeout(config);
    }

    pub(super) const fn set_poll_lead_time(&mut self, lead: Duration) {
        self.poll.set_lead(lead);
    }

    /// Restarts the poll clock.
    pub(super) fn restart_poll(&mut self, rate: config::Poll, is_reserved: bool, now: Instant) {
        self.poll = Poll::new(rate, self.poll.lead());
        self.poll.pause(is_reserved, now);
        self.poll.tick(now);
    }

    /// Ends what waits for the previous kind of arm, but for the bytes of the host on USB.
    pub(super) fn change_arm(&mut self, now: Instant, journal: &mut Journal) {
        self.from_host.forget_turn();
        self.requests.torque_off = None;
        self.refuse_command(Refusal::NotAFrame, now, journal);
    }

    // ---- The host on USB ----

    /// Number of queued bytes.
    pub(super) const fn queued(&self) -> usize {
        self.from_host.len()
    }

    /// Returns true if a packet fits, with the bytes that wait at the gate.
    pub(super) fn has_packet_room(&self) -> bool {
        self.from_host.room() >= PACKET.saturating_add(self.gate.len())
    }

    /// The last time that bytes of the host went out or were queued on an empty buffer.
    pub(super) const fn host_moved(&self) -> Instant {
        self.from_host.moved()
    }

    /// Records the arrival of bytes that wait.
    pub(super) const fn touch(&mut self, now: Instant) {
        self.from_host.touch(now);
    }

    /// Queues a packet.
    pub(super) fn push(&mut self, packet: &[u8], now: Instant, journal: &mut Journal) {
        let refused = self.from_host.push(packet, now);
        count(&mut journal.counters.refused_bytes, refused);
    }

    /// Queues a packet while motion is refused.
    #[cold]
    pub(super) fn push_through_gate(&mut self, kind: ArmKind, packet: &[u8], now: Instant, journal: &mut Journal) {
        self.from_host.touch(now);
        self.pass_gate(kind, packet, now, journal);
    }

    fn pass_gate(&mut self, kind: ArmKind, bytes: &[u8], now: Instant, journal: &mut Journal) {
        let refused = self.gate.pass(kind, bytes, &mut self.from_host);
        self.refuse_host_motion(refused, now, journal);
    }

    fn refuse_host_motion(&mut self, refused: usize, now: Instant, journal: &mut Journal) {
        if refused == 0 {
            return;
        }
        count(&mut journal.counters.refused_stopped, refused);
        if self.gate.report() {
            let (initiator, reason) = (Initiator::Usb, Refusal::Stopped);
            journal.report(&Event::Refused { initiator, reason }, now);
        }
    }

    /// The rest of an incomplete request of the host is no longer expected.
    pub(super) fn cut_host(&mut self) {
        self.from_host.cut();
    }

    /// Drops all bytes of the host, and returns their number. Torque-off or a stop needs
    /// the line.
    pub(super) fn drop_host(&mut self) -> usize {
        let dropped = self.from_host.clear().saturating_add(self.gate.clear());
        self.from_host.forget_turn();
        self.from_host.set_cut(true);
        dropped
    }

    // ---- Requests of all others ----

    /// Queues a request of a host on CAN that was complete at `arrived`. Returns true if it is a motion.
    pub(super) fn submit(
        &mut self,
        kind: ArmKind,
        bytes: &[u8],
        limits: Limits,
        arrived: Instant,
    ) -> Result<bool, NotTaken> {
        if self.requests.can.is_full() {
            return Err(NotTaken::Full);
        }
        let request = Some(bytes).filter(|bytes| kind.is_request(bytes));
        let Some(request) = request.and_then(|bytes| Request::new(kind, bytes, arrived)) else {
            return Err(NotTaken::Refused(Refusal::NotAFrame));
        };
        let is_motion = request.is_motion();
        limits.check(is_motion).map_err(NotTaken::Refused)?;
        // The queue is not full.
        let _ = self.requests.can.push_back(request);
        Ok(is_motion)
    }

    /// Queues a motion request of cyclic commands. Returns true if it replaces one that waited.
    pub(super) fn command(&mut self, kind: ArmKind, bytes: &[u8], now: Instant) -> bool {
        let waiting = self.requests.command.take();
        self.requests.command = Request::new(kind, bytes, now);
        waiting.is_some()
    }

    /// Queues an identification request.
    pub(super) fn identify(&mut self, kind: ArmKind, is_reserved: bool, now: Instant, journal: &mut Journal) {
        self.requests.identification = if kind.own(OwnRequest::Identify).is_none() {
            Identification::Ended(Ok(None))
        } else if is_reserved {
            journal.refused(Initiator::Adapter, Refusal::LineReserved, now);
            Identification::Ended(Err(Failure::LineReserved))
        } else {
            Identification::Waiting(now)
        };
    }

    /// Repeats an identification that waits, because the kind of arm or the reservation of the line changed.
    pub(super) fn identify_again(&mut self, kind: ArmKind, is_reserved: bool, now: Instant, journal: &mut Journal) {
        if let Identification::Waiting(_) = self.requests.identification {
            self.identify(kind, is_reserved, now, journal);
        }
    }

    /// The result of an [identification](Self::identify), once.
    pub(super) fn identified(&mut self) -> Option<Result<Option<FrameBytes>, Failure>> {
        self.requests.identification.take_result()
    }

    /// Drops the requests of hosts on CAN, because the bus is reconfigured.
    pub(super) fn drop_can_requests(&mut self, journal: &mut Journal) {
        count(&mut journal.counters.refused_can_requests, self.requests.can.len());
        self.requests.can.clear();
    }

    pub(super) fn refuse_can_requests(&mut self, reason: Refusal, now: Instant, journal: &mut Journal) {
        while self.requests.can.pop_front().is_some() {
            journal.refused(Initiator::Can, reason, now);
        }
    }

    pub(super) fn refuse_command(&mut self, reason: Refusal, now: Instant, journal: &mut Journal) {
        if self.requests.command.take().is_some() {
            journal.refused(Initiator::Command, reason, now);
        }
    }

    /// Start of the wait of the oldest motion of a host on CAN.
    pub(super) fn can_motion_since(&self) -> Option<Instant> {
        self.requests.can_motion_since()
    }

    /// Drops the unsent bytes of a host that has gone silent, and returns their number.
    pub(super) fn silence(&mut self, initiator: Initiator) -> usize {
        match initiator {
            Initiator::Usb => {
                self.from_host.cut();
                self.from_host.clear()
            }
            Initiator::Can => {
                let dropped = self.requests.can_bytes();
                self.requests.can.clear();
                dropped
            }
            _ => self.requests.command.take().map_or(0, |request| request.bytes.len()),
        }
    }

    /// Pauses the poll and refuses the requests of all but the host on USB when a reservation begins, and resumes the
    /// poll when it ends.
    pub(super) fn reserve(&mut self, kind: ArmKind, is_reserved: bool, now: Instant, journal: &mut Journal) {
        let missed = self.poll.pause(is_reserved, now);
        count(&mut journal.counters.missed_polls, missed);
        if !is_reserved {
            return;
        }
        if !self.poll.is_off() {
            journal.refused(Initiator::Poll, Refusal::LineReserved, now);
        }
        self.refuse_command(Refusal::LineReserved, now, journal);
        self.refuse_can_requests(Refusal::LineReserved, now, journal);
        self.identify_again(kind, is_reserved, now, journal);
    }

    // ---- Torque-off, and a stop of the arm ----

    /// Torque-off goes out as soon as possible.
    pub(super) fn switch_torque_off(&mut self, now: Instant) {
        self.requests.torque_off.get_or_insert(now);
    }

    /// Torque-off goes out first, behind zeros that end the rest of a frame.
    pub(super) const fn restart_with_torque_off(&mut self) {
        self.requests.torque_off = Some(Instant::ZERO);
        self.from_host.set_cut(true);
    }

    /// Returns true if torque-off waits.
    pub(super) const fn is_torque_off_due(&self) -> bool {
        self.requests.torque_off.is_some()
    }

    /// Refuses all motion that waits. The bytes of the host on USB pass the gate from here on.
    pub(super) fn refuse_motion(&mut self, kind: ArmKind, now: Instant, journal: &mut Journal) {
        self.refuse_command(Refusal::Stopped, now, journal);
        for request in core::mem::take(&mut self.requests.can) {
            if request.is_motion() {
                journal.refused(Initiator::Can, Refusal::Stopped, now);
            } else {
                // It was in the queue.
                let _ = self.requests.can.push_back(request);
            }
        }
        self.gate = Gate::new(self.from_host.begun());
        self.from_host.end_turn();
        let mut queued = self.from_host.len();
        let mut bytes = [0; PACKET];
        while queued > 0 {
            let taken = self
                .from_host
                .take(bytes.get_mut(..queued.min(PACKET)).unwrap_or_default());
            queued = queued.saturating_sub(taken.max(1));
            self.pass_gate(kind, bytes.get(..taken).unwrap_or_default(), now, journal);
        }
    }

    /// Ends the refusal of motion.
    pub(super) fn open_gate(&mut self, now: Instant, journal: &mut Journal) {
        let refused = self.gate.open(&mut self.from_host);
        self.refuse_host_motion(refused, now, journal);
    }

    /// A stop reads the joints.
    pub(super) fn read_for_stop(&mut self, now: Instant) {
        self.requests.stop.get_or_insert(StopRequest::Reading(now));
    }

    /// A stop holds the arm by this request.
    pub(super) fn hold_arm(&mut self, kind: ArmKind, request: &[u8], now: Instant) {
        self.requests.stop = Request::new(kind, request, now).map(StopRequest::Hold);
    }

    /// A stop has ended.
    pub(super) fn drop_stop_request(&mut self) {
        self.requests.stop = None;
    }

    // ---- Exchanges and time ----

    /// The arm answered a request of the adapter.
    pub(super) fn adapter_answered(&mut self, frame: &[u8]) {
        self.requests.identification.end(Some(frame));
    }

    /// The last request of an initiator is answered, or its answer is missing.
    pub(super) fn exchange_ended(&mut self, initiator: Initiator, now: Instant, journal: &mut Journal) {
        self.last_sent = now;
        match initiator {
            Initiator::Poll => {
                let missed = self.poll.ended(now);
                count(&mut journal.counters.missed_polls, missed);
            }
            Initiator::Adapter => self.requests.identification.end(None),
            Initiator::Usb | Initiator::Can | Initiator::Command => {}
        }
    }

    /// Makes polls due, and drops an old command.
    pub(super) fn tick(&mut self, now: Instant, journal: &mut Journal) {
        let missed = self.poll.tick(now);
        count(&mut journal.counters.missed_polls, missed);
        if self.command_timeout().is_some_and(|at| at <= now) {
            self.refuse_command(Refusal::Stale, now, journal);
        }
    }

    /// Returns true if each poll follows the answer to the last one, and nothing else waits or goes out.
    pub(super) fn polls_only(&self) -> bool {
        self.poll.follows_answers()
            && self.from_host.len() == 0
            && !self.from_host.is_in_sequence()
            && !self.from_host.is_cut()
            && self.requests.is_empty()
    }

    /// The time of the next poll.
    pub(super) fn poll_timeout(&self) -> Option<Instant> {
        self.poll.timeout()
    }

    /// The time at which the pending command becomes too old to move the arm.
    pub(super) fn command_timeout(&self) -> Option<Instant> {
        let command = self.requests.command.as_ref()?;
        Some(command.since + self.command_timeout)
    }

    /// The last time that bytes moved, or could not because an answer was outstanding.
    pub(super) fn last_moved(&self) -> Instant {
        self.from_host.moved().max(self.last_sent)
    }
}

#[cfg(test)]
impl Outbox {
    /// Number of pending requests of hosts on CAN, and of pending bytes of the host on USB.
    pub(super) fn waiting(&self) -> (usize, usize) {
        (self.requests.can.len(), self.from_host.len())
    }
}

/// The limits of requests other than of the host on USB.
#[derive(Clone, Copy)]
pub(super) struct Limits {
    /// The line is reserved for the host on USB.
    pub(super) is_reserved: bool,
    pub(super) refuses_motion: bool,
}

impl Limits {
    pub(super) const fn check(self, is_motion: bool) -> Result<(), Refusal> {
        match self {
            Self { is_reserved: true, .. } => Err(Refusal::LineReserved),
            Self {
                refuses_motion: true, ..
            } if is_motion => Err(Refusal::Stopped),
            _ => Ok(()),
        }
    }
}

const fn command_timeout(config: &Config) -> Duration {
    Duration::from_millis(config.can.command_timeout_ms as u64)
}
