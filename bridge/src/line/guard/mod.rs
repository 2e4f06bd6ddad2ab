//! Limits of the bytes for the arm: the supervision of streams of motion, a stop, the line's rate and its reservation.

mod dead_man;
mod rate;
mod stop;

use armwire::time::Instant;

use crate::arm::OwnRequest;
use crate::config::Config;
use crate::control::Initiator;

use dead_man::DeadMan;
use stop::Stop;

pub(crate) use dead_man::STREAMERS;
pub(crate) use rate::ControlPort;
pub(super) use rate::LineRate;
pub(super) use stop::Step;

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

/// The limits of what goes out.
pub(crate) struct Guard {
    pub(super) dead_man: DeadMan,
    pub(super) stop: Stop,
    /// Change it by [`Line::change_rate`](super::Line::change_rate) where this may change the reservation.
    pub(super) rate: LineRate,
    /// Polls and CAN are being refused because the line is reserved for the host on USB.
    is_reserved: bool,
}

impl Guard {
    pub(super) fn new(config: &Config) -> Self {
        Self {
            dead_man: DeadMan::new(config.host_timeout, can_switch_off(config)),
            stop: Stop::new(),
            rate: LineRate::new(config.arm),
            is_reserved: false,
        }
    }

    pub(super) fn configure(&mut self, config: &Config) {
        self.dead_man.configure(config.host_timeout, can_switch_off(config));
    }

    /// Ends a host's stream, if there is one.
    pub(super) fn end_stream(&mut self, initiator: Initiator, dropped: usize, torque_off: bool) -> Option<EndedStream> {
        self.dead_man.end(initiator).then_some(EndedStream {
            initiator,
            dropped,
            torque_off,
        })
    }

    /// Returns true if polls and CAN are refused because the line is reserved for the host on USB.
    pub(super) const fn is_reserved(&self) -> bool {
        self.is_reserved
    }

    /// Returns true or false if a reservation has begun or ended since the last call. `queued` bytes of the host on USB
    /// wait.
    pub(super) fn changed_reservation(&mut self, queued: usize) -> Option<bool> {
        let is_reserved = self.rate.is_reserved(queued);
        (core::mem::replace(&mut self.is_reserved, is_reserved) != is_reserved).then_some(is_reserved)
    }

    /// Returns true if the host on USB may have a rate other than the arm's.
    pub(super) fn may_change_rate(&self, is_torque_off_due: bool) -> bool {
        !self.dead_man.is_can_streaming() && !is_torque_off_due && !self.stop.is_running()
    }

    /// Returns true if the UART must stop transmitting: torque-off or a stop waits, and the arm cannot read bytes at this
    /// rate.
    pub(super) fn is_cut_due(&self, is_torque_off_due: bool) -> bool {
        (is_torque_off_due || self.stop.is_running()) && !self.rate.is_arms()
    }

    /// A request of the host on USB went out.
    pub(super) fn host_requested(&mut self, is_motion: bool, is_torque_on: bool, now: Instant) {
        // The arm cannot read bytes at another rate, and a requested reservation disables torque-off.
        if !self.rate.is_arms() || self.rate.is_reserved_by_request() {
            return;
        }
        if is_motion {
            self.dead_man.motion(Initiator::Usb, now);
        } else if is_torque_on {
            self.dead_man.end(Initiator::Usb);
        }
    }
}

fn can_switch_off(config: &Config) -> bool {
    config.arm.own(OwnRequest::TorqueOff).is_some()
}
