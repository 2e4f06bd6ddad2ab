//! Changes of the line's rate, and exclusive use of the line by the host on USB.

use armwire::time::Instant;

use crate::control::{Failure, Initiator, LineState, Refusal};
use crate::counters::count;
use crate::line_coding::UartConfig;

use super::Line;
use super::guard::{ControlPort, LineRate};

impl Line {
    /// Changes the line's rate or its holder. `change` gets the number of queued bytes of the host on USB.
    pub(super) fn change_rate<R>(&mut self, now: Instant, change: impl FnOnce(&mut LineRate, usize) -> R) -> R {
        let result = change(&mut self.guard.rate, self.outbox.queued());
        self.follow_holder(now);
        result
    }

    /// Returns true if the host on USB may have a rate other than the arm's.
    fn may_change_rate(&self) -> bool {
        self.guard.may_change_rate(self.outbox.is_torque_off_due())
    }

    /// Puts the rate of the host on USB into effect with its next byte. Returns true if it did.
    #[cold]
    pub(super) fn take_rate(&mut self, now: Instant) -> bool {
        let takes = self.may_change_rate() && !self.guard.rate.is_revoked();
        if takes {
            self.change_rate(now, |rate, queued| rate.take(queued, now));
        }
        takes
    }

    /// Drops bytes of the host on USB whose rate is not in effect.
    #[cold]
    pub(super) fn refuse_packet(&mut self, bytes: usize, now: Instant) {
        count(&mut self.journal.counters.refused_rate_bytes, bytes);
        if self.guard.rate.refuse() {
            self.journal.refused(Initiator::Usb, Refusal::OtherRate, now);
        }
    }

    /// Torque-off and a stop need the arm's rate: bytes of the host on USB at another rate are cut off.
    pub(super) fn take_line_back(&mut self, now: Instant) {
        if self.guard.rate.revoke() {
            let dropped = self.outbox.drop_host();
            count(&mut self.journal.counters.refused_rate_bytes, dropped);
            self.follow_holder(now);
        }
    }

    /// A host on the control port requests exclusive use of the line for USB.
    pub(crate) fn hold_line(&mut self, port: ControlPort, now: Instant) -> Result<(), Failure> {
        if self.outbox.is_torque_off_due() || self.guard.dead_man.is_any_streaming() {
            return Err(Failure::StreamArmed);
        }
        // The gate would withhold or drop bytes of an upload.
        let is_held = !self.guard.stop.refuses_motion() && self.change_rate(now, |rate, _| rate.hold(port, now));
        is_held.then_some(()).ok_or(Failure::Busy)
    }

    /// A host on the control port releases the line.
    pub(crate) fn release_line(&mut self, port: ControlPort, now: Instant) {
        self.change_rate(now, |rate, _| rate.unhold(port));
    }

    /// Applies a change of the holder of the line, if there is one.
    // Not inlined: it has many callers.
    #[inline(never)]
    pub(super) fn follow_holder(&mut self, now: Instant) {
        if let Some(is_held) = self.guard.changed_holder(self.outbox.queued()) {
            #[cfg(feature = "defmt")]
            crate::log::holder(self.state().holder);
            self.outbox.hold(self.kind, is_held, now, &mut self.journal);
        }
    }

    /// The state of the line for [`Reply::Line`](crate::control::Reply::Line).
    pub(crate) fn state(&self) -> LineState {
        self.guard.rate.state(self.outbox.queued())
    }

    /// The time of the next change of the line's rate, or of the end of a hold.
    pub(super) fn rate_timeout(&self) -> Option<Instant> {
        self.guard.rate.timeout(self.may_change_rate())
    }

    /// Changes the line's rate, or ends a hold.
    #[cold]
    pub(super) fn tick_rate(&mut self, now: Instant) {
        let may_change = self.may_change_rate();
        let moved = self.outbox.host_moved().max(self.wire.last_byte());
        self.change_rate(now, |rate, queued| rate.tick(may_change, moved, queued, now));
    }

    /// The configuration that the UART must change to before anything else goes out. The change waits for the answer to
    /// another initiator's request; for torque-off it waits for none.
    pub(crate) fn uart_change(&self) -> Option<UartConfig> {
        let uart = self.guard.rate.change(self.outbox.queued())?;
        (self.outbox.is_torque_off_due() || !self.wire.is_anothers()).then_some(uart)
    }

    /// The UART was reconfigured: the rest of an unfinished frame is no longer expected. Returns the number of frames
    /// that this ended.
    pub(crate) fn uart_configured(&mut self, uart: UartConfig, now: Instant) -> usize {
        let frames = self.idle(now);
        self.outbox.cut_host();
        self.change_rate(now, |rate, _| rate.changed(uart));
        count(&mut self.journal.counters.line_codings, 1);
        frames
    }

    /// Returns true if the UART must stop transmitting: torque-off or a stop waits, and the arm cannot read bytes at this
    /// rate.
    pub(crate) fn is_cut_due(&self) -> bool {
        self.guard.is_cut_due(self.outbox.is_torque_off_due())
    }
}
