//! Streams of motion: a host that goes silent, and torque-off.

use armwire::time::Instant;

use crate::arm::OwnRequest;
use crate::control::Initiator;

use super::Line;
use super::dead_man::STREAMERS;
use super::to_arm::BurstKind;

/// A stream of motion that has ended without its host.
#[derive(Clone, Copy, Debug)]
pub(crate) struct EndedStream {
    pub(crate) initiator: Initiator,
    /// Number of the host's unsent bytes that the line has dropped.
    pub(crate) dropped: usize,
    /// Torque-off follows.
    pub(crate) torque_off: bool,
}

/// The streams that an event has ended.
pub(crate) type EndedStreams = [Option<EndedStream>; STREAMERS.len()];

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

    /// Prepares a restart: switches the torque off if a stream is armed.
    pub(crate) fn disarm(&mut self, now: Instant) -> EndedStreams {
        STREAMERS.map(|initiator| {
            let is_armed = self.dead_man.switches_off() && self.dead_man.is_streaming(initiator);
            is_armed.then(|| self.host_silent(initiator, now)).flatten()
        })
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
    pub(super) fn host_silent(&mut self, initiator: Initiator, now: Instant) -> Option<EndedStream> {
        let dropped = match initiator {
            Initiator::Usb => {
                self.from_host.cut();
                self.rate.dropped();
                self.drop_host_bytes()
            }
            Initiator::Can => {
                let dropped = self.requests.can_bytes();
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
        self.end_stream(initiator, dropped, torque_off)
    }

    /// Drops the bytes of the host on USB that were not handed to the UART, and returns their number.
    pub(super) fn drop_host_bytes(&mut self) -> usize {
        let handed_over = self.burst.filter(|burst| burst.initiator == Initiator::Usb);
        self.from_host.truncate(handed_over.map_or(0, |burst| burst.len))
    }

    /// Ends a host's stream, if there is one.
    pub(super) fn end_stream(&mut self, initiator: Initiator, dropped: usize, torque_off: bool) -> Option<EndedStream> {
        self.dead_man.end(initiator).then_some(EndedStream {
            initiator,
            dropped,
            torque_off,
        })
    }
}
