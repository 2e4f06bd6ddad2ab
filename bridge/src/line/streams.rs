//! Streams of motion: a host that goes silent, and torque-off.

use armwire::time::Instant;

use crate::arm::OwnRequest;
use crate::control::Initiator;
use crate::earliest::Earliest;

use super::Line;
use super::guard::{EndedStream, EndedStreams, STREAMERS};

impl Line {
    /// Returns true if a restart now must switch the torque off.
    pub(crate) fn is_armed(&self) -> bool {
        self.is_torque_off_due() || self.guard.dead_man.switches_off() && self.guard.dead_man.is_any_streaming()
    }

    /// Returns true if torque-off waits.
    pub(crate) fn is_torque_off_due(&self) -> bool {
        self.outbox.is_torque_off_due()
    }

    /// The adapter's previous run stopped while it was armed: torque-off goes out first.
    pub(crate) fn restarted_while_armed(&mut self) {
        if self.kind.own(OwnRequest::TorqueOff).is_some() {
            self.outbox.restart_with_torque_off();
        }
    }

    /// Prepares a restart: switches the torque off if a stream is armed.
    pub(crate) fn disarm(&mut self, now: Instant) -> EndedStreams {
        STREAMERS.map(|initiator| {
            let is_armed = self.guard.dead_man.switches_off() && self.guard.dead_man.is_streaming(initiator);
            is_armed.then(|| self.host_silent(initiator, now)).flatten()
        })
    }

    /// A host ends its stream of motion without torque-off.
    pub(crate) fn release_stream(&mut self, initiator: Initiator) {
        self.guard.dead_man.end(initiator);
    }

    /// A motion of a host on CAN waits for room in the queue.
    pub(crate) fn motion_waits(&mut self, now: Instant) {
        self.guard.dead_man.motion_waits(Initiator::Can, now);
    }

    /// Motion of a host on CAN was refused in a way that
    /// [keeps its stream alive](crate::can::RefusedRequest::keeps_stream).
    pub(crate) fn keep_alive(&mut self, initiator: Initiator, now: Instant) {
        self.guard.dead_man.keep_alive(initiator, now);
    }

    /// No host could be received until now.
    pub(crate) fn keep_hosts_alive(&mut self, now: Instant) {
        self.guard.dead_man.keep_all_alive(now);
    }

    /// Returns true if the host on USB cannot send because the buffer to the arm is full.
    pub(super) fn is_host_delayed(&self) -> bool {
        !self.has_packet_room() && !self.guard.is_reserved()
    }

    /// The time at which the first of the hosts that stream motion counts as silent.
    pub(super) fn next_silence(&self) -> Option<Instant> {
        // Usually none streams.
        if !self.guard.dead_man.is_any_streaming() {
            return None;
        }
        let [usb, can, command] = STREAMERS.map(|initiator| self.silence_timeout(initiator));
        Earliest::of(usb).or(can).or(command).get()
    }

    pub(super) fn silence_timeout(&self, initiator: Initiator) -> Option<Instant> {
        let waits_since = match initiator {
            Initiator::Can => self.outbox.can_motion_since(),
            _ => None,
        };
        self.guard.dead_man.timeout(initiator, waits_since)
    }

    /// A host that streamed motion went silent: its unsent bytes are outdated.
    pub(super) fn host_silent(&mut self, initiator: Initiator, now: Instant) -> Option<EndedStream> {
        let dropped = self.outbox.silence(initiator);
        if initiator == Initiator::Usb {
            self.guard.rate.dropped();
        }
        let torque_off = self.guard.dead_man.switches_off();
        if torque_off {
            self.outbox.switch_torque_off(now);
            self.take_line_back(now);
        }
        // A pending change of rate was dropped with the bytes.
        self.follow_reservation(now);
        self.guard.end_stream(initiator, dropped, torque_off)
    }
}
