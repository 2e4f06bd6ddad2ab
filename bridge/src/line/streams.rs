//! Streams of motion: a host that goes silent, and torque-off.

use armwire::time::Instant;

use crate::arm::OwnRequest;
use crate::control::{Event, Initiator};
use crate::counters::count;

use super::Line;
use super::dead_man::STREAMERS;
use super::to_arm::BurstKind;

/// Hosts on CAN that have gone silent.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Silenced {
    /// The hosts that send requests.
    pub(crate) can: bool,
    /// The host that sends commands.
    pub(crate) command: bool,
}

impl Silenced {
    pub(super) const fn add(&mut self, initiator: Initiator) {
        self.can |= matches!(initiator, Initiator::Can);
        self.command |= matches!(initiator, Initiator::Command);
    }
}

impl Line {
    /// Returns true if a restart now must switch the torque off.
    pub(crate) fn is_armed(&self) -> bool {
        self.is_torque_off_waiting() || self.dead_man.switches_off() && self.dead_man.is_any_streaming()
    }

    /// Returns true if torque-off is pending.
    pub(crate) fn is_torque_off_waiting(&self) -> bool {
        let is_handed_over = self.burst.is_some_and(|burst| burst.kind == BurstKind::TorqueOff);
        self.requests.torque_off.is_some() || is_handed_over
    }

    /// The adapter's previous run stopped while it was armed: torque-off goes out first.
    pub(crate) fn restarted_while_armed(&mut self) {
        if self.kind.own(OwnRequest::TorqueOff).is_some() {
            self.requests.torque_off = Some(Instant::ZERO);
            self.from_host.set_cut(true);
        }
    }

    /// Prepares a restart: switches the torque off if a stream is armed. `last_request` is the length of the last
    /// request on CAN, for which the line had no room.
    pub(crate) fn disarm(&mut self, last_request: usize, now: Instant) -> Silenced {
        let mut silenced = Silenced::default();
        for initiator in STREAMERS {
            if self.dead_man.switches_off() && self.dead_man.is_streaming(initiator) {
                self.host_silent(initiator, last_request, now);
                silenced.add(initiator);
            }
        }
        silenced
    }

    /// A host ends its stream of motion without torque-off.
    pub(crate) fn release_stream(&mut self, initiator: Initiator) {
        self.dead_man.end(initiator);
    }

    /// A motion of a host on CAN waits for room in the queue.
    pub(crate) fn motion_waits(&mut self, now: Instant) {
        self.dead_man.motion_waits(Initiator::Can, now);
    }

    /// Motion of a host on CAN was refused in a way that
    /// [keeps its stream alive](crate::can::RefusedRequest::keeps_stream).
    pub(crate) fn keep_alive(&mut self, initiator: Initiator, now: Instant) {
        self.dead_man.keep_alive(initiator, now);
    }

    /// No host could be received until now.
    pub(crate) fn keep_hosts_alive(&mut self, now: Instant) {
        self.dead_man.keep_all_alive(now);
    }

    /// Returns true if the host on USB cannot send because the buffer to the arm is full.
    pub(super) fn is_host_held_back(&self) -> bool {
        !self.has_packet_room() && !self.is_held
    }

    pub(super) fn silence_timeout(&self, initiator: Initiator) -> Option<Instant> {
        let waits_since = match initiator {
            Initiator::Can => self.requests.can_motion_since(),
            _ => None,
        };
        self.dead_man.timeout(initiator, waits_since)
    }

    /// A host that streamed motion went silent: its unsent bytes are outdated.
    pub(super) fn host_silent(&mut self, initiator: Initiator, last_request: usize, now: Instant) {
        let dropped = match initiator {
            Initiator::Usb => {
                self.from_host.cut();
                self.rate.dropped();
                self.drop_host_bytes()
            }
            Initiator::Can => {
                let dropped = self.requests.can_bytes().saturating_add(last_request);
                self.requests.can.clear();
                dropped
            }
            _ => self.requests.command.take().map_or(0, |request| request.bytes.len()),
        };
        let torque_off = self.dead_man.switches_off();
        if torque_off {
            self.requests.torque_off.get_or_insert(now);
            self.take_line_back(now);
        }
        // A pending change of rate was dropped with the bytes.
        self.follow_holder(now);
        self.end_stream(initiator, dropped, torque_off, now);
    }

    /// Drops the bytes of the host on USB that were not handed to the UART, and returns their number.
    pub(super) fn drop_host_bytes(&mut self) -> usize {
        let handed_over = self.burst.filter(|burst| burst.initiator == Initiator::Usb);
        self.from_host.truncate(handed_over.map_or(0, |burst| burst.len))
    }

    /// Ends a host's stream and reports it, if there was one.
    pub(super) fn end_stream(&mut self, initiator: Initiator, dropped: usize, torque_off: bool, now: Instant) {
        if !self.dead_man.end(initiator) {
            return;
        }
        count(&mut self.counters.host_silences, 1);
        count(&mut self.counters.silenced_bytes, dropped);
        let event = Event::HostSilent {
            initiator,
            dropped: dropped as u16,
            torque_off,
        };
        self.deliver(&event, now);
    }
}
