//! Changes of the line's rate, and exclusive use of the line by the host on USB.

use armwire::time::Instant;

use crate::control::{Failure, Initiator, LineState, Refusal};
use crate::counters::count;
use crate::line_coding::UartConfig;

use super::Line;
use super::rate::ControlPort;

impl Line {
    /// Returns true if the host on USB may have a rate other than the arm's.
    pub(super) fn may_change_rate(&self) -> bool {
        !self.dead_man.is_can_streaming() && self.requests.torque_off.is_none() && !self.stop.is_running()
    }

    /// Puts the rate of the host on USB into effect with its next byte. Returns true if it did.
    #[cold]
    pub(super) fn take_rate(&mut self, now: Instant) -> bool {
        let takes = self.may_change_rate() && !self.rate.is_revoked();
        if takes {
            self.rate.take(self.from_host.len(), now);
            self.follow_holder(now);
        }
        takes
    }

    /// Drops bytes of the host on USB whose rate is not in effect.
    #[cold]
    pub(super) fn refuse_packet(&mut self, bytes: usize, now: Instant) {
        count(&mut self.counters.refused_rate_bytes, bytes);
        if self.rate.refuse() {
            self.refuse(Initiator::Usb, Refusal::OtherRate, now);
        }
    }

    /// Torque-off and a stop need the arm's rate: bytes of the host on USB at another rate are cut off.
    pub(super) fn take_line_back(&mut self, now: Instant) {
        if self.rate.revoke() {
            let dropped = self.drop_host_bytes().saturating_add(self.stop.drop_gated());
            count(&mut self.counters.refused_rate_bytes, dropped);
            self.from_host.forget_turn();
            self.from_host.set_cut(true);
            self.follow_holder(now);
        }
    }

    /// A host on the control port requests exclusive use of the line for USB.
    pub(crate) fn hold_line(&mut self, port: ControlPort, now: Instant) -> Result<(), Failure> {
        if self.requests.torque_off.is_some() || self.dead_man.is_any_streaming() {
            return Err(Failure::StreamArmed);
        }
        // The gate would withhold or drop bytes of an upload.
        if self.stop.refuses_motion() || !self.rate.hold(port, now) {
            return Err(Failure::Busy);
        }
        self.follow_holder(now);
        Ok(())
    }

    /// A host on the control port releases the line.
    pub(crate) fn release_line(&mut self, port: ControlPort, now: Instant) {
        self.rate.unhold(port);
        self.follow_holder(now);
    }

    /// Refuses the requests of polls and CAN when a hold begins, and resumes polls when it ends.
    #[inline(never)]
    pub(super) fn follow_holder(&mut self, now: Instant) {
        let held = self.rate.is_held(self.from_host.len());
        if core::mem::replace(&mut self.is_held, held) == held {
            return;
        }
        #[cfg(feature = "defmt")]
        crate::log::holder(self.state().holder);
        let missed = self.poll.pause(held, now);
        count(&mut self.counters.missed_polls, missed);
        if !held {
            return;
        }
        if !self.poll.is_off() {
            self.refuse(Initiator::Poll, Refusal::LineHeld, now);
        }
        self.refuse_command(Refusal::LineHeld, now);
        self.refuse_can_requests(Refusal::LineHeld, now);
        if self.requests.identify.take().is_some() {
            self.identify(now);
        }
    }

    /// The state of the line for [`Reply::Line`](crate::control::Reply::Line).
    pub(crate) fn state(&self) -> LineState {
        self.rate.state(self.from_host.len())
    }

    /// Changes the line's rate, or ends a hold.
    #[cold]
    pub(super) fn tick_rate(&mut self, now: Instant) {
        let moved = self.from_host.moved().max(self.last_rx);
        self.rate.tick(self.may_change_rate(), moved, self.from_host.len(), now);
        self.follow_holder(now);
    }

    /// The configuration that the UART must change to before anything else goes out. The change waits for the answer to
    /// another initiator's request; for torque-off it waits for none.
    pub(crate) fn uart_change(&self) -> Option<UartConfig> {
        let uart = self.rate.change(self.from_host.len())?;
        (self.requests.torque_off.is_some() || !self.is_anothers()).then_some(uart)
    }

    /// The UART was reconfigured: the rest of an unfinished frame is no longer expected. Returns the number of frames
    /// that this ended.
    pub(crate) fn uart_configured(&mut self, uart: UartConfig, now: Instant) -> usize {
        let frames = self.idle(now);
        self.from_host.cut();
        self.rate.changed(uart);
        self.follow_holder(now);
        count(&mut self.counters.line_codings, 1);
        frames
    }

    /// Returns true if the UART must stop transmitting: torque-off or a stop waits, and the arm cannot read bytes at this
    /// rate.
    pub(crate) fn is_cut_due(&self) -> bool {
        (self.requests.torque_off.is_some() || self.stop.is_running()) && !self.rate.is_arms()
    }
}
